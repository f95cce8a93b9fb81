"""Batches of simulations whose controllers are updated in Python, rolled out together between updates."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
import numpy.typing as npt

from spacerobot.closedloop import ClosedLoop, OutputVariable
from spacerobot.common.arrays import Array
from spacerobot.compiled import usable_cores
from spacerobot.rollout import Batch, Measures, Rollout, build_rollout, final, time_grid
from spacerobot.rollout.batch import Controls
from spacerobot.rollout.resumable_loop import STATE, resumed, resumed_measures
from spacerobot.updates.plant import ROUNDING, Ends, Inputs, Rows, input_variables
from spacerobot.updates.scheme import UpdatedScene, run_updates


class UpdatedRollout:
    """Rollouts of a closed loop with controllers updated in Python.

    In batches and campaigns, it replaces a :class:`spacerobot.rollout.Rollout`.

    Args:
        updated, loop: The scene with its schemes, and its closed loop.
        extended: The closed loop extended by states for the measures.
        measures: Measures of the signals of ``extended``.
        **options: Options of :func:`spacerobot.rollout.build_rollout`.

    Raises:
        ScenarioError: If a scheme controls single simulations only.
    """

    def __init__(
        self, updated: UpdatedScene, loop: ClosedLoop, extended: Any, measures: Measures, **options: Any
    ) -> None:
        for scheme in updated.schemes:
            scheme.check_batch()
        self.updated, self.variables = updated, loop.variables
        self.loop, self.measures = extended, measures
        inputs = {one.name: final(measures.signals[one.name]) for one in input_variables(loop.variables)}
        pieces = dataclasses.replace(measures, named={**measures.named, **inputs})
        if options.get("rollouts") is not None:
            options["rollouts"] *= 1 + updated.prediction_s / updated.duration_s
        self.rollout = build_rollout(
            resumed(extended), measures=resumed_measures(extended, pieces), **options
        )

    @property
    def continuous(self) -> Rollout:
        """Rollout between two updates."""
        return self.rollout

    @property
    def kernel(self) -> Any:
        """Compiled or interpreted functions of the rollout between updates."""
        return self.rollout.kernel

    @property
    def summary(self) -> str:
        """Backend of the rollout and schemes of the updates, in one line."""
        return "; ".join([self.rollout.summary, *(scheme.summary for scheme in self.updated.schemes)])

    def values(self) -> Array:
        """Nominal parameters (np,)."""
        return np.array(self.loop.parameter_values, dtype=float)

    def batch(
        self,
        paths: Sequence[str],
        values: npt.ArrayLike,
        *,
        outputs: Sequence[str] = (),
        **control: Unpack[Controls],
    ) -> Batch:
        """Batch of rollouts; arguments and errors as for :meth:`spacerobot.rollout.Rollout.batch`.

        The measures include the statistics of the schemes.
        """
        began = time.perf_counter()
        rows = np.asarray(values, dtype=float).reshape(-1, len(paths))
        plant = LanePlant(self, self.rollout.rows(paths, rows)[:, : len(self.values())], outputs, control)
        count = max(1, min(control.get("threads") or usable_cores(), len(rows)))
        updates = [scheme.start(plant, count, "auto", lambda _: None) for scheme in self.updated.schemes]
        run_updates(plant, updates, self.updated.duration_s)
        uncontrolled = [any(each.faults[row] for each in updates) for row in range(len(rows))]
        plant.diverged_at[uncontrolled] = 0.0
        for array in (*plant.measures.values(), *plant.outputs.values()):
            array[np.isfinite(plant.diverged_at)] = np.nan
        statistics = {name: value for each in updates for name, value in each.measures().items()}
        batch = self.rollout.engines.batch
        return Batch(
            costs={},
            measures=plant.measures | statistics,
            diverged_at_s=plant.diverged_at,
            unclosed=plant.unclosed,
            gaps=plant.gaps,
            done=plant.done,
            time=plant.time,
            outputs=plant.outputs,
            state=None,
            backend=batch.backend,
            lanes=batch.lanes,
            threads=count,
            wall_s=time.perf_counter() - began,
        )


class LanePlant:
    """N simulations in segments between updates; see :class:`spacerobot.updates.plant.UpdatedPlant`.

    Args:
        updated_rollout: Rollout between updates.
        parameters: Parameters of the closed loop (N, np).
        outputs: Names of outputs to sample.
        control: Threads, progress and interruption of the batch.

    Raises:
        ScenarioError: If an interval between updates is not a multiple of the time between samples.
    """

    def __init__(
        self, updated_rollout: UpdatedRollout, parameters: Array, outputs: Sequence[str], control: Controls
    ) -> None:
        self.loop, self.parameters, self._names = updated_rollout.loop, parameters, tuple(outputs)
        self.variables: Sequence[OutputVariable] = updated_rollout.variables
        self._updated_rollout, self._control = updated_rollout, control
        count, grid = len(parameters), updated_rollout.rollout.grid
        self.time = grid.time if outputs else np.empty(0)
        self._sample_s = grid.step_s * grid.every
        for scheme in updated_rollout.updated.schemes if outputs else ():
            for name, length in scheme.intervals.items():
                if abs(length / self._sample_s - round(length / self._sample_s)) > ROUNDING * length:
                    message = f"found {self._sample_s:g} s, allowed with {name}, {length:g} s: a part of it"
                    raise updated_rollout.updated.original.error(message, "campaign.series_step")
        x0, c = (value.full().T for value in updated_rollout.loop.setup(parameters.T))
        self.start = np.hstack([np.zeros((count, 1)), x0, c[:, list(updated_rollout.loop.switches)]])
        self.inputs: list[Inputs] = [{} for _ in range(count)]
        self.over, self.ended = np.zeros(count, bool), np.zeros(count, bool)
        self.diverged_at, self.done = np.full(count, np.nan), np.ones(count, bool)
        self._unclosed, self.gaps = [""] * count, dict[str, Array]()
        sizes = {name: one.expression.numel() for name, one in updated_rollout.measures.named.items()}
        self.measures = {name: np.zeros((count, size)) for name, size in sizes.items()}
        numel = updated_rollout.loop.outputs.numel_out
        self.outputs = {name: np.full((count, len(self.time), numel(name)), np.nan) for name in outputs}

    @property
    def unclosed(self) -> tuple[str, ...]:
        """Name of a grasp that does not close at the start, for each simulation; empty if all close."""
        return tuple(self._unclosed)

    def roll(self, p: Array, start: Array, duration: float) -> Ends:
        """See :class:`spacerobot.updates.plant.UpdatedPlant`."""
        return self._ends(self._rolled(p, start, duration, ()), start, duration)

    def advance(self, rows: Rows, until: float) -> None:
        """See :class:`spacerobot.updates.plant.UpdatedPlant`."""
        now = float(self.start[rows[0], 0]) if len(rows) else until
        if until - now <= ROUNDING * until:
            return
        begins = now == 0
        segment = self._rolled(self.parameters[rows], self.start[rows], until - now, self._names)
        if begins:
            for name, gap in segment.gaps.items():
                self.gaps.setdefault(name, np.full(len(self.start), np.nan))[rows] = gap
            for row, grasp in zip(rows, segment.unclosed, strict=True):
                self._unclosed[row] = grasp
        self.done[rows] &= segment.done
        lost = np.isfinite(segment.diverged_at_s)
        self.diverged_at[rows[lost]] = now + segment.diverged_at_s[lost]
        self.ended[rows] = lost | ~segment.done
        if segment.events is not None:
            self.ended[rows] |= np.isfinite(segment.events.ended_at_s)
            kinds = np.array([rule.kind == "phase" for rule in self.loop.events] + [False])
            self.over[rows] |= kinds[segment.events.event].any(axis=1)
        for name, one in self._updated_rollout.measures.named.items():
            values, totals = segment.measures[name], self.measures[name]
            if one.kind == "integral":
                totals[rows] += values
            elif one.kind == "peak" and not begins:
                totals[rows] = np.maximum(totals[rows], values)
            else:
                totals[rows] = values
        for name in self._names:
            first = round(now / self._sample_s)
            part = segment.outputs[name]
            self.outputs[name][rows, first : first + part.shape[1]] = part
        ends = self._ends(segment, self.start[rows], until - now)
        self.start[rows] = ends.start
        self.start[rows, 0] = until
        for row, inputs in zip(rows, ends.inputs, strict=True):
            self.inputs[row] = inputs

    def _rolled(self, p: Array, start: Array, duration: float, outputs: Sequence[str]) -> Batch:
        rollout = self._updated_rollout.rollout
        sample_s = self._sample_s if outputs else duration
        grid = time_grid(duration, rollout.grid.step_s * (1 + ROUNDING), sample_s)
        return dataclasses.replace(rollout, grid=grid).batch(
            rollout.loop.parameter_paths, np.hstack([p, start]), outputs=outputs, **self._control
        )

    def _ends(self, segment: Batch, start: Array, duration: float) -> Ends:
        ends = np.hstack([start[:, :1] + duration, segment.measures[STATE]])
        names = [one.name for one in input_variables(self.variables)]
        inputs = [{name: segment.measures[name][i] for name in names} for i in range(len(ends))]
        return Ends(ends, inputs)
