"""Actuation of floating bases: wrench limits of the section, else those of the scenario's actuators.

`base_wrench` and `reaction_wheels` define a box of wrenches. For thrusters the box is inscribed in the set of
wrenches that they can produce, as large as possible with sides in the ratio of the maximum single-axis
wrenches.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from optim.planning.formulation.reaction_wheels import only_wheels
from spacerobot.common.arrays import Array
from spacerobot.elements.limits.plan_limit import PlanLimit, WrenchPart
from spacerobot.scenario.bodies import Robot
from spacerobot.scenario.plan import PlanSection
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody

PARTS: dict[WrenchPart, int] = {"force": 0, "torque": 3}
"""First index of each part of a wrench in the vector (6,): force [N] 0, torque [N m] 3."""


@dataclass(frozen=True)
class BaseWrenchLimits:
    """Largest wrench that a base's actuators deliver.

    Attributes:
        largest: Maximum force along [N] and torque about [N m] each axis of the root link (6,).
        source: Text that names the actuators behind the limits which the section does not set.
    """

    largest: Array
    source: str = ""


def base_wrench_limits(limits: Mapping[str, PlanLimit], body: SceneBody, planar: bool) -> BaseWrenchLimits:
    """Limits of a floating base."""
    wrench_limits = section_base_limits(limits)
    most, sources = np.zeros(6), dict[str, None]()
    # Largest force and torque by axis, each with the actuators that set it. Several actuators work in series,
    # so limits are combined from the last actuator on. Wheels count where no other actuator sets a part.
    actuator_limits: dict[WrenchPart, tuple[Array, str]] = {}
    driven_by = body.config.driven_by() if isinstance(body.config, Robot) else ()
    acting = [(where.rpartition(".")[2], one) for where, one in driven_by]
    for name, one in reversed([named for named in acting if named[1].momentum_storage() is None]):
        for part, values in one.wrench_limits(planar=planar).items():
            after, names = actuator_limits.get(part, (None, ""))
            joined = values if after is None else one.joined_limits(values, after)
            actuator_limits[part] = joined, f"{name} and {names}" if names else name
    for name, one in acting:
        if one.momentum_storage() is not None:
            for part, values in one.wrench_limits(planar=planar).items():
                actuator_limits.setdefault(part, (values, name))
    if only_wheels(body) is not None and wrench_limits.get("force"):
        actuator_limits = {"torque": actuator_limits["torque"]}
    for part, first in PARTS.items():
        if part in wrench_limits:
            most[first : first + 3] = wrench_limits[part]
        elif part in actuator_limits:
            values, name = actuator_limits[part]
            most[first : first + 3] = values
            sources[name] = None
    if sources and only_wheels(body) is not None and not most[:3].any():
        most[3:] = np.inf  # the motors' own limits hold, wheel by wheel
    return BaseWrenchLimits(most, " and ".join(sources))


def section_base_limits(limits: Mapping[str, PlanLimit]) -> dict[WrenchPart, float]:
    """Section's lowest limits of the force [N] and the torque [N m] on bases.

    A part without a limit is absent.
    """
    lowest = dict[WrenchPart, float]()
    for limit in limits.values():
        for part, value in limit.base_limits().items():
            lowest[part] = min(value, lowest.get(part, np.inf))
    return lowest


def limiting_actuators(scene: Scene, plans: Iterable[PlanSection]) -> dict[str, str]:
    """Actuators that limit each robot's base because the section sets no limit, by robot."""
    bodies = [body for body in scene.robots if body.root_joint]
    sources = {
        body.name: dict.fromkeys(base_wrench_limits(plan.limits, body, scene.planar).source for plan in plans)
        for body in bodies
    }
    return {name: ", ".join(filter(None, actuators)) for name, actuators in sources.items() if any(actuators)}
