"""A closed loop made ready to run: once, many times, and differentiated."""

from __future__ import annotations

import functools
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from spacerobot.compiled import Toolchain, find_toolchain
from spacerobot.errors import CompileError, SpaceRobotError, near_names
from spacerobot.rollout.batch import Progress, Stop, run_batch
from spacerobot.rollout.engines import (
    CompiledEngine,
    Engine,
    InterpretedEngine,
    Raw,
    StopFlag,
    compile_kernel,
)
from spacerobot.rollout.grid import TimeGrid, time_grid
from spacerobot.rollout.kernel import Kernel, build_kernel
from spacerobot.rollout.measures import Measures
from spacerobot.rollout.protocol import Array, ClosedLoopFunctions
from spacerobot.rollout.trajectory import Batch, Status, Trajectory, frozen

Backend = Literal["auto", "compiled", "interpreted"]
Parameters = Mapping[str, float] | npt.ArrayLike | None


@dataclass(frozen=True)
class Rollout:
    """A closed loop, its measures and a time grid, built and ready.

    Attributes
    ----------
    loop
        The closed loop.
    kernel
        The functions that are evaluated.
    grid
        Steps and samples.
    engine
        What evaluates a single rollout.
    toolchain
        Compiler for what is compiled later (batches, gradients); None if interpreted.
    fallback
        Why it is interpreted although a compiler was found; empty otherwise.
    """

    loop: ClosedLoopFunctions
    kernel: Kernel
    grid: TimeGrid
    engine: Engine
    toolchain: Toolchain | None
    fallback: str = ""

    @property
    def backend(self) -> str:
        """``compiled`` or ``interpreted``."""
        return self.engine.backend

    @property
    def summary(self) -> str:
        """One line that says what runs."""
        steps = f"{self.grid.steps} steps of {self.grid.step_s:.6g} s"
        interpreted = "interpreted by CasADi" + (f" ({self.fallback})" if self.fallback else "")
        return f"{steps}, {self.toolchain.summary if self.toolchain else interpreted}"

    @functools.cached_property
    def batch_engine(self) -> Engine:
        """What evaluates batches: the same source compiled over lanes, at the first use."""
        if self.toolchain is None:
            return self.engine
        return CompiledEngine(self.kernel, compile_kernel(self.kernel, self.toolchain.lanes, self.toolchain))

    def values(self, parameters: Parameters = None) -> Array:
        """All parameter values p, shape (np,).

        Parameters
        ----------
        parameters
            Values by dotted path (the others stay nominal), or all of them in order, or None.

        Raises
        ------
        SpaceRobotError
            A path does not exist, or the number of values is wrong.
        """
        if parameters is None:
            return np.array(self.loop.parameter_values, dtype=float)
        if isinstance(parameters, Mapping):
            values = np.array(self.loop.parameter_values, dtype=float)
            values[self.indices(tuple(parameters))] = list(parameters.values())
            return values
        values = np.array(parameters, dtype=float)
        if values.shape != (len(self.loop.parameter_paths),):
            raise SpaceRobotError(
                f"parameters of shape {values.shape}, allowed: ({len(self.loop.parameter_paths)},)"
            )
        return values

    def indices(self, paths: Sequence[str]) -> list[int]:
        """Places of parameters in p.

        Raises
        ------
        SpaceRobotError
            A path does not exist.
        """
        place = {path: i for i, path in enumerate(self.loop.parameter_paths)}
        for path in paths:
            if path not in place:
                raise SpaceRobotError(f"no parameter '{path}', {near_names(path, place)}")
        return [place[path] for path in paths]

    def rows(self, paths: Sequence[str], values: npt.ArrayLike) -> Array:
        """Full parameter rows (N, np) from values (N, k) of k parameters; the others stay nominal."""
        given = np.atleast_2d(np.asarray(values, dtype=float))
        if given.ndim != 2 or given.shape[1] != len(paths):
            raise SpaceRobotError(f"values of shape {given.shape}, allowed: (N, {len(paths)})")
        p = np.tile(self.values(), (len(given), 1))
        p[:, self.indices(paths)] = given
        return p

    def run(self, parameters: Parameters = None) -> Trajectory:
        """One rollout.

        Parameters
        ----------
        parameters
            As for :meth:`values`.

        Returns
        -------
        Trajectory
            Cut short, with status ``diverged``, where a state leaves its bounds or is no number.
        """
        begin = time.perf_counter()
        p = self.values(parameters)
        outputs = range(self.kernel.size("outputs", "y"))
        raw = Raw.empty(self.kernel, self.grid, 1, True, outputs)
        self.engine.rollouts(p[None, :], self.grid, raw, outputs, StopFlag())
        return self._trajectory(raw, time.perf_counter() - begin)

    def batch(
        self,
        paths: Sequence[str],
        values: npt.ArrayLike,
        *,
        outputs: Sequence[str] = (),
        states: bool = False,
        threads: int | None = None,
        progress: Progress | None = None,
        stop: Stop | None = None,
    ) -> Batch:
        """Many rollouts; costs and measures always, samples only where asked for.

        Parameters
        ----------
        paths
            Parameters that vary, k of them.
        values
            Their values, shape (N, k).
        outputs
            Names of outputs to sample.
        states
            Whether to sample the states.
        threads
            How many; one for each usable core if None. Results do not depend on it, not even by a bit.
        progress
            Called now and then with what is done; the batch is cancelled if it returns False.
        stop
            Event (``threading.Event``) that cancels the batch when set.

        Raises
        ------
        SpaceRobotError
            A path or an output does not exist, or a shape is wrong.
        """
        p = self.rows(paths, values)
        known = self.kernel.outputs
        for name in outputs:
            if name not in known:
                raise SpaceRobotError(f"no output '{name}', {near_names(name, known)}")
        rows = [i for name in outputs for i in range(known[name].start, known[name].stop)]
        done = run_batch(self.batch_engine, self.kernel, self.grid, p, rows, states, threads, progress, stop)
        return self._batch(done.raw, outputs, done.threads, done.wall_s)

    def _trajectory(self, raw: Raw, wall_s: float) -> Trajectory:
        done = int(raw.done[0])
        status: Status = "completed" if done == self.grid.steps else "diverged"
        samples = done // self.grid.every + 1
        state = np.empty((0, 0)) if raw.x is None else raw.x[0, :samples, : self.kernel.nx]
        y = np.empty((samples, 0)) if raw.y is None else raw.y[0, :samples]
        return Trajectory(
            time=frozen(self.grid.time[:samples]),
            state=frozen(state),
            outputs={name: frozen(y[:, where]) for name, where in self.kernel.outputs.items()},
            measures={name: frozen(raw.r[0, where]) for name, where in self.kernel.measures.items()},
            costs={name: float(value) for name, value in zip(self.kernel.costs, raw.cost[0], strict=True)},
            status=status,
            diverged_at_s=None if status == "completed" else done * self.grid.step_s,
            steps=done,
            step_s=self.grid.step_s,
            backend=self.backend,
            wall_s=wall_s,
        )

    def _batch(self, raw: Raw, outputs: Sequence[str], threads: int, wall_s: float) -> Batch:
        ran = raw.done >= 0
        lost = ran & (raw.done < self.grid.steps)
        sizes = [self.kernel.outputs[name].stop - self.kernel.outputs[name].start for name in outputs]
        ends = np.cumsum([0, *sizes])
        y = np.empty((len(raw.done), 0, 0)) if raw.y is None else raw.y
        return Batch(
            costs={name: frozen(raw.cost[:, i]) for i, name in enumerate(self.kernel.costs)},
            measures={name: frozen(raw.r[:, where]) for name, where in self.kernel.measures.items()},
            diverged_at_s=frozen(np.where(lost, raw.done * self.grid.step_s, np.nan)),
            done=ran,
            time=frozen(self.grid.time),
            outputs={name: frozen(y[:, :, a:b]) for name, a, b in zip(outputs, ends, ends[1:], strict=False)},
            state=None if raw.x is None else frozen(raw.x[:, :, : self.kernel.nx]),
            backend=self.batch_engine.backend,
            lanes=self.batch_engine.lanes,
            threads=threads,
            wall_s=wall_s,
        )


