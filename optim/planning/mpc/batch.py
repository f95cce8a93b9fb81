"""Many simulations under model predictive control: carried in lanes, each with its own plans."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from typing import Any, Unpack

import casadi as ca
import numpy as np
import numpy.typing as npt

from optim.planning.mpc.flight import Computer, Ends, Rows, fly
from optim.planning.mpc.flown_scene import FlownScene
from optim.planning.mpc.horizon import ROUNDING
from optim.planning.mpc.measured_state import Readings, readings_of
from optim.planning.mpc.planners import ParallelPlanners, Planners
from optim.planning.mpc.simulation import statistics
from spacerobot.arrays import Array
from spacerobot.closedloop import ClosedLoop
from spacerobot.compiled import usable_cores
from spacerobot.elements.controllers.controller import MPC_INPUT
from spacerobot.rollout import Batch, Measures, build_rollout, final, time_grid
from spacerobot.rollout.batch import Controls
from spacerobot.rollout.resumable_loop import SWITCHES, resumed
from spacerobot.scene import Scene

BEGIN = "start.0"
"""Parameter of a resumed loop: the time at which it is taken up."""
STATE = "end.state"
STATISTICS = ("plans", "missed", "unfinished", "iterations", "median_solve_s", "longest_solve_s")
"""Measures of the plans of a simulation, each with ``mpc_`` in front."""


class MpcRollout:
    """A closed loop under model predictive control, ready to run many times.

    It stands where a :class:`spacerobot.rollout.Rollout` does in batches and campaigns.

    Parameters
    ----------
    scene, flown, loop
        The scene, the one with places for plans, and its closed loop.
    extended
        The same loop with states added for the measures.
    measures
        Over the signals of ``extended``.
    **options
        Options of :func:`spacerobot.rollout.build_rollout`.

    Raises
    ------
    ScenarioError
        If plans are made in another phase than the first one.
    """

    def __init__(
        self,
        scene: Scene,
        flown: FlownScene,
        loop: ClosedLoop,
        extended: Any,
        measures: Measures,
        **options: Any,
    ) -> None:
        self.scene, self.flown, self.variables = scene, flown, loop.variables
        self.loop, self.measures = extended, measures
        self._planners: ParallelPlanners | Planners | None = None
        self._count = 0
        if flown.phase:
            raise scene.error(
                f"plans are made in {flown.phase!r}, allowed in batches and campaigns: in the first phase",
                "phases",
            )
        resumed_loop, signals = resumed(extended), measures.signals
        names = [one.name for one in loop.variables if one.name.startswith(MPC_INPUT)]
        begin = ca.SX.sym(BEGIN)
        switches = ca.SX.sym(SWITCHES, len(extended.switches))
        resumed_signals = dataclasses.replace(
            signals,
            outputs={**signals.outputs, SWITCHES: switches},
            parameters={**signals.parameters, BEGIN: begin},
        )
        # a resumed loop counts time from where it is taken up
        named = {
            name: dataclasses.replace(
                one, expression=ca.substitute(one.expression, signals.t, signals.t + begin)
            )
            for name, one in measures.named.items()
        }
        named |= {name: final(signals[name]) for name in names}
        named[STATE] = final(ca.vertcat(signals.x, switches))
        self.rollout = build_rollout(
            resumed_loop, measures=Measures(resumed_signals, named, costs=lambda _r, _p: {}), **options
        )

    @property
    def kernel(self) -> Any:
        """Functions that are evaluated between plans."""
        return self.rollout.kernel

    @property
    def summary(self) -> str:
        """One line that says what runs."""
        return f"{self.rollout.summary}; plans every {self.flown.settings.period:g} s"

    def values(self) -> Array:
        """Nominal parameters (np,)."""
        return np.array(self.loop.parameter_values, dtype=float)

    def planners(self, count: int) -> ParallelPlanners | Planners:
        """Makers of plans, by so many processes; kept for the next batch."""
        if self._planners is None or count != self._count:
            self._planners = Planners(self.scene) if count == 1 else ParallelPlanners(self.scene, count)
            self._count = count
        return self._planners

    def batch(
        self,
        paths: Sequence[str],
        values: npt.ArrayLike,
        *,
        outputs: Sequence[str] = (),
        **control: Unpack[Controls],
    ) -> Batch:
        """Many rollouts; arguments and errors as for :meth:`spacerobot.rollout.Rollout.batch`.

        The measures are joined by those of the plans, :data:`STATISTICS`.
        """
        began = time.perf_counter()
        rows = np.asarray(values, dtype=float).reshape(-1, len(paths))
        plant = LanePlant(self, self.rollout.rows(paths, rows)[:, : len(self.values())], outputs, control)
        count = max(1, min(control.get("threads") or usable_cores(), len(rows)))
        planners = self.planners(count)
        faults = fly(Computer(self.scene, self.flown, plant), planners)
        statistics_by_row: list[Mapping[str, Any]] = [
            statistics(self.flown.settings, one) if one else {} for one in planners.end(range(len(rows)))
        ]
        # no number where there was no plan
        plans = {
            f"mpc_{key}": np.array([[float(np.sum(one.get(key, np.nan)))] for one in statistics_by_row])
            for key in STATISTICS
        }
        plant.diverged_at[[bool(fault) for fault in faults]] = 0.0
        for array in (*plant.measures.values(), *plant.outputs.values()):
            array[np.isfinite(plant.diverged_at)] = np.nan
        batch = self.rollout.engines.batch
        return Batch(
            costs={},
            measures=plant.measures | plans,
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
    """N simulations rolled out piece by piece; see :class:`optim.planning.mpc.flight.ControlledPlant`.

    Parameters
    ----------
    mpc_rollout
        Compiled rollout between plans.
    parameters
        Parameters of the closed loop (N, np).
    outputs
        Names of outputs to sample.
    control
        Threads, progress and interruption of the batch.

    Raises
    ------
    ScenarioError
        If samples of outputs are not at the instants of plans.
    """

    def __init__(
        self, mpc_rollout: MpcRollout, parameters: Array, outputs: Sequence[str], control: Controls
    ) -> None:
        self.loop, self.parameters, self._names = mpc_rollout.loop, parameters, tuple(outputs)
        self._mpc_rollout, self._control = mpc_rollout, control
        count, grid = len(parameters), mpc_rollout.rollout.grid
        self.time = grid.time if outputs else np.empty(0)
        self._sample_s = grid.step_s * grid.every
        settings = mpc_rollout.flown.settings
        for name, length in (("period", settings.period), ("delay", settings.delay)):
            if outputs and abs(length / self._sample_s - round(length / self._sample_s)) > ROUNDING * length:
                message = (
                    f"found {self._sample_s:g} s, allowed with kind mpc: a part of its {name}, {length:g} s"
                )
                raise mpc_rollout.scene.error(message, "campaign.series_step")
        x0, c = (value.full().T for value in mpc_rollout.loop.setup(parameters.T))
        self.start = np.hstack([np.zeros((count, 1)), x0, c[:, list(mpc_rollout.loop.switches)]])
        self.readings: list[Readings] = [{} for _ in range(count)]
        self.over, self.ended = np.zeros(count, bool), np.zeros(count, bool)
        self.diverged_at, self.done = np.full(count, np.nan), np.ones(count, bool)
        self.unclosed, self.gaps = ("",) * count, dict[str, Array]()
        sizes = {name: one.expression.numel() for name, one in mpc_rollout.measures.named.items()}
        self.measures = {name: np.zeros((count, size)) for name, size in sizes.items()}
        numel = mpc_rollout.loop.outputs.numel_out
        self.outputs = {name: np.full((count, len(self.time), numel(name)), np.nan) for name in outputs}

    def roll(self, p: Array, start: Array, length: float) -> Ends:
        """See :class:`optim.planning.mpc.flight.ControlledPlant`."""
        return self._ends(self._rolled(p, start, length, ()), start, length)

    def advance(self, rows: Rows, until: float) -> None:
        """See :class:`optim.planning.mpc.flight.ControlledPlant`."""
        now = float(self.start[rows[0], 0]) if len(rows) else until
        if until - now <= ROUNDING * until:
            return
        begins = now == 0
        segment = self._rolled(self.parameters[rows], self.start[rows], until - now, self._names)
        if begins:
            self.gaps = dict(segment.gaps)
            self.unclosed = segment.unclosed
        self.done[rows] &= segment.done
        lost = np.isfinite(segment.diverged_at_s)
        self.diverged_at[rows[lost]] = now + segment.diverged_at_s[lost]
        self.ended[rows] = lost | ~segment.done
        if segment.events is not None:
            self.ended[rows] |= np.isfinite(segment.events.ended_at_s)
            kinds = np.array([rule.kind == "phase" for rule in self.loop.events] + [False])
            self.over[rows] |= kinds[segment.events.event].any(axis=1)
        for name, one in self._mpc_rollout.measures.named.items():
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
        for row, known_there in zip(rows, ends.readings, strict=True):
            self.readings[row] = known_there

    def _rolled(self, p: Array, start: Array, length: float, outputs: Sequence[str]) -> Batch:
        rollout = self._mpc_rollout.rollout
        sample_s = self._sample_s if outputs else length
        grid = time_grid(length, rollout.grid.step_s * (1 + ROUNDING), sample_s)
        return dataclasses.replace(rollout, grid=grid).batch(
            rollout.loop.parameter_paths, np.hstack([p, start]), outputs=outputs, **self._control
        )

    def _ends(self, found: Batch, start: Array, length: float) -> Ends:
        ends = np.hstack([start[:, :1] + length, found.measures[STATE]])
        variables = [one for one in self._mpc_rollout.variables if one.name in found.measures]
        read = {one.name: found.measures[one.name] for one in variables}
        return Ends(
            ends,
            [
                readings_of(variables, {name: values[i] for name, values in read.items()})
                for i in range(len(ends))
            ],
        )
