"""Evaluate a kernel over rows of parameters."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any

import numpy as np
import numpy.typing as npt

from spacerobot.common.errors import CompileError
from spacerobot.compiled import Library, Toolchain, compile_functions
from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.kernel_tables import constants_of
from spacerobot.rollout.rollout_arrays import RolloutArrays
from spacerobot.rollout.time_grid import TimeGrid
from spacerobot.rollout.virtual_machine import SceneProgram, call_loops


class StopFlag:
    """A number that running engines look at now and then; other than zero, they leave."""

    def __init__(self) -> None:
        self._value = ctypes.c_int32(0)

    def set(self) -> None:
        """Ask every engine that looks at this flag to leave."""
        self._value.value = 1

    @property
    def is_set(self) -> bool:
        """Whether the threads are to stop."""
        return self._value.value != 0

    @property
    def address(self) -> int:
        """Address of the number."""
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
        ("status", ctypes.c_void_p),
        ("most", ctypes.c_int64),
        ("fired", ctypes.c_void_p),
        ("event", ctypes.c_void_p),
        ("when", ctypes.c_void_p),
        ("jump", ctypes.c_void_p),
        ("gradient_warning", ctypes.c_void_p),
        ("backwards", ctypes.c_int64),
        ("located", ctypes.c_int64),
        ("stop", ctypes.c_void_p),
    )


HOT = {"dynamics", "normalise", "values", "dynamics_reverse", "normalise_reverse"}
"""Functions that every step evaluates; they are compiled with full optimisation."""


def compile_kernel(
    kernel: Kernel,
    lanes: int,
    toolchain: Toolchain | None = None,
    *,
    adjoint: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Library:
    """Compile a kernel together with the rollout loops.

    Args:
        kernel: Functions to compile; with the reverse functions if ``adjoint``.
        lanes: Number of rollouts that are integrated together.
        toolchain: Compiler and options; searched if None.
        adjoint: Whether to build the adjoint as well.
        progress: As for :func:`compile_functions`.
    """
    return compile_functions(
        kernel.functions,
        lanes=lanes,
        cold=cold_functions(kernel),
        tail=loops_source(kernel, adjoint=adjoint),
        toolchain=toolchain,
        progress=progress,
    )


def cold_functions(kernel: Kernel) -> set[str]:
    """Names of the kernel's rarely called functions, which are compiled with little optimisation."""
    frequent = {"update", "guards"} if any(event.clock for event in kernel.events) else set()
    return set(kernel.functions) - HOT - frequent


def loops_source(kernel: Kernel, *, adjoint: bool = False) -> str:
    """C++ of the rollout loops of a kernel, which follows its functions; with the adjoint on request."""
    folder = resources.files("spacerobot.rollout").joinpath("loops")
    parts = {"steps": True, "tables": kernel.tables, "events": kernel.events, "forward": True}
    names = [name for name, needed in (parts | {"adjoint": adjoint}).items() if needed]
    loops = [folder.joinpath(f"{name}.hpp").read_text(encoding="utf-8") for name in names]
    return "\n".join([constants_of(kernel), kernel.method.source(), *loops])


@dataclass(frozen=True)
class CompiledLoops:
    """Loops compiled together with a kernel: ``library.lanes`` rollouts at once, without Python's lock."""

    library: Library
    backend: str = field(default="compiled", init=False)

    @property
    def lanes(self) -> int:
        """Number of rollouts that are integrated together."""
        return self.library.lanes

    def run(self, name: str, *structures: ctypes.Structure) -> int:
        """Call ``rollouts`` or ``gradients`` of the library and return its result."""
        entry = self.library.entry(name)
        entry.restype = ctypes.c_int64
        return int(entry(*map(ctypes.byref, structures)))


@dataclass(frozen=True)
class InterpretedLoops:
    """The loops of every scene over a kernel that the virtual machine evaluates, without Python's lock."""

    program: SceneProgram
    backend: str = field(default="interpreted", init=False)
    lanes: int = field(default=1, init=False)

    def run(self, name: str, *structures: ctypes.Structure) -> int:
        """Run a function as :meth:`CompiledLoops.run` does."""
        scene = ctypes.c_void_p(self.program.address)
        return call_loops(f"{name}_of", scene, *map(ctypes.byref, structures))


Loops = CompiledLoops | InterpretedLoops


@dataclass(frozen=True)
class Engine:
    """Loops that evaluate a kernel."""

    kernel: Kernel
    loops: Loops

    @property
    def backend(self) -> str:
        """``compiled`` or ``interpreted``."""
        return self.loops.backend

    @property
    def lanes(self) -> int:
        """Number of rollouts that are integrated together."""
        return self.loops.lanes

    def rollouts(
        self, p: Array, grid: TimeGrid, raw: RolloutArrays, rows: Sequence[int], stop: StopFlag
    ) -> None:
        """Roll out every row of parameters (N, np) into ``raw``, recording outputs ``rows``."""
        job, _keep = make_job(self.kernel, p, grid, raw, rows, stop)
        if self.loops.run("rollouts", job) < 0:
            raise CompileError(f"no memory for {self.lanes} rollouts at once")


def make_job(
    kernel: Kernel, p: Array, grid: TimeGrid, raw: RolloutArrays, rows: Sequence[int], stop: StopFlag
) -> tuple[_EngineCall, list[Any]]:
    """The structure that the loops read, and the arrays that must outlive the call."""
    parameters = np.ascontiguousarray(p, dtype=float)
    row = np.ascontiguousarray(rows, dtype=np.int64)
    noise = np.ascontiguousarray(kernel.noise.drawn(parameters))
    keep: list[Any] = [parameters, row, kernel.scale, raw, stop, noise]

    def address(array: npt.NDArray[Any] | None) -> int | None:
        return None if array is None else array.ctypes.data

    job = _EngineCall(
        len(parameters),
        grid.intervals,
        grid.every,
        grid.step_s,
        grid.finer,
        address(parameters),
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
        address(raw.status),
        raw.log.event.shape[1],
        address(raw.log.fired),
        address(raw.log.event),
        address(raw.log.when),
        address(raw.log.jump),
        address(raw.log.gradient_warning),
        raw.backwards,
        grid.locates_peaks,
        stop.address,
    )
    return job, keep
