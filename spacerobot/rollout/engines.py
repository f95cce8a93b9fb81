"""Two ways to evaluate a kernel over rows of parameters: compiled, and interpreted by CasADi."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any, Protocol

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.compiled import Library, Toolchain, compile_functions
from spacerobot.rollout.closure import Closure
from spacerobot.rollout.grid import INWARD, TimeGrid
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
        Steps before divergence, shape (N,); -1 for a rollout that did not run.
    gaps
        Initial gaps of grasps that may begin open (N, n) [m].
    """

    x: Array | None
    y: Array | None
    r: Array
    cost: Array
    done: npt.NDArray[np.int64]
    gaps: Array

    @classmethod
    def empty(cls, kernel: Kernel, grid: TimeGrid, count: int, states: bool, rows: Sequence[int]) -> Raw:
        """Arrays full of NaN for so many rollouts."""
        samples = grid.intervals + 1
        nx, nr, nj = kernel.nx + kernel.integrals, kernel.size("objective", "r"), len(kernel.costs)
        return cls(
            np.full((count, samples, nx), np.nan) if states else None,
            np.full((count, samples, len(rows)), np.nan) if len(rows) else None,
            np.full((count, nr), np.nan),
            np.full((count, nj), np.nan),
            np.full(count, -1, dtype=np.int64),
            np.full((count, len(kernel.closure.largest)), np.nan),
        )

    def part(self, rows: slice) -> Raw:
        """View of some rollouts."""
        x = None if self.x is None else self.x[rows]
        y = None if self.y is None else self.y[rows]
        return Raw(x, y, self.r[rows], self.cost[rows], self.done[rows], self.gaps[rows])

    def judge_start(self, closure: Closure, p: Array) -> None:
        """Note the gaps of rollouts of p (N, np); of one that begins open only its initial state is left."""
        self.gaps[:] = closure.measure(p)
        lost = closure.is_open(self.gaps) & (self.done >= 0)
        self.done[lost], self.r[lost], self.cost[lost] = 0, np.nan, np.nan
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
        ("steps", ctypes.c_int64),
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
    defines = [f"#define INTEGRALS {kernel.integrals}", f"#define PEAKS {kernel.peaks}"]
    if adjoint:
        defines.append("#define ADJOINT")
    tail = "\n".join([*defines, loops])
    cold = set(kernel.functions) - HOT
    return compile_functions(
        kernel.functions, lanes=lanes, cold=cold, tail=tail, toolchain=toolchain, progress=progress
    )


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
        grid.steps,
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
        address(raw.done),
        stop.address,
    )
    return job, keep


BLOCK = 64  # steps that CasADi's virtual machine does between two looks from Python


@dataclass(frozen=True)
class InterpretedEngine:
    """CasADi's virtual machine, one rollout after the other: the same steps where there is no compiler."""

    kernel: Kernel
    backend: str = field(default="interpreted", init=False)
    lanes: int = field(default=1, init=False)

    def rollouts(self, p: Array, grid: TimeGrid, raw: Raw, rows: Sequence[int], stop: StopFlag) -> None:
        """Roll out every row of parameters; see :class:`Engine`."""
        for i, row in enumerate(p):
            if stop.is_set:
                return
            self._one(row, grid, raw.part(slice(i, i + 1)), rows)

    def course(self, p: Array, grid: TimeGrid) -> tuple[Array, Array, Array, int]:
        """Prepared constants, states (steps + 1, nx), peak quantities (steps + 1, nm) and the steps done."""
        kernel = self.kernel
        x, c = (part.full().ravel() for part in kernel.functions["setup"](p))
        states, peaks, done = [x[None, :]], [], 0
        block = grid.every * max(1, BLOCK // grid.every)
        for k in range(0, grid.steps, block):
            n = min(block, grid.steps - k)
            index = np.arange(k, k + n)[None, :]
            path, m = (part.full().T for part in self._steps(n)(states[-1][-1], index, grid.step_s, c))
            with np.errstate(over="ignore", invalid="ignore"):
                good = np.sum((path * kernel.scale) ** 2, axis=1) < 1  # false for a NaN as well
            first_bad = n if good.all() else int(np.argmin(good))
            done += first_bad
            states.append(path[:first_bad])
            peaks.append(m)
            if first_bad < n:
                break
        visited = np.concatenate(states)
        last = kernel.functions["dynamics"]((done - INWARD) * grid.step_s, visited[-1], c)[1].full().T
        return c, visited, np.concatenate([*peaks, last])[: done + 1], done

    def _one(self, p: Array, grid: TimeGrid, raw: Raw, rows: Sequence[int]) -> None:
        kernel = self.kernel
        c, x, m, done = self.course(p, grid)
        sampled = x[:: grid.every]
        if raw.x is not None:
            raw.x[0, : len(sampled)] = sampled
        if raw.y is not None:
            time = grid.time[None, : len(sampled)] - INWARD * grid.step_s
            raw.y[0, : len(sampled)] = kernel.functions["outputs"](time, sampled.T, c).full().T[:, list(rows)]
        raw.done[0] = done
        if done == grid.steps:
            raw.r[0] = self.reduce(c, x, m, grid)
        raw.cost[0] = kernel.functions["objective"](raw.r[0], p).full().ravel()

    def reduce(self, c: Array, x: Array, m: Array, grid: TimeGrid) -> Array:
        """Measures r of a completed rollout."""
        e = self.kernel.functions["final"]((grid.steps - INWARD) * grid.step_s, x[-1], c).full().ravel()
        return np.concatenate([x[-1, self.kernel.nx :], self._winners(m), e])

    def _winners(self, m: Array) -> Array:
        """Largest values of the first rows of m, and what goes along with them."""
        peaks = self.kernel.peaks
        if peaks == 0:
            return np.empty(0)
        when = m[:, :peaks].argmax(axis=0)
        return np.concatenate([m[when, b + np.arange(peaks)] for b in range(0, m.shape[1], peaks)])

    @functools.cached_property
    def _step(self) -> ca.Function:
        f, nx, nc = self.kernel.functions["dynamics"], self.kernel.scale.size, self.kernel.size("setup", "c")
        x, k, h, c = ca.MX.sym("x", nx), ca.MX.sym("k"), ca.MX.sym("h"), ca.MX.sym("c", nc)
        k1, m = f((k + INWARD) * h, x, c)
        k2, _ = f((k + 0.5) * h, x + h / 2 * k1, c)
        k3, _ = f((k + 0.5) * h, x + h / 2 * k2, c)
        k4, _ = f((k + 1 - INWARD) * h, x + h * k3, c)
        y = self.kernel.functions["normalise"](x + h / 6 * k1 + h / 3 * k2 + h / 3 * k3 + h / 6 * k4)
        return ca.Function("step", [x, k, h, c], [y, m], ["x", "k", "h", "c"], ["next", "m"])

    def _steps(self, n: int) -> ca.Function:
        made: dict[int, ca.Function] = self.__dict__.setdefault("_made", {})
        if n not in made:
            made[n] = self._step.mapaccum("steps", n)
        return made[n]
