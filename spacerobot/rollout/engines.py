"""Evaluate a kernel over rows of parameters, by machine code."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any

import numpy as np
import numpy.typing as npt

from spacerobot.compiled import Library, Toolchain, compile_functions
from spacerobot.errors import CompileError
from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.rollout_arrays import RolloutArrays
from spacerobot.rollout.time_grid import TimeGrid


class StopFlag:
    """A number that running engines look at now and then; other than zero, they leave."""

    def __init__(self) -> None:
        self._value = ctypes.c_int32(0)

    def set(self) -> None:
        """Ask every engine that looks at this flag to leave."""
        self._value.value = 1

    @property
    def is_set(self) -> bool:
        """Whether they were asked to leave."""
        return self._value.value != 0

    @property
    def address(self) -> int:
        """Where the number lies."""
        return ctypes.addressof(self._value)


class _EngineCall(ctypes.Structure):
    _fields_ = (
        ("count", ctypes.c_int64),
        ("intervals", ctypes.c_int64),
        ("every", ctypes.c_int64),
        ("h", ctypes.c_double),
        ("finer", ctypes.c_double),
        ("p", ctypes.c_void_p),
        ("noise", ctypes.c_void_p),
        ("noises", ctypes.c_int64),
        ("scale", ctypes.c_void_p),
        ("x", ctypes.c_void_p),
        ("y", ctypes.c_void_p),
        ("row", ctypes.c_void_p),
        ("rows", ctypes.c_int64),
        ("r", ctypes.c_void_p),
        ("cost", ctypes.c_void_p),
        ("error", ctypes.c_void_p),
        ("reached", ctypes.c_void_p),
        ("done", ctypes.c_void_p),
        ("fate", ctypes.c_void_p),
        ("most", ctypes.c_int64),
        ("fired", ctypes.c_void_p),
        ("event", ctypes.c_void_p),
        ("when", ctypes.c_void_p),
        ("jump", ctypes.c_void_p),
        ("doubt", ctypes.c_void_p),
        ("backwards", ctypes.c_int64),
        ("stop", ctypes.c_void_p),
    )


HOT = {"dynamics", "normalise", "values", "dynamics_reverse", "normalise_reverse"}
"""Functions that every step evaluates."""


def compile_kernel(
    kernel: Kernel,
    lanes: int,
    toolchain: Toolchain | None = None,
    *,
    adjoint: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Library:
    """Compile a kernel together with the rollout loops.

    Parameters
    ----------
    kernel
        What to compile; with the reverse functions if ``adjoint``.
    lanes
        Rollouts carried at once.
    toolchain
        What to compile with; found if None.
    adjoint
        Whether to build the adjoint as well.
    progress
        As for :func:`compile_functions`.
    """
    folder = resources.files("spacerobot.rollout").joinpath("loops")
    parts = {"steps": True, "tables": kernel.tables, "events": kernel.events, "forward": True}
    names = [name for name, needed in (parts | {"adjoint": adjoint}).items() if needed]
    loops = [folder.joinpath(f"{name}.hpp").read_text(encoding="utf-8") for name in names]
    # what the loops need to know of the kernel at compile time
    sizes = {
        "INTEGRALS": kernel.integrals,
        "PEAKS": kernel.peaks,
        "JUMPS": len(kernel.jumps),
        "EVENTS": len(kernel.events),
        "CLOCKS": sum(event.clock for event in kernel.events),
        "SWITCHES": len(kernel.switches),
        "FINES": len(kernel.fine),
        "SEEING": len(kernel.seen),
        "TABLES": len(kernel.tables),
    }
    lines = [f"#define {name} {size}" for name, size in sizes.items()]
    if kernel.c_slopes:
        lines.append("#define C_SLOPES")
    if kernel.rate is not None:
        lines.append(f"#define RATE {kernel.rate}")
    sets = [{place: int(on) for place, on in event.sets} for event in kernel.events]
    numbers: dict[str, Iterable[float]] = {
        "int JUMP": kernel.jumps,
        "int JUMP_BAR": kernel.jump_bars,
        "int JUMP_SLOPE": kernel.jump_slopes,
        "int SWITCH": kernel.switches,
        "int ENDS": [event.ends for event in kernel.events],
        "int KINK": [event.kink for event in kernel.events],
        "int MOVES": kernel.moving or [False] * len(kernel.events),
        "int GAP": kernel.gaps,
        "int CLOCK": [event.clock for event in kernel.events],
        "int SILENT": [event.silent for event in kernel.events],
        "int ROUTINE": [event.routine for event in kernel.events],
        "int FIXED": [not moves for moves in kernel.moving] or [False] * len(kernel.events),
        "int SEEN": kernel.seen,
        "int FINE": [place for place, _, _ in kernel.fine],
        "int TABLE_CURSOR": [table.cursor for table in kernel.tables],
        "int TABLE_FIRST": [table.first for table in kernel.tables],
        "int TABLE_WINDOW": [table.window for table in kernel.tables],
        "int TABLE_WIDTH": [table.width for table in kernel.tables],
        "int TABLE_NOISE": [table.noise for table in kernel.tables],
        "int C_BAR": kernel.c_bars,
        "int C_SLOPE": kernel.c_slopes,
        "double FINE_STEP": [step_s for _, step_s, _ in kernel.fine],
        "double FINE_GROW": [grow for _, _, grow in kernel.fine],
    }
    lines += [f"static const {name}[] = {{{_listed(found)}}};" for name, found in numbers.items()]
    rows = [_listed(row.get(place, -1) for place in range(len(kernel.switches))) for row in sets]
    table = ", ".join(f"{{{row}}}" for row in [*rows, "-1"])
    lines.append(f"static const int SETS[][SWITCHES + 1] = {{{table}}};")
    tail = "\n".join([*lines, kernel.method.source(), *loops])
    often = {"update", "guards"} if any(event.clock for event in kernel.events) else set()
    cold = set(kernel.functions) - HOT - often
    return compile_functions(
        kernel.functions, lanes=lanes, cold=cold, tail=tail, toolchain=toolchain, progress=progress
    )


def _listed(numbers: Iterable[float]) -> str:
    """Numbers as an initialiser, with one more, since an array has at least one."""
    return ", ".join("INFINITY" if number == math.inf else repr(number + 0) for number in [*numbers, -1])


@dataclass(frozen=True)
class CompiledEngine:
    """Machine code that carries ``library.lanes`` rollouts at once and runs without Python's lock."""

    kernel: Kernel
    library: Library
    backend: str = field(default="compiled", init=False)

    @property
    def lanes(self) -> int:
        """Rollouts carried at once."""
        return self.library.lanes

    def rollouts(
        self, p: Array, grid: TimeGrid, raw: RolloutArrays, rows: Sequence[int], stop: StopFlag
    ) -> None:
        """Roll out every row of parameters (N, np) into ``raw``, recording outputs ``rows``."""
        job, _keep = make_job(self.kernel, p, grid, raw, rows, stop)
        entry = self.library.entry("rollouts")
        entry.restype = ctypes.c_int64
        if entry(ctypes.byref(job)) < 0:
            raise CompileError(f"no memory for {self.lanes} rollouts at once")


