"""Simulations under model predictive control: rolled out from one instant to the next, planned in between.

At t_k = k T each simulation is measured; its plan begins after the delay d at the state that the controllers'
own model predicts there, and is flown from t_k + d on. Whatever carries the states (one rollout, many in
lanes, the independent engine) is behind :class:`ControlledPlant`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from optim.planning.formulation.formulate import scene_with_plan_model
from optim.planning.mpc.flown_scene import FlownScene, first_plan
from optim.planning.mpc.handover import Handover
from optim.planning.mpc.horizon import ROUNDING
from optim.planning.mpc.measured_state import Readings, measured_state
from optim.planning.mpc.planners import ParallelPlanners, Planners
from spacerobot.arrays import Array
from spacerobot.errors import SpaceRobotError
from spacerobot.rollout.closed_loop_protocol import LoopParameters
from spacerobot.scenario.load import to_document
from spacerobot.scene import Scene
from spacerobot.section import numbers
from spacerobot.symbolic.noise import DRAW, NOISELESS

Rows = NDArray[np.int64]
SHORT = 1e-11
"""Length of a rollout whose readings stand for those at its start [s]."""

TRUE = {"offset": 0.0, "scale": 1.0}
"""Numbers of a sensor that shows what there is; the draw of zeros takes its noise and bias away."""


@dataclass
class Ends:
    """Ends of rollouts of some length.

    Attributes
    ----------
    start
        Time, state and switches there (n, 1 + nx + ns), where the next rollouts begin.
    readings
        Sensor readings at the ends, one mapping for each rollout.
    """

    start: Array
    readings: Sequence[Readings]


class ControlledPlant(Protocol):
    """Carrier of N simulations.

    Attributes
    ----------
    parameters
        Parameters of the closed loop (N, np).
    start
        Present time [s], state and switches of each simulation (N, 1 + nx + ns).
    readings
        Present sensor readings of each simulation.
    over, ended
        Whether the phase that is controlled by plans is over, and whether the simulation is (N,).
    """

    parameters: Array
    start: Array
    readings: list[Readings]
    over: NDArray[np.bool_]
    ended: NDArray[np.bool_]

    @property
    def loop(self) -> LoopParameters:
        """The closed loop."""

    def roll(self, p: Array, start: Array, length: float) -> Ends:
        """Roll out from anywhere, with parameters (n, np), and keep nothing of it."""

    def advance(self, rows: Rows, until: float) -> None:
        """Carry some simulations on to a time [s]."""


class Computer:
    """Source of what plans begin with: measurements, and the controllers' own model.

    Parameters
    ----------
    scene, flown
        The scene, and the one with places for plans.
    plant
        The simulations.
    handover
        State in which plans begin; the start of the simulations if None.
    """

    def __init__(
        self, scene: Scene, flown: FlownScene, plant: ControlledPlant, handover: Handover | None = None
    ) -> None:
        self.scene, self.flown, self.plant = scene, flown, plant
        self.handover = handover or Handover.at_start(scene)
        loop, plan_scene, overrides = plant.loop, scene_with_plan_model(scene), dict[str, float]()
        if plan_scene is not scene:
            before, after = (dict(numbers(to_document(one.scenario))) for one in (scene, plan_scene))
            overrides = {path: value for path, value in after.items() if value != before.get(path)}
        # parameters of the controllers' own model (np,): those of `plan.model`, and sensors without errors
        self.model = np.array(loop.parameter_values, dtype=float)
        for place, path in enumerate(loop.parameter_paths):
            self.model[place] = overrides.get(path, self.model[place])
            if ".sensors." in path:
                self.model[place] = TRUE.get(path.rpartition(".")[2], self.model[place])
            if path == DRAW:
                self.model[place] = NOISELESS
        # places of the plans' points among the parameters, and of biases among time, state and switches
        self.places = flown.places(loop.parameter_paths)
        biases = [1 + i for i, name in enumerate(loop.state_names) if ".bias[" in name]
        self.biases = np.array(biases, dtype=np.int64)
        # configuration of each simulation at its start (N, nq)
        self.first = np.tile(scene.q, (len(plant.start), 1))
        if handover is None:
            self.first = plant.start[:, 1 : 1 + scene.model.nq].copy()

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
        """Inertial parameters of the target as some simulations estimate them; None where they do not."""
        return [
            self.handover.inertia(reading, state) for reading, state in zip(readings, measured, strict=True)
        ]

    def predicted(self, rows: Rows, measured: Array, delay: float) -> Array:
        """Predicted states after a delay [s], under the present plans (n, nq + nv).

        Raises
        ------
        SpaceRobotError
            If the controllers' own model diverges.
        """
        p, start = np.tile(self.model, (len(rows), 1)), self.plant.start[rows].copy()
        p[:, self.places] = self.plant.parameters[np.ix_(rows, self.places)]
        start[:, 1 : 1 + measured.shape[1]] = measured
        start[:, self.biases] = 0.0
        states = self.plant.roll(p, start, delay).start[:, 1 : 1 + measured.shape[1]]
        if not np.isfinite(states).all():
            raise SpaceRobotError(f"the plans' own model diverges within their delay of {delay:g} s")
        return states


def fly(
    computer: Computer,
    pilots: Planners | ParallelPlanners,
    notify: Callable[[str], None] = lambda _: None,
) -> list[str]:
    """Simulate to the end.

    Parameters
    ----------
    computer
        Estimates and predictions for the plans, with the simulations.
    pilots
        Planners of the simulations.
    notify
        Callback for progress.

    Returns
    -------
    list
        Why each simulation has no first plan, in words; empty where it has one.
    """
    plant, flown, places = computer.plant, computer.flown, computer.places
    period, delay, end = flown.settings.period, flown.settings.delay, flown.duration_s
    everyone, begin = np.arange(len(plant.start)), computer.handover.begin_s
    end -= begin

    def show(rows: Rows, now: float) -> None:
        """Hand the points of the present plans to the controllers."""
        if len(rows):
            plant.parameters[np.ix_(rows, places)] = pilots.points(rows.tolist(), now)

    readings = plant.roll(plant.parameters, plant.start, SHORT).readings
    measured = computer.measured(everyone, readings)
    faults = pilots.first(
        everyone.tolist(), computer.handover.planned(measured), computer.inertia(readings, measured)
    )
    plant.ended |= np.array([bool(fault) for fault in faults])
    for k in itertools.count():
        now = k * period
        rows = everyone[~plant.over & ~plant.ended]
        if not len(rows) or now >= end * (1 - ROUNDING):
            break
        notify(f"flying: {begin + now:.3g} of {begin + end:.3g} s, {len(rows)} under predictive control")
        show(rows, now)
        if k and flown.replans_at(now + delay):
            readings = [plant.readings[row] for row in rows]
            measured = computer.measured(rows, readings)
            inertia = computer.inertia(readings, measured)
            if delay:
                measured = computer.predicted(rows, measured, delay)
            pilots.replan(rows.tolist(), now + delay, computer.handover.planned(measured), inertia)
            if delay:
                plant.advance(rows, begin + min(now + delay, end))
            rows = rows[~plant.ended[rows]]
            show(rows, now + delay)
        plant.advance(rows, begin + min(now + period, end))
    notify("flying: all that follows the plans")
    last = plant.start[:, 0] - begin
    for now in np.unique(last[~plant.ended]):
        rows = everyone[~plant.ended & (last == now)]
        if now < end * (1 - ROUNDING):
            show(rows, now)
            plant.advance(rows, begin + end)
    return faults
