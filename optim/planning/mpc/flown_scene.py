"""A scene with places for the plans of model predictive control, and the settings of its controllers."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.planning.formulation.formulate import plan_section
from optim.planning.mpc.horizon import ROUNDING, Horizon
from optim.planning.mpc.measured_state import sensors_of
from optim.planning.transcription.lobatto import Lobatto
from spacerobot.arrays import Array
from spacerobot.elements.controller import Replanning
from spacerobot.elements.goal import TipGoal
from spacerobot.errors import ScenarioError
from spacerobot.scenario.bodies import Robot
from spacerobot.scenario.phases import successors
from spacerobot.scenario.plan import PlanSection
from spacerobot.scene import Scene, build_scene

TABLES = ("position", "rate", "effort")
"""Values of a plan at its points."""


def mpc_controllers(scene: Scene) -> dict[str, tuple[str, Replanning]]:
    """Key of each robot's controller whose plan is made again in flight, and how that is done, by robot."""
    return {
        body: (key, controller.replanning)
        for body, robot in scene.scenario.robots.items()
        for key, controller in robot.controllers.items()
        if controller.replanning is not None
    }


def first_plan(scene: Scene) -> PlanSection:
    """Section of a scene's plan, or of its first phase."""
    return next(iter(plan_section(scene).by_phase.values()))


@dataclass(frozen=True)
class FlownScene:
    """A scene under model predictive control.

    Attributes
    ----------
    scene
        With the points of one period in the controllers, numbers that plans replace.
    settings
        What the controllers share.
    joints
        Names of each robot's joints in the order of these points, by robot.
    duration_s
        Of the simulation [s]: that of the plan where there are no phases.
    """

    scene: Scene
    settings: Replanning
    joints: dict[str, tuple[str, ...]]
    duration_s: float

    @classmethod
    def of(cls, scene: Scene, vary: Collection[str] = ()) -> FlownScene:
        """With places for plans.

        Parameters
        ----------
        scene
            With a ``plan`` section, and a controller of kind ``mpc`` for each robot.
        vary
            Numbers by dotted path that are changed; sensors among them are read though they are ideal.

        Raises
        ------
        ScenarioError
            If the scene has no such controllers, or the plan does not fit them.
        """
        settings, plan, changes = mpc_settings(scene), first_plan(scene), dict[str, Any]()
        duration, joints = scene.scenario.simulation.duration, dict[str, tuple[str, ...]]()
        if not scene.scenario.phases:
            changes["simulation.duration"] = duration = plan.duration.upper
        lobatto = Lobatto.of_order(plan.order)
        goals = [goal for goal in plan.goals.values() if isinstance(goal, TipGoal) and goal.follows]
        for body in scene.robots:
            name, (key, _) = body.name, mpc_controllers(scene)[body.name]
            joints[name] = tuple(body.joint_name(scene.model, joint) for joint in body.driven_joints)
            rows = np.ones((lobatto.points, len(joints[name]))).tolist()
            path = f"robots.{name}.controllers.{key}"
            estimators = body.config.estimators.values() if isinstance(body.config, Robot) else ()
            made = {signal for estimator in estimators for signal in estimator.makes}
            times = (lobatto.nodes * settings.period).tolist()
            points = {"times": times, "points": len(times), "joints": list(joints[name])}
            changes[f"{path}.knots"] = points | dict.fromkeys(TABLES, rows)
            changes[f"{path}.signals"] = [
                signal
                for signal, sensor in sensors_of(scene)[name]
                if not sensor.is_ideal
                or signal in made
                or any(f"robots.{name}.sensors.{signal}." in each for each in vary)
            ]
            changes[f"{path}.frames"] = {
                goal.tip: goal.follows for goal in goals if goal.tip.startswith(f"{name}/")
            }
        return cls(build_scene(scene.scenario, changes, source=scene.source), settings, joints, duration)

    def places(self, paths: Sequence[str]) -> NDArray[np.int64]:
        """Places among the parameters of a closed loop, by their paths, of what :meth:`numbers` gives."""
        place, found = {path: i for i, path in enumerate(paths)}, []
        for robot, (key, _) in mpc_controllers(self.scene).items():
            path, count = f"robots.{robot}.controllers.{key}", len(self.joints[robot])
            points = first_plan(self.scene).order // 2 + 1
            cells = list(itertools.product(TABLES, range(points), range(count)))
            found += [place[f"{path}.begin"], *(place[f"{path}.knots.{t}.{k}.{j}"] for t, k, j in cells)]
        return np.array(found, dtype=np.int64)

    def replans_at(self, begin: float) -> bool:
        """Whether a plan is to begin at a time [s]: the last one before the end is kept until there.

        None where the shortest time to look ahead is longer than the first plan.
        """
        plan = plan_section(self.scene)
        whole = first_plan(self.scene).duration.upper
        left, least = whole - begin, self.settings.min_horizon
        behind = left < ROUNDING * whole and not plan.phases
        return least <= whole and (left > least - ROUNDING * whole or behind)

    def numbers(self, horizon: Horizon, now: float) -> Array:
        """Begin and points of a plan in the period that begins now [s], of all robots in turn."""
        found: list[Array] = []
        for robot, names in self.joints.items():
            knots = horizon.knots(now, self.settings.period, robot)
            columns = [knots["joints"].index(name) for name in names]
            tables = [np.array(knots[name])[:, columns].ravel() for name in TABLES]
            found += [np.array([now]), *tables]
        return np.concatenate(found)


