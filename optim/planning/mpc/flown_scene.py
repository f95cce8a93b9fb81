"""Scene of model predictive control, whose controllers hold plan points as parameters, and its settings."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.planning.formulation.formulate import plan_section
from optim.planning.formulation.path_constraints import driven_coordinates
from optim.planning.mpc.horizon import ROUNDING, Horizon
from optim.planning.mpc.measured_state import sensors_of
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.verification.replay import joint_angle
from spacerobot.common.arrays import Array
from spacerobot.elements.controllers.controller import Replanning
from spacerobot.scenario.bodies import Robot
from spacerobot.scenario.phases import reached_from, successors
from spacerobot.scenario.plan import PlanSection
from spacerobot.scene import Scene, build_scene

TABLES, BASE_TABLES = ("position", "rate", "effort"), ("wrench", "rate")
"""Names of the values at the plan's points, of joints and of a base."""


def mpc_controllers(scene: Scene) -> dict[str, tuple[str, Replanning]]:
    """Model predictive controllers by robot: the key of the controller and its replanning settings."""
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

    Attributes:
        scene: Scene whose controllers hold the plan points of one period as parameters.
        settings: Settings common to all mpc controllers.
        joints, axes: Names of each robot's joints and of the driven axes of its base, by robot, in the order
            of the plan points.
        duration_s: Duration of the simulation [s]: that of the plan if the scenario has no phases.
        phase: Phase in which plans are made, if it is not the first one; None otherwise.
    """

    scene: Scene
    settings: Replanning
    joints: dict[str, tuple[str, ...]]
    axes: dict[str, tuple[str, ...]]
    duration_s: float
    phase: str | None = None

    @classmethod
    def of(cls, scene: Scene, vary: Collection[str] = ()) -> FlownScene:
        """Build the scene with parameters for a plan's points.

        Args:
            scene: Scene with a ``plan`` section, and a controller of kind ``mpc`` for each robot.
            vary: Dotted paths of values that are varied; a varied sensor is read even if it is ideal.

        Raises:
            ScenarioError: If the scene has no such controllers, or the plan does not fit them.
        """
        settings, plan, changes = mpc_settings(scene), first_plan(scene), dict[str, Any]()
        duration, phase = scene.scenario.simulation.duration, mpc_phase(scene)
        joints, axes = dict[str, tuple[str, ...]](), dict[str, tuple[str, ...]]()
        if not scene.scenario.phases:
            changes["simulation.duration"] = duration = plan.duration.upper
        lobatto, driven = Lobatto.of_order(plan.order), driven_coordinates(scene, plan.limits)
        mating = dict(goal.mating for goal in plan.goals.values() if goal.mating)
        active = scene.scenario.during(phase) if phase else scene.scenario
        for body in scene.robots:
            name, (key, _) = body.name, mpc_controllers(scene)[body.name]
            joints[name] = tuple(body.joint_name(scene.model, joint) for joint in body.driven_joints)
            axes[name] = tuple(driven.of_base(name))
            path = f"robots.{name}.controllers.{key}"
            for other, controller in active.robots[name].controllers.items():
                if axes[name] and other != key and controller.own_wrench:
                    raise scene.error(
                        f"acts on the base, which plans drive; write `{other}: null` where plans are made, "
                        "or leave the base to it by `limits: {base_torque: 0, base_force: 0}` of the plan",
                        f"robots.{name}.controllers.{other}",
                    )
            estimators = body.config.estimators.values() if isinstance(body.config, Robot) else ()
            estimated_signals = {signal for estimator in estimators for signal in estimator.makes}
            times = (lobatto.nodes * settings.period).tolist()
            for knots, what, columns, tables in (
                ("knots", "joints", joints[name], TABLES),
                ("base_knots", "axes", axes[name], BASE_TABLES),
            ):
                if columns:
                    rows = np.ones((lobatto.points, len(columns))).tolist()
                    points = {"times": times, "points": len(times), what: list(columns)}
                    changes[f"{path}.{knots}"] = points | dict.fromkeys(tables, rows)
            changes[f"{path}.signals"] = [
                signal
                for signal, sensor in sensors_of(scene)[name]
                if not sensor.is_ideal
                or signal in estimated_signals
                or any(f"robots.{name}.sensors.{signal}." in each for each in vary)
            ]
            changes[f"{path}.frames"] = {
                tip: link for tip, link in mating.items() if tip.startswith(f"{name}/")
            }
        if phase == next(iter(scene.scenario.phases), None):
            phase = None
        built = build_scene(scene.scenario, changes, source=scene.source)
        return cls(built, settings, joints, axes, duration, phase)

    def places(self, paths: Sequence[str]) -> NDArray[np.int64]:
        """Indices of the values of :meth:`numbers` among the parameters of a closed loop with these paths."""
        place, indices = {path: i for i, path in enumerate(paths)}, []
        for robot, (key, replanning) in mpc_controllers(self.scene).items():
            path = f"robots.{robot}.controllers.{key}"
            indices.append(place[f"{path}.begin"])
            for table, (rows, columns) in replanning.tables.items():
                cells = itertools.product(range(rows), range(columns))
                indices += [place[f"{path}.{table}.{k}.{j}"] for k, j in cells]
        return np.array(indices, dtype=np.int64)

    def resting(self, state: Array) -> Array:
        """Values as those of :meth:`numbers`, for robots that rest in their present posture.

        Args:
            state: Configuration and velocity (nq + nv, or more).
        """
        model, points = self.scene.model, first_plan(self.scene).order // 2 + 1
        values: list[Array] = []
        for body in self.scene.robots:
            angles = [joint_angle(model.joints[joint], state) for joint in body.driven_joints]
            none = np.zeros(2 * points * (len(angles) + len(self.axes[body.name])))
            values += [np.zeros(1), np.tile(angles, points), none]
        return np.concatenate(values)

    def replans_at(self, begin: float) -> bool:
        """Whether a new plan begins at a time [s].

        The last plan before the end of the first plan's duration is kept until then; after it there are new
        plans unless the plan has phases. There is no new plan if ``min_horizon`` exceeds that duration.
        """
        plan = plan_section(self.scene)
        full_duration = first_plan(self.scene).duration.upper
        left, least = full_duration - begin, self.settings.min_horizon
        behind = left < ROUNDING * full_duration and not plan.phases
        return least <= full_duration and (left > least - ROUNDING * full_duration or behind)

    def numbers(
        self, horizon: Horizon, now: float, begin: float = 0.0, locked: Mapping[str, float] | None = None
    ) -> Array:
        """Begin and points of a plan in the period that begins at ``now``, for all robots.

        Args:
            horizon, now: Plans, and time since the first plan began [s].
            begin: Simulation time at which the first plan began [s].
            locked: Positions of joints that plans do not move [rad or m], by ``robot/joint``.
        """
        values: list[Array] = []
        for robot, names in self.joints.items():
            knots = horizon.knots(now, self.settings.period, robot)
            rests = {name: (locked or {}).get(f"{robot}/{name}", 0.0) for name in names}
            for table in TABLES:
                rows = [dict(zip(knots["joints"], row, strict=True)) for row in knots[table]]
                still = rests if table == "position" else dict.fromkeys(names, 0.0)
                knots[table] = [(still | row)[name] for row in rows for name in names]
            values += [np.array([begin + now]), *(np.array(knots[table]) for table in TABLES)]
            if self.axes[robot]:
                values += [table.ravel() for table in horizon.base_knots(now, self.settings.period, robot)]
        return np.concatenate(values)


def mpc_settings(scene: Scene) -> Replanning:
    """Settings common to all mpc controllers: period, delay, and the rule for the last plan.

    Args:
        scene: Scene with a controller of kind ``mpc`` for each robot.

    Raises:
        ScenarioError: If robots' settings differ, a robot has no such controller, the plan's start is free,
            its duration is free or not a multiple of the period, or as for :func:`mpc_phase`.
    """
    controllers, plan = mpc_controllers(scene), first_plan(scene)
    for body in scene.robots:
        if body.name not in controllers:
            raise scene.error(
                "has no controller of kind mpc; a plan moves the joints of all robots",
                f"robots.{body.name}.controllers",
            )
    leads = [lead for _, lead in controllers.values()]
    for key in ("period", "min_horizon", "delay", "iterations"):
        if len({getattr(lead, key) for lead in leads}) > 1:
            message = f"controllers of kind mpc differ in {key}, allowed: one for all robots"
            raise scene.error(message, "robots")
    settings = leads[0]
    where = (
        "plan" if not plan_section(scene).phases else f"plan.phases.{next(iter(plan_section(scene).phases))}"
    )
    if plan.start:
        message = "found a free start, allowed with kind mpc: none"
        raise scene.error(message, f"{where}.start")
    count, timed = plan.duration.upper / settings.period, plan.duration
    if timed.lower != timed.upper or abs(count - round(count)) > ROUNDING * count:
        free = "" if timed.lower == timed.upper else f"{timed.lower:g} to "
        raise scene.error(
            f"found {free}{timed.upper:g} s, allowed with kind mpc: "
            f"one number, so many periods of {settings.period:g} s",
            f"{where}.duration",
        )
    mpc_phase(scene)
    return settings


def mpc_phase(scene: Scene) -> str | None:
    """Name of the phase in which plans are made; None if the scenario has no phases.

    Raises:
        ScenarioError: If there are several such phases or none, a robot's mpc controller is inactive in it,
            the phase is entered again, or a plan that begins in a later phase has phases itself.
    """
    phases, mpc_phases = scene.scenario.phases, dict[str, None]()
    for name, (robot, (key, _)) in itertools.product(phases, mpc_controllers(scene).items()):
        if key in scene.scenario.during(name).robots[robot].controllers:
            mpc_phases[name] = None
            if len(mpc_phases) > 1:
                raise scene.error(
                    f"plans are made in one phase alone, found them in {next(iter(mpc_phases))!r} too; write "
                    f"`{key}: null` in one of them",
                    f"phases.{name}.robots.{robot}.controllers",
                )
    if not phases:
        return None
    if not mpc_phases:
        message = "none has the controllers of kind mpc, which rest in all of them"
        raise scene.error(message, "phases")
    (phase,) = mpc_phases
    for robot, (key, _) in mpc_controllers(scene).items():
        if key not in scene.scenario.during(phase).robots[robot].controllers:
            message = "rests in the phase in which plans are made and flown; they move all robots"
            where = f"phases.{phase}.robots.{robot}.controllers.{key}"
            raise scene.error(message, where)
    for name, follows in successors(phases).items():
        if phase in follows and name in reached_from(phase, phases):
            message = f"leads back to {phase!r}; plans are made in it once"
            raise scene.error(message, f"phases.{name}")
    if phase != next(iter(phases)) and plan_section(scene).phases:
        message = f"found phases, allowed where plans are made in {phase!r}: none; give the plan's own keys"
        raise scene.error(message, "plan.phases")
    return phase
