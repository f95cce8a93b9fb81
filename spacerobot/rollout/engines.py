"""Evaluate a kernel over rows of parameters, by machine code."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from spacerobot.compiled import Library, Toolchain, compile_functions
from spacerobot.rollout.closure import Closure
from spacerobot.rollout.grid import TimeGrid
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.protocol import Array


@dataclass(frozen=True)
class Raw:
    """Arrays that an engine fills, one row for each rollout.

    Attributes
    ----------
    x, y
        Samples of the state (N, nt, nx) and of outputs (N, nt, rows), None if not asked for; NaN after
        divergence.
    r, cost
        Measures (N, nr) and costs (N, nj).
    done
        Good steps, shape (N,); -1 for a rollout that did not run.
    reached
        Time of the last good state in s, shape (N,); that of the last sample if the rollout completed.
    gaps
        Initial gaps of grasps that may begin open (N, n) [m].
    error
        Largest estimate of a step's error, shape (N,), None if not asked for.
    """

    x: Array | None
    y: Array | None
    r: Array
    cost: Array
    done: npt.NDArray[np.int64]
    reached: Array
    gaps: Array
    error: Array | None = None

    @classmethod
    def empty(cls, kernel: Kernel, grid: TimeGrid, count: int, states: bool, rows: Sequence[int]) -> Raw:
        """Arrays full of NaN for so many rollouts, the error not asked for."""
        samples = grid.intervals + 1
        nx, nr, nj = kernel.nx + kernel.integrals, kernel.size("objective", "r"), len(kernel.costs)
        return cls(
            np.full((count, samples, nx), np.nan) if states else None,
            np.full((count, samples, len(rows)), np.nan) if len(rows) else None,
            np.full((count, nr), np.nan),
            np.full((count, nj), np.nan),
            np.full(count, -1, dtype=np.int64),
            np.full(count, np.nan),
            np.full((count, len(kernel.closure.largest)), np.nan),
        )

    def part(self, rows: slice) -> Raw:
        """View of some rollouts."""
        x = None if self.x is None else self.x[rows]
        y = None if self.y is None else self.y[rows]
        error = None if self.error is None else self.error[rows]
        own = (self.r[rows], self.cost[rows], self.done[rows], self.reached[rows], self.gaps[rows])
        return Raw(x, y, *own, error)

    def completed(self, grid: TimeGrid) -> npt.NDArray[np.bool_]:
        """Which rollouts reached the end, shape (N,)."""
        return np.asarray(self.reached == grid.time[-1])

    def judge_start(self, closure: Closure, p: Array) -> None:
        """Note the gaps of rollouts of p (N, np); of one that begins open only its initial state is left."""
        self.gaps[:] = closure.measure(p)
        lost = closure.is_open(self.gaps) & (self.done >= 0)
        self.done[lost], self.reached[lost], self.r[lost], self.cost[lost] = 0, 0.0, np.nan, np.nan
        for samples in (self.x, self.y):
            if samples is not None:
                samples[lost, 1:] = np.nan

    def count(self, rows: slice) -> int:
        """How many of some rollouts ran."""
        return int((self.done[rows] >= 0).sum())


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


class Engine(Protocol):
    """Evaluates a kernel."""

    @property
    def kernel(self) -> Kernel:
        """The kernel."""

    @property
    def backend(self) -> str:
        """``compiled`` or ``interpreted``."""

    @property
    def lanes(self) -> int:
        """Rollouts carried at once."""

    def rollouts(self, p: Array, grid: TimeGrid, raw: Raw, rows: Sequence[int], stop: StopFlag) -> None:
        """Roll out every row of parameters (N, np) into ``raw``, recording outputs ``rows``."""


class _Job(ctypes.Structure):
    _fields_ = (
        ("count", ctypes.c_int64),
        ("intervals", ctypes.c_int64),
        ("every", ctypes.c_int64),
        ("h", ctypes.c_double),
        ("p", ctypes.c_void_p),
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
        ("stop", ctypes.c_void_p),
    )


HOT = {"dynamics", "normalise", "dynamics_reverse", "normalise_reverse"}
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
    loops = resources.files("spacerobot.rollout").joinpath("rollout.hpp").read_text(encoding="utf-8")
    tail = "\n".join([*_facts(kernel, adjoint), kernel.method.source(), loops])
    cold = set(kernel.functions) - HOT
    return compile_functions(
        kernel.functions, lanes=lanes, cold=cold, tail=tail, toolchain=toolchain, progress=progress
    )


def _facts(kernel: Kernel, adjoint: bool) -> list[str]:
    """What the loops must know of a kernel before they are compiled."""
    lines = [f"#define INTEGRALS {kernel.integrals}", f"#define PEAKS {kernel.peaks}"]
    lines += [f"#define JUMPS {len(kernel.jumps)}"] + ["#define ADJOINT"] * adjoint
    if kernel.rate is not None:
        lines.append(f"#define RATE {kernel.rate}")
    places = {"JUMP": kernel.jumps, "JUMP_BAR": kernel.jump_bars, "JUMP_SLOPE": kernel.jump_slopes}
    for name, found in places.items():
        lines.append(f"static const int {name}[] = {{{', '.join(map(str, [*found, -1]))}}};")
    return lines


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

    def rollouts(self, p: Array, grid: TimeGrid, raw: Raw, rows: Sequence[int], stop: StopFlag) -> None:
        """Roll out every row of parameters; see :class:`Engine`."""
        job, _keep = make_job(self.kernel, p, grid, raw, rows, stop)
        self.library.entry("rollouts")(ctypes.byref(job))


def make_job(
    kernel: Kernel, p: Array, grid: TimeGrid, raw: Raw, rows: Sequence[int], stop: StopFlag
) -> tuple[_Job, list[Any]]:
    """The structure that the compiled loops read, and the arrays that must outlive the call."""
    given = np.ascontiguousarray(p, dtype=float)
    row = np.ascontiguousarray(rows, dtype=np.int64)
    keep: list[Any] = [given, row, kernel.scale, raw, stop]

    def address(array: npt.NDArray[Any] | None) -> int | None:
        return None if array is None else array.ctypes.data

    job = _Job(
        len(given),
        grid.intervals,
        grid.every,
        grid.step_s,
        address(given),
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
        stop.address,
    )
    return job, keep
