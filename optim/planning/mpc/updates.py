"""Model predictive control as an update scheme: plans are made between the pieces of a simulation.

At t_k = k T each simulation is measured. Its plan begins after the delay d in the state that the controllers'
own model predicts at t_k + d, and is tracked from then on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np

from optim.planning.formulation.formulate import scene_with_plan_model
from optim.planning.mpc.flown_scene import FlownScene, first_plan
from optim.planning.mpc.handover import Handover
from optim.planning.mpc.horizon import ROUNDING
from optim.planning.mpc.measured_state import Readings, measured_state, readings_of
from optim.planning.mpc.planners import ParallelPlanners, Planners
from spacerobot.common.arrays import Array
from spacerobot.common.errors import NoPlanError, SpaceRobotError
from spacerobot.common.section import numbers
from spacerobot.elements.controllers.controller import Replanning
from spacerobot.result.summary_types import MpcStatistics
from spacerobot.scenario.load import to_document
from spacerobot.scene import Scene
from spacerobot.symbolic.noise import DRAW, NOISELESS
from spacerobot.updates.plant import SHORT, Inputs, Rows, SinglePlant, UpdatedPlant

AFTER = 1e-6
"""Time from the start of the planned phase to the start of the first plan [s]."""

TRUE = {"offset": 0.0, "scale": 1.0}
"""Values of an ideal sensor; a draw of zeros removes its noise and bias."""

STATISTICS = {
    "plans": "1",
    "missed": "1",
    "unfinished": "1",
    "iterations": "1",
    "median_solve_s": "s",
    "longest_solve_s": "s",
}
"""Statistics of the plans of a simulation, each with its unit."""


class Computer:
    """Onboard computation of each plan's initial state, from measurements and the controllers' model.

    Args:
        scene, flown: The scene, and the one whose controllers hold plan points.
        plant: The simulations.
        handover: Handover to the planned scene; the start of the simulations if None.
    """

    def __init__(
        self, scene: Scene, flown: FlownScene, plant: UpdatedPlant, handover: Handover | None = None
    ) -> None:
        self.scene, self.flown, self.plant = scene, flown, plant
        self.handover = handover or Handover.at_start(scene)
        loop, plan_scene, overrides = plant.loop, scene_with_plan_model(scene), dict[str, float]()
        if plan_scene is not scene:
            before, after = (dict(numbers(to_document(one.scenario))) for one in (scene, plan_scene))
            overrides = {path: value for path, value in after.items() if value != before.get(path)}
        # parameters of the controllers' own model (np,): those of `plan.model`, with ideal sensors
        self.model = np.array(loop.parameter_values, dtype=float)
        for place, path in enumerate(loop.parameter_paths):
            self.model[place] = overrides.get(path, self.model[place])
            if ".sensors." in path:
                self.model[place] = TRUE.get(path.rpartition(".")[2], self.model[place])
            if path == DRAW:
                self.model[place] = NOISELESS
        # indices of the plan points among the parameters, and of biases in (time, state, switches)
        self.places = flown.places(loop.parameter_paths)
        biases = [1 + i for i, name in enumerate(loop.state_names) if ".bias[" in name]
        self.biases = np.array(biases, dtype=np.int64)
        # configuration of each simulation at its start (N, nq)
        self.first = np.tile(scene.q, (len(plant.start), 1))
        if handover is None:
            self.first = plant.start[:, 1 : 1 + scene.model.nq].copy()

    def readings(self, inputs: Sequence[Inputs]) -> list[Readings]:
        """Readings of sensors and filters among the inputs of the controllers."""
        return [readings_of(self.plant.variables, each) for each in inputs]

    def measured(self, rows: Rows, readings: Sequence[Readings]) -> Array:
        """Estimated states of some simulations (n, nq + nv)."""
        plan, plant = first_plan(self.scene), self.plant
        states = [
            measured_state(
                self.scene, plan, reading, plant.start[row, 1:], self.first[row], self.handover.held
            )
            for row, reading in zip(rows, readings, strict=True)
        ]
        return np.array(states)

    def inertia(self, readings: Sequence[Readings], measured: Array) -> list[Array | None]:
        """Estimated inertial parameters of the target in some simulations; None without an estimate."""
        return [
            self.handover.inertia(reading, state) for reading, state in zip(readings, measured, strict=True)
        ]

    def predicted(self, rows: Rows, measured: Array, delay: float) -> Array:
        """Predicted states after a delay [s], under the present plans (n, nq + nv).

        Raises:
            SpaceRobotError: If the controllers' own model diverges.
        """
        p, start = np.tile(self.model, (len(rows), 1)), self.plant.start[rows].copy()
        p[:, self.places] = self.plant.parameters[np.ix_(rows, self.places)]
        start[:, 1 : 1 + measured.shape[1]] = measured
        start[:, self.biases] = 0.0
        states = self.plant.roll(p, start, delay).start[:, 1 : 1 + measured.shape[1]]
        if not np.isfinite(states).all():
            raise SpaceRobotError(f"the plans' own model diverges within their delay of {delay:g} s")
        return states


class MpcScheme:
    """Scheme of the controllers of kind ``mpc``; see :class:`spacerobot.updates.scheme.UpdateScheme`.

    Args:
        original, flown: The scene, and the one whose controllers hold plan points.
    """

    measures: ClassVar[Mapping[str, str]] = {f"mpc_{name}": unit for name, unit in STATISTICS.items()}

    def __init__(self, original: Scene, flown: FlownScene) -> None:
        self.original, self.flown = original, flown
        self.scene, self.duration_s = flown.scene, flown.duration_s
        self.period_s = flown.settings.period
        # each plan begins at the state that is predicted for the end of the delay
        self.prediction_s = math.ceil(self.duration_s / self.period_s) * flown.settings.delay
        self.intervals = {
            "the period of kind mpc": flown.settings.period,
            "the delay of kind mpc": flown.settings.delay,
        }
        self._planners: ParallelPlanners | Planners | None = None
        self._workers = 0

    @classmethod
    def of(cls, scene: Scene, vary: Collection[str] = ()) -> Self:
        """See :class:`spacerobot.updates.scheme.UpdateScheme`."""
        return cls(scene, FlownScene.of(scene, vary))

    @property
    def summary(self) -> str:
        """Period of the plans."""
        return f"plans every {self.period_s:g} s"

    def check_batch(self) -> None:
        """Refuse a batch whose plans are made in a later phase than the first one."""
        if self.flown.phase:
            raise self.original.error(
                f"plans are made in {self.flown.phase!r}, allowed in batches and campaigns: in the first "
                "phase",
                "phases",
            )

    def planners(
        self, workers: int, backend: str, notify: Callable[[str], None]
    ) -> ParallelPlanners | Planners:
        """Planners in ``workers`` processes, in this one if that is 1; kept for the next batch."""
        if self._planners is None or workers != self._workers:
            self._workers = workers
            self._planners = (
                Planners(self.original, backend, notify)
                if workers == 1
                else ParallelPlanners(self.original, workers)
            )
        return self._planners

    def start(
        self, plant: UpdatedPlant, workers: int, backend: str, notify: Callable[[str], None]
    ) -> MpcUpdates:
        """See :class:`spacerobot.updates.scheme.UpdateScheme`.

        Raises:
            ScenarioError: If the plan does not suit model predictive control.
        """
        if self.flown.phase:
            return MpcUpdates.after_phase(self, plant, backend, notify)
        return MpcUpdates(self, plant, self.planners(workers, backend, notify), notify)


class MpcUpdates:
    """Plans of N simulations; see :class:`spacerobot.updates.scheme.Updates`.

    Args:
        scheme, plant: The scheme, and the simulations.
        planners: Planners of the simulations; None if plans begin in a later phase.
        notify: Callback for progress.
    """

    def __init__(
        self,
        scheme: MpcScheme,
        plant: UpdatedPlant,
        planners: Planners | ParallelPlanners | None,
        notify: Callable[[str], None],
    ) -> None:
        self.scheme, self.plant, self.notify = scheme, plant, notify
        count = len(plant.start)
        self.next = np.zeros(count)
        self.faults: list[SpaceRobotError | None] = [None] * count
        self.statistics: list[MpcStatistics | None] = [None] * count
        # index of the period of each simulation's next update, -1 before the first plan; and whether that
        # update ends a delay
        self._period, self._is_delayed = np.full(count, -1), np.zeros(count, bool)
        self._planners, self._backend = planners, "auto"
        self._computer = Computer(scheme.original, scheme.flown, plant)
        self._end = scheme.flown.duration_s

    @classmethod
    def after_phase(
        cls, scheme: MpcScheme, plant: UpdatedPlant, backend: str, notify: Callable[[str], None]
    ) -> MpcUpdates:
        """Updates of a simulation whose plans begin in a later phase than the first one.

        Until then the controllers' plan is to rest in the posture at which that phase begins.

        Args:
            scheme, plant: The scheme, and a single simulation.
            backend: ``auto``, ``compiled`` or ``interpreted``.
            notify: Callback for progress.
        """
        flown, updates = scheme.flown, cls(scheme, plant, None, notify)
        notify(f"simulating what comes before {flown.phase}")
        assert isinstance(plant, SinglePlant), "batches are refused"
        scout, loop, begins = plant.scout(), plant.loop, None
        rows, places = np.zeros(1, dtype=np.int64), flown.places(loop.parameter_paths)
        scout.parameters[0, places] = flown.resting(scout.start[0, 1:])
        while begins is None and not scout.ended[0] and scout.start[0, 0] < flown.duration_s * (1 - ROUNDING):
            scout.advance(rows, min(scout.start[0, 0] + flown.settings.period, flown.duration_s))
            now, piece = scout.pieces[-1]
            for one in piece.events:
                rule = loop.events[one.event]
                if rule.kind == "phase" and rule.who == flown.phase:
                    begins, state = now + one.time_s, one.after
        if begins is None:  # it never does
            plant.parameters[:] = scout.parameters
            updates.next[:] = np.inf
            return updates
        plant.parameters[0, places] = flown.resting(state)
        updates.next[:] = begins + AFTER
        updates._backend = backend
        return updates

    def _begin(self, rows: Rows) -> None:
        """Make the first plans of some simulations."""
        scheme, plant = self.scheme, self.plant
        if self._planners is None:
            assert isinstance(plant, SinglePlant), "batches are refused"
            plant.over[:] = False
            handover = Handover.at(scheme.original, plant.loop, plant.start[0])
            self._planners = Planners(scheme.original, self._backend, self.notify, (scheme.flown, handover))
            self._computer = Computer(scheme.original, scheme.flown, plant, handover)
            self._end = scheme.flown.duration_s - handover.begin_s
        computer = self._computer
        readings = computer.readings(plant.roll(plant.parameters[rows], plant.start[rows], SHORT).inputs)
        measured = computer.measured(rows, readings)
        messages = self._planners.first(
            rows.tolist(), computer.handover.planned(measured), computer.inertia(readings, measured)
        )
        for row, message in zip(rows, messages, strict=True):
            if message:
                self.faults[row] = NoPlanError(message, source=scheme.original.source, where="plan")
                plant.ended[row] = True
        self._period[rows] = 0

    def update(self, rows: Rows) -> None:
        """See :class:`spacerobot.updates.scheme.Updates`."""
        first = rows[self._period[rows] < 0]
        if len(first):
            self._begin(first)
        rows = rows[~self.plant.ended[rows]]
        settings, begin, end = self.scheme.flown.settings, self._computer.handover.begin_s, self._end
        over = rows[self.plant.over[rows] & ~self._is_delayed[rows]]
        last = self.plant.start[over, 0] - begin
        for now in np.unique(last):
            self._show(over[last == now], now)
        self.next[over] = begin + end
        rows = np.setdiff1d(rows, over)
        for k, is_delayed in sorted(
            set(zip(self._period[rows].tolist(), self._is_delayed[rows].tolist(), strict=True))
        ):
            chosen = rows[(self._period[rows] == k) & (self._is_delayed[rows] == is_delayed)]
            now = k * settings.period
            if is_delayed:
                self._show(chosen, now + settings.delay)
            elif self._plan(chosen, now):
                self.next[chosen] = begin + min(now + settings.delay, end)
                self._is_delayed[chosen] = True
                continue
            self.next[chosen] = begin + min(now + settings.period, end)
            self._period[chosen], self._is_delayed[chosen] = k + 1, False

    def _plan(self, rows: Rows, now: float) -> bool:
        """Replan at the beginning of a period, if due; returns whether the plans begin after a delay."""
        plant, flown, computer = self.plant, self.scheme.flown, self._computer
        delay, begin = flown.settings.delay, computer.handover.begin_s
        self.notify(
            f"flying: {begin + now:.3g} of {begin + self._end:.3g} s, {len(rows)} under predictive control"
        )
        self._show(rows, now)
        if not (now and flown.replans_at(now + delay)):
            return False
        assert self._planners is not None, "made with the first plans"
        readings = computer.readings([plant.inputs[row] for row in rows])
        measured = computer.measured(rows, readings)
        inertia = computer.inertia(readings, measured)
        if delay:
            measured = computer.predicted(rows, measured, delay)
        self._planners.replan(rows.tolist(), now + delay, computer.handover.planned(measured), inertia)
        if not delay:
            self._show(rows, now)
        return bool(delay)

    def _show(self, rows: Rows, now: float) -> None:
        """Write the points of the present plans to the controllers' parameters."""
        if len(rows):
            assert self._planners is not None, "made with the first plans"
            places = self._computer.places
            self.plant.parameters[np.ix_(rows, places)] = self._planners.points(rows.tolist(), now)

    def finish(self) -> None:
        """See :class:`spacerobot.updates.scheme.Updates`."""
        if self._planners is not None:
            settings = self.scheme.flown.settings
            for row, one in enumerate(self._planners.end(range(len(self.faults)))):
                self.statistics[row] = statistics(settings, one) if one else None

    def summary(self) -> Mapping[str, Any]:
        """Statistics of the plans."""
        return {"mpc": self.statistics[0]} if self.statistics[0] else {}

    def measures(self) -> Mapping[str, Array]:
        """Statistics of the plans; NaN for a simulation without plans."""
        rows: list[Mapping[str, Any]] = [one or {} for one in self.statistics]
        return {
            f"mpc_{name}": np.array([[float(np.sum(row.get(name, np.nan)))] for row in rows])
            for name in STATISTICS
        }


def statistics(settings: Replanning, planner_statistics: Mapping[str, Any]) -> MpcStatistics:
    """Statistics and computing times of a simulation's plans, for its summary.

    Args:
        settings: Settings of the controllers.
        planner_statistics: Statistics of its horizon.
    """
    seconds: Sequence[float] = planner_statistics["seconds"]
    again, allowed = seconds[1:], settings.delay or settings.period
    return {
        "period_s": settings.period,
        "delay_s": settings.delay,
        "plans": planner_statistics["plans"],
        "missed": planner_statistics["missed"],
        "unfinished": planner_statistics["unfinished"],
        "iterations": planner_statistics["iterations"],
        "first_solve_s": seconds[0],
        "median_solve_s": float(np.median(again or [0.0])),
        "longest_solve_s": max(again, default=0.0),
        "in_time": sum(one <= allowed for one in again),
    }
