"""Closed loop prepared for rollouts: single ones, batches and derivatives."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
import numpy.typing as npt

from spacerobot.common.errors import SpaceRobotError, near_names
from spacerobot.common.tables import Table
from spacerobot.common.tabular import Tabular
from spacerobot.rollout.assemble import batch_of, gradient_of, split, statuses, trajectory_of
from spacerobot.rollout.batch import Control, Controls, Samples, run_batch, run_gradients, run_one
from spacerobot.rollout.closed_loop_protocol import Array, ClosedLoopFunctions
from spacerobot.rollout.engine_factory import Engines
from spacerobot.rollout.gradient_accuracy import inaccurate
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.sensitivity import DERIVATIVE
from spacerobot.rollout.step_choice import StepChoice, search_step
from spacerobot.rollout.time_grid import TimeGrid, time_grid
from spacerobot.rollout.trajectory import Batch, Gradient, Jacobian, Slopes, Trajectory, frozen

TOLERANCE = 1e-6
UNCHECKED = "unchecked"
"""Status of derivatives that were not compared with those of half the step."""
Parameters = Mapping[str, float] | npt.ArrayLike | None


@dataclass(frozen=True)
class Rollout(Tabular):
    """Closed loop, measures and time grid, ready to run.

    Engines of batches, gradients and Jacobians are compiled on the first call and then read from the cache.

    Attributes:
        loop: The closed loop.
        kernel: Functions of a rollout.
        grid: Steps and samples.
        engines: Engines that evaluate the functions.
        choice: Result of the automatic choice of the step, or None.
    """

    loop: ClosedLoopFunctions
    kernel: Kernel
    grid: TimeGrid
    engines: Engines
    choice: StepChoice | None = None

    def __repr__(self) -> str:
        """One-line description of the rollout."""
        return f"<Rollout of {self.grid.duration_s:g} s: {self.summary}>"

    def content(self) -> list[Table]:
        """Table of the settings."""
        return [Table.of_pairs(f"Rollout of {self.grid.duration_s:g} s", [("runs", self.summary)])]

    @property
    def continuous(self) -> Rollout:
        """The rollout itself, which no update interrupts."""
        return self

    @property
    def backend(self) -> str:
        """``compiled`` or ``interpreted``."""
        return self.engines.single.backend

    @property
    def summary(self) -> str:
        """One-line description of steps, method and backend."""
        steps = f"{self.grid.steps} steps of {self.grid.step_s:.6g} s by {self.kernel.method.name}"
        if self.backend == "compiled" and self.engines.toolchain is not None:
            return f"{steps}, compiled: {self.engines.toolchain.summary}"
        return f"{steps}, interpreted" + (f" ({self.fallback})" if self.fallback else "")

    @property
    def fallback(self) -> str:
        """Reason why the rollout is interpreted although it should be compiled; empty otherwise."""
        return self.engines.fallback

    def choose_step(
        self,
        tolerance: float = TOLERANCE,
        parameters: Parameters = None,
        progress: Callable[[str], None] | None = None,
    ) -> StepChoice:
        """Largest step whose error is within a tolerance at given parameter values; nothing is recompiled.

        Args:
            tolerance, parameters, progress: See :func:`choose_step`; progress is called before each pilot
                rollout.

        Raises:
            DivergedError: No step meets the tolerance.
        """
        p, grid = self.values(parameters), self.grid
        sample_s = grid.every * grid.step_s

        def pilot(step_s: float) -> Trajectory:
            pilot_grid = time_grid(grid.duration_s, step_s, sample_s)
            self.engines.expect(pilot_grid.steps)
            return replace(self, grid=pilot_grid).run(p, estimate=True)

        order = self.kernel.method.order
        return search_step(pilot, grid.duration_s, sample_s, tolerance, order, progress)

    def values(self, parameters: Parameters = None) -> Array:
        """All parameter values p, shape (np,).

        Args:
            parameters: Values by dotted path (others stay nominal), or all of them in order, or None for
                nominal.

        Raises:
            SpaceRobotError: A path does not exist, or the number of values is wrong.
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
        """Indices of parameters in p.

        Raises:
            SpaceRobotError: A path does not exist, or is named twice.
        """
        place = {path: i for i, path in enumerate(self.loop.parameter_paths)}
        for path in paths:
            if path not in place:
                raise SpaceRobotError(f"no parameter '{path}', {near_names(path, place)}")
        for path, count in Counter(paths).items():
            if count > 1:
                raise SpaceRobotError(f"parameter '{path}' is named {count} times, allowed: once")
        return [place[path] for path in paths]

    def rows(self, paths: Sequence[str], values: npt.ArrayLike) -> Array:
        """Full parameter rows; parameters that are not named stay nominal.

        Args:
            paths: Dotted paths of k parameters.
            values: Their values, (N, k).

        Returns:
            numpy.ndarray: (N, np).

        Raises:
            SpaceRobotError: If a path is unknown or named twice, or ``values`` has another shape.
        """
        return self._filled(self.indices(paths), self._changes(paths, values))

    def _changes(self, paths: Sequence[str], values: npt.ArrayLike) -> Array:
        """Values (N, k) of k parameters, their shape checked."""
        rows = np.atleast_2d(np.asarray(values, dtype=float))
        if rows.ndim != 2 or rows.shape[1] != len(paths):
            raise SpaceRobotError(f"values of shape {rows.shape}, allowed: (N, {len(paths)})")
        return rows

    def _filled(self, places: Sequence[int], columns: Array) -> Array:
        """Full rows (N, np) of parameters with values (N, k) in some places, nominal elsewhere."""
        p = np.tile(self.values(), (len(columns), 1))
        p[:, places] = columns
        return p

    def run(self, parameters: Parameters = None, *, estimate: bool = False) -> Trajectory:
        """Trajectory of a single rollout.

        Args:
            parameters: Parameter values; see :meth:`values`.
            estimate: Whether the error of each step is estimated.

        Returns:
            Trajectory: Ends early, with status ``diverged``, where a state leaves its bounds or is not
                finite. Only the initial state, with status ``unclosed``, if a grasp does not close.
        """
        begin = time.perf_counter()
        p = self.values(parameters)
        raw = run_one(self.engines.single, self.grid, p, estimate)
        trajectory = trajectory_of(raw, self.kernel, self.grid, p)
        return replace(trajectory, backend=self.backend, wall_s=time.perf_counter() - begin)

    def batch(
        self,
        paths: Sequence[str],
        values: npt.ArrayLike,
        *,
        outputs: Sequence[str] = (),
        states: bool = False,
        **control: Unpack[Controls],
    ) -> Batch:
        """Batch of rollouts: costs and measures, and samples of outputs and states on request.

        Args:
            paths: Parameters that vary, k of them.
            values: Their values, shape (N, k).
            outputs: Names of outputs to sample.
            states: Whether to sample the states.
            **control: ``threads``, ``progress`` and ``stop``; see
                :class:`~spacerobot.rollout.batch.Control`.

        Raises:
            SpaceRobotError: A path or an output does not exist, or a shape is wrong.
        """
        changes, places = self._changes(paths, values), self.indices(paths)
        engine, rows = self.engines.batch, self._output_rows(outputs)

        def p(piece: slice) -> Array:
            return self._filled(places, changes[piece])

        rollouts = run_batch(engine, self.grid, p, len(changes), Samples(rows, states), Control(**control))
        return batch_of(rollouts.raw, engine, self.grid, outputs, rollouts.threads, rollouts.wall_s)

    def value_and_gradient(
        self,
        parameters: Parameters = None,
        *,
        wrt: Sequence[str],
        costs: Sequence[str] | None = None,
        orders: bool = True,
        accuracy: bool | None = None,
        compared: Collection[str] | None = None,
    ) -> Gradient:
        """Costs of one rollout and their exact gradients, by the discrete adjoint.

        The run time hardly depends on the number of parameters. The first call for a set of parameters
        compiles.

        Args:
            parameters: Parameter values; see :meth:`values`.
            wrt: Paths of the k parameters to differentiate with respect to.
            costs: Names of the costs; all if None.
            orders, accuracy, compared: Derivative checks; see :class:`~spacerobot.rollout.batch.Control`.

        Raises:
            SpaceRobotError: A path or a cost does not exist, or there is no cost.
        """
        control = Control(orders=orders, accuracy=accuracy, compared=compared)
        row = self._gradients(self.values(parameters)[None, :], tuple(wrt), costs, False, control)
        return replace(
            row,
            costs={name: value[0] for name, value in row.costs.items()},
            gradients={name: value[0] for name, value in row.gradients.items()},
            measures={name: value[0] for name, value in row.measures.items()},
            diverged_at_s=row.diverged_at_s[0],
            gaps={name: value[0] for name, value in row.gaps.items()},
        )

    def gradient_batch(
        self,
        paths: Sequence[str],
        values: npt.ArrayLike,
        *,
        wrt: Sequence[str] | None = None,
        costs: Sequence[str] | None = None,
        **control: Unpack[Controls],
    ) -> Gradient:
        """Costs and gradients of many rollouts, in lanes and threads; for searches with several starts.

        Args:
            paths, values, **control: As for :meth:`batch`.
            wrt, costs: As for :meth:`value_and_gradient`; ``wrt`` is ``paths`` if None.
        """
        p = self.rows(paths, values)
        return self._gradients(p, tuple(wrt or paths), costs, True, Control(**control))

    def pullback(
        self, paths: Sequence[str], values: npt.ArrayLike, weights: npt.ArrayLike, threads: int | None = None
    ) -> Array:
        """Gradients of weighted sums of the costs of many rollouts, one backward sweep for each rollout.

        Args:
            paths: Dotted paths of k parameters.
            values: Their values (N, k).
            weights: Weight of each cost in each rollout (N, number of costs).
            threads: Number of threads; one for each usable core if None.

        Returns:
            numpy.ndarray: Gradients (N, k), NaN where a rollout diverged; not compared with those of half the
                step.

        Raises:
            SpaceRobotError: If a path does not exist, or a shape is wrong.
        """
        p, seed = self.rows(paths, values), np.atleast_2d(np.asarray(weights, dtype=float))
        if seed.shape != (len(p), len(self.kernel.costs)):
            raise SpaceRobotError(
                f"weights of shape {seed.shape}, allowed: ({len(p)}, {len(self.kernel.costs)})"
            )
        engine = self.engines.adjoint(tuple(self.indices(paths)), many=True)
        return run_gradients(engine, self.grid, p, seed, Control(threads=threads, orders=False))[1]

    def jacobian(
        self,
        parameters: Parameters = None,
        *,
        wrt: Sequence[str],
        outputs: Sequence[str] = (),
        orders: bool = True,
        accuracy: bool | None = None,
    ) -> Jacobian:
        """Rollout with exact derivatives of its measures and sampled outputs, by forward sensitivities.

        Args:
            parameters, wrt, orders, accuracy: See :meth:`value_and_gradient`.
            outputs: Names of outputs whose derivatives are sampled.

        Raises:
            SpaceRobotError: A path or an output does not exist.
        """
        begin = time.perf_counter()
        trajectory, p = self.run(parameters), self.values(parameters)
        self._output_rows(outputs)
        engine = self.engines.sensitivity(tuple(self.indices(wrt)), tuple(outputs))
        rows = range(engine.kernel.size("outputs", "y"))
        directions = np.hstack([np.tile(p, (len(wrt), 1)), np.eye(len(wrt))])
        samples, control = Samples(rows), Control(orders=orders, accuracy=accuracy)
        raw = run_batch(engine, self.grid, directions.__getitem__, len(wrt), samples, control).raw
        blocks, measure_slices = split(raw, engine.kernel, self.grid, outputs), engine.kernel.measures
        result = Jacobian(
            paths=tuple(wrt),
            trajectory=trajectory,
            measures={
                name: frozen(raw.r[:, measure_slices[DERIVATIVE + name]].T) for name in self.kernel.measures
            },
            outputs={name: frozen(np.moveaxis(blocks[name], 0, -1)) for name in outputs},
            wall_s=time.perf_counter() - begin,
            status=statuses(raw, engine.kernel, len(wrt))[0] if wrt else "exact",
        )
        if not (wrt and result.status == "exact"):
            return result
        if not control.halves:
            return replace(result, status=UNCHECKED)
        finer = self._reference.jacobian(parameters, wrt=wrt, outputs=outputs, orders=False)
        values = {**trajectory.measures, **{name: trajectory.outputs[name] for name in outputs}}
        derivatives, finer_derivatives = (
            {**result.measures, **result.outputs},
            {**finer.measures, **finer.outputs},
        )
        gradient_warning = inaccurate(derivatives, finer_derivatives, values, p[self.indices(wrt)], wrt)
        return replace(result, status=gradient_warning or "exact", wall_s=time.perf_counter() - begin)

    def slope_batch(
        self,
        paths: Sequence[str],
        values: npt.ArrayLike,
        *,
        wrt: Sequence[str] | None = None,
        **control: Unpack[Controls],
    ) -> Slopes:
        """Measures of many rollouts and their exact derivatives by forward sensitivities, in full SIMD lanes.

        Args:
            paths, values, **control: See :meth:`batch`.
            wrt: Paths of the k parameters to differentiate with respect to; ``paths`` if None.

        Raises:
            SpaceRobotError: A path does not exist, or a shape is wrong.
        """
        begin, p, wrt = time.perf_counter(), self.rows(paths, values), tuple(wrt or paths)
        engine = self.engines.sensitivity(tuple(self.indices(wrt)), ())
        k = len(wrt)

        def directions(piece: slice) -> Array:
            row, direction = np.divmod(np.arange(piece.start, piece.stop), k)
            return np.hstack([p[row], np.eye(k)[direction]])

        batch = run_batch(engine, self.grid, directions, k * len(p), Samples(), Control(**control))
        r = batch.raw.r.reshape(len(p), k, -1)
        names, measure_slices = tuple(self.kernel.measures), engine.kernel.measures
        result = Slopes(
            paths=wrt,
            measures={n: frozen(r[:, 0, measure_slices[n]].copy()) for n in names},
            slopes={
                n: frozen(np.moveaxis(r[:, :, measure_slices[DERIVATIVE + n]], 1, 2).copy()) for n in names
            },
            unclosed=self.kernel.closure.messages(batch.raw.gaps[::k]),
            wall_s=time.perf_counter() - begin,
            status=statuses(batch.raw, engine.kernel, k),
        )

        def again(rows: list[int], quiet: Controls) -> Mapping[str, Array]:
            return self._reference.slope_batch(self.loop.parameter_paths, p[rows], wrt=wrt, **quiet).slopes

        status = self._checked(
            result.status, p, wrt, (result.slopes, result.measures), again, Control(**control)
        )
        return replace(result, status=status, wall_s=time.perf_counter() - begin)

    @property
    def _reference(self) -> Rollout:
        """Rollout that derivatives are compared with: steps of half the length, peaks between steps."""
        return replace(self, grid=replace(self.grid.halved, locates_peaks=True))

    def _checked(
        self,
        status: Sequence[str],
        p: Array,
        wrt: Sequence[str],
        allowed: tuple[Mapping[str, Array], Mapping[str, Array]],
        again: Callable[[list[int], Controls], Mapping[str, Array]],
        control: Control,
    ) -> tuple[str, ...]:
        """Gradient status of the rollouts of p (N, np), after comparison with derivatives at half the step.

        ``allowed`` are derivatives (N, ..., k) and differentiated values (N, ...), by name; ``again``
        computes the derivatives of given rows with half the step.
        """
        statuses_by_row = list(status)
        rows = [i for i, one in enumerate(status) if one == "exact"]
        if not control.halves or (control.stop is not None and control.stop.is_set()):
            return tuple(UNCHECKED if one == "exact" else one for one in status)
        finer = (
            again(rows, {"threads": control.threads, "stop": control.stop, "orders": False}) if rows else {}
        )
        slopes, values = allowed
        columns = [i for i, path in enumerate(wrt) if control.compared is None or path in control.compared]
        paths = [wrt[i] for i in columns]
        for k, row in enumerate(rows):
            coarse, fine = (
                {name: part[i][..., columns] for name, part in one.items()}
                for one, i in ((slopes, row), (finer, k))
            )
            sizes = {name: values[name][row] for name in slopes}
            reason = inaccurate(coarse, fine, sizes, p[row, self.indices(paths)], paths) if paths else ""
            statuses_by_row[row] = reason or "exact"
        return tuple(statuses_by_row)

    def _gradients(
        self,
        p: Array,
        wrt: tuple[str, ...],
        costs: Sequence[str] | None,
        many: bool,
        control: Control,
    ) -> Gradient:
        """Gradient with one row for each parameter set and cost."""
        begin = time.perf_counter()
        names = tuple(self.kernel.costs if costs is None else costs)
        for name in names:
            if name not in self.kernel.costs:
                raise SpaceRobotError(f"no cost '{name}', {near_names(name, self.kernel.costs)}")
        if not names:
            raise SpaceRobotError("this rollout was built without a cost to differentiate")
        engine = self.engines.adjoint(tuple(self.indices(wrt)), many=many)
        rows = np.repeat(p, len(names), axis=0)
        weights = np.eye(len(self.kernel.costs))[[self.kernel.costs.index(name) for name in names]]
        seed = np.tile(weights, (len(p), 1))
        raw, gradient = run_gradients(engine, self.grid, rows, seed, control)
        result = gradient_of(raw, gradient, self.kernel, wrt, names)

        def again(rows: list[int], quiet: Controls) -> Mapping[str, Array]:
            return self._reference._gradients(p[rows], wrt, names, many, Control(**quiet)).gradients

        status = self._checked(result.status, p, wrt, (result.gradients, result.costs), again, control)
        result = replace(result, status=status)
        return replace(result, backend=engine.backend, wall_s=time.perf_counter() - begin)

    def _output_rows(self, outputs: Sequence[str]) -> list[int]:
        """Indices in y of named outputs."""
        places = self.kernel.outputs
        for name in outputs:
            if name not in places:
                raise SpaceRobotError(f"no output '{name}', {near_names(name, places)}")
        return [i for name in outputs for i in range(places[name].start, places[name].stop)]