def build_rollout(
    loop: ClosedLoopFunctions,
    *,
    duration_s: float,
    step_s: float,
    output_step_s: float | None = None,
    measures: Measures | None = None,
    backend: Backend = "auto",
) -> Rollout:
    """Make a closed loop ready to run: slow the first time (it compiles), quick from the cache.

    Parameters
    ----------
    loop
        The closed loop.
    duration_s
        Duration.
    step_s
        Longest step; it is taken a little shorter where it does not divide the output step.
    output_step_s
        Longest time between samples; each step is a sample if None.
    measures
        What to reduce each rollout to.
    backend
        ``auto`` compiles where a compiler is found and works, and interprets elsewhere.

    Raises
    ------
    CompileError
        ``backend`` is ``compiled`` and cannot be had.
    SpaceRobotError
        A duration or a step is not positive.
    """
    grid = time_grid(duration_s, step_s, output_step_s)
    kernel = build_kernel(loop, measures)
    if backend not in ("auto", "compiled", "interpreted"):
        raise SpaceRobotError(f"backend '{backend}', allowed: auto, compiled, interpreted")
    toolchain, fallback = None if backend == "interpreted" else find_toolchain(), ""
    if backend == "compiled" or toolchain is not None:
        try:
            engine = CompiledEngine(kernel, compile_kernel(kernel, 1, toolchain))
            return Rollout(loop, kernel, grid, engine, engine.library.toolchain)
        except CompileError as error:
            if backend == "compiled":
                raise
            fallback = error.message
    return Rollout(loop, kernel, grid, InterpretedEngine(kernel), None, fallback)