def mpc_settings(scene: Scene) -> Replanning:
    """Settings that all mpc controllers share: period, delay, and when the last plan is made.

    Parameters
    ----------
    scene
        With a controller of kind ``mpc`` for each robot.

    Raises
    ------
    ScenarioError
        If robots differ in them, one has none, they do not rest behind the first phase, or the plan's
        duration is not so many periods.
    """
    source, given, plan = scene.source, mpc_controllers(scene), first_plan(scene)
    for body in scene.robots:
        if body.name not in given:
            raise ScenarioError(
                "has no controller of kind mpc; a plan moves the joints of all robots",
                source=source,
                where=f"robots.{body.name}.controllers",
            )
    leads = [lead for _, lead in given.values()]
    for key in ("period", "min_horizon", "delay", "iterations"):
        if len({getattr(lead, key) for lead in leads}) > 1:
            told = f"controllers of kind mpc differ in {key}, allowed: one for all robots"
            raise ScenarioError(told, source=source, where="robots")
    settings = leads[0]
    where = (
        "plan" if not plan_section(scene).phases else f"plan.phases.{next(iter(plan_section(scene).phases))}"
    )
    if plan.start:
        told = "found a free start, allowed with kind mpc: none"
        raise ScenarioError(told, source=source, where=f"{where}.start")
    count, timed = plan.duration.upper / settings.period, plan.duration
    if timed.lower != timed.upper or abs(count - round(count)) > ROUNDING * count:
        free = "" if timed.lower == timed.upper else f"{timed.lower:g} to "
        raise ScenarioError(
            f"found {free}{timed.upper:g} s, allowed with kind mpc: "
            f"one number, so many periods of {settings.period:g} s",
            source=source,
            where=f"{where}.duration",
        )
    _check_phases(scene)
    return settings


def _check_phases(scene: Scene) -> None:
    """Refuse phases in which plans are made but the first one.

    Raises
    ------
    ScenarioError
        Naming the first one.
    """
    phases = scene.scenario.phases
    first = next(iter(phases), None)
    if first is None:
        return
    for name, (robot, (key, _)) in itertools.product(phases, mpc_controllers(scene).items()):
        own = scene.scenario.during(name).robots[robot]
        where = f"phases.{name}.robots.{robot}"
        if name != first:
            if key in own.controllers:
                raise ScenarioError(
                    f"plans are made in the first phase alone; write `{key}: null` here",
                    source=scene.source,
                    where=f"{where}.controllers",
                )
        elif key not in own.controllers:
            told = "rests in the first phase, in which plans are made and flown"
            raise ScenarioError(told, source=scene.source, where=f"{where}.controllers.{key}")
    for name, follows in successors(phases).items():
        if first in follows:
            told = f"leads back to {first!r}; plans are made in it once"
            raise ScenarioError(told, source=scene.source, where=f"phases.{name}")