def make_job(
    kernel: Kernel, p: Array, grid: TimeGrid, raw: RolloutArrays, rows: Sequence[int], stop: StopFlag
) -> tuple[_EngineCall, list[Any]]:
    """The structure that the compiled loops read, and the arrays that must outlive the call."""
    given = np.ascontiguousarray(p, dtype=float)
    row = np.ascontiguousarray(rows, dtype=np.int64)
    noise = np.ascontiguousarray(kernel.noise.drawn(given))
    keep: list[Any] = [given, row, kernel.scale, raw, stop, noise]

    def address(array: npt.NDArray[Any] | None) -> int | None:
        return None if array is None else array.ctypes.data

    job = _EngineCall(
        len(given),
        grid.intervals,
        grid.every,
        grid.step_s,
        grid.finer,
        address(given),
        address(noise),
        noise.shape[1],
        address(kernel.scale),
        address(raw.x),
        address(raw.y),
        address(row),
        len(row),
        address(raw.r),
        address(raw.cost),
        address(raw.error),
        address(raw.reached),
        address(raw.done),
        address(raw.fate),
        raw.log.event.shape[1],
        address(raw.log.fired),
        address(raw.log.event),
        address(raw.log.when),
        address(raw.log.jump),
        address(raw.log.doubt),
        raw.backwards,
        stop.address,
    )
    return job, keep
