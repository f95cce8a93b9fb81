"""What drives floating bases: limits of the section, else those of what the scenario has on them.

`base_wrench` and `reaction_wheels` give a box of wrenches; of thrusters it is the largest box inside all that
they can give, with the sides in the ratio of what each axis gets alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from optim.planning.formulation.wheels import axes_of_wheels, wheels_alone
from spacerobot.arrays import Array
from spacerobot.elements.actuators.base_wrench import BaseWrench
from spacerobot.elements.actuators.reaction_wheels import ReactionWheels
from spacerobot.elements.actuators.thrusters import Thrusters
from spacerobot.elements.plan_limit import PlanLimit, WrenchPart
from spacerobot.scenario.bodies import Robot
from spacerobot.scenario.plan import Planning
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody

SMALL = 1e-6
"""Part of the greatest side below which a wrench's axis counts as one that is not driven."""


PARTS: dict[WrenchPart, int] = {"force": 0, "torque": 3}
"""Where the parts of a wrench begin."""


@dataclass(frozen=True)
class Able:
    """What a base is driven by.

    Attributes
    ----------
    most
        Greatest force along [N] and torque about [N m] each axis of the root link (6,).
    told
        Where they come from, in words, for those that the section does not give.
    """

    most: Array
    told: str = ""


def able(limits: Mapping[str, PlanLimit], body: SceneBody, planar: bool) -> Able:
    """Limits of a floating base."""
    asked = base_limits(limits)
    most, told = np.zeros(6), dict[str, None]()
    own = _actuated(body, planar)
    if wheels_alone(body) is not None and asked.get("force"):
        own = {"torque": own["torque"]}
    for part, first in PARTS.items():
        if part in asked:
            most[first : first + 3] = asked[part]
        elif part in own:
            values, name = own[part]
            most[first : first + 3] = values
            told[name] = None
    if told and wheels_alone(body) is not None and not most[:3].any():
        most[3:] = np.inf  # the motors' own limits hold, wheel by wheel
    return Able(most, " and ".join(told))


def base_limits(limits: Mapping[str, PlanLimit]) -> dict[WrenchPart, float]:
    """Lowest of the section's limits of the force [N] and the torque [N m] on bases, where it gives any."""
    found = dict[WrenchPart, float]()
    for limit in limits.values():
        for part, value in limit.base_limits().items():
            found[part] = min(value, found.get(part, np.inf))
    return found


def limits_taken(scene: Scene, plans: Iterable[Planning]) -> dict[str, str]:
    """By robot, the actuators whose limits hold for its base because the section gives none."""
    bodies = [body for body in scene.robots if body.root_joint]
    told = {
        body.name: dict.fromkeys(able(plan.limits, body, scene.planar).told for plan in plans)
        for body in bodies
    }
    return {name: ", ".join(filter(None, own)) for name, own in told.items() if any(own)}


def _actuated(body: SceneBody, planar: bool) -> dict[str, tuple[Array, str]]:
    """Greatest force and torque by axis, each with the actuator that it is of."""
    found: dict[str, tuple[Array, str]] = {}
    if not isinstance(body.config, Robot):
        return found
    own = {where.rpartition(".")[2]: one for where, one in body.config.driven_by()}
    kinds = (Thrusters, BaseWrench, ReactionWheels)
    for kind, (name, one) in itertools.product(kinds, own.items()):
        if not isinstance(one, kind) or (isinstance(one, Thrusters) and one.unloads):
            continue
        for part, values in _boxes(one, planar):
            found.setdefault(part, (values, name))
    return found


def _boxes(one: Thrusters | BaseWrench | ReactionWheels, planar: bool) -> Iterator[tuple[str, Array]]:
    """Force and torque by axis that an actuator gives, however they come together."""
    if isinstance(one, BaseWrench):
        yield "force", np.full(3, np.inf if one.force is None else one.force)
        yield "torque", np.full(3, np.inf if one.torque is None else one.torque)
    elif isinstance(one, ReactionWheels):
        axes = axes_of_wheels(one)
        turns = planar or np.linalg.matrix_rank(axes) == 3
        shares = np.abs(np.linalg.pinv(axes)).sum(axis=1).max()
        limit = np.inf if one.torque_limit is None else one.torque_limit / shares
        yield "torque", np.where(np.abs(axes).max(axis=1) > SMALL, limit, 0.0) if turns else np.zeros(3)
    else:
        box = thrusters_box(one, planar)
        yield "force", box[:3]
        yield "torque", box[3:]


def thrusters_box(one: Thrusters, planar: bool) -> Array:
    """Greatest force along [N] and torque about [N m] each axis that nozzles give at once (6,)."""
    rows = [0, 1, 5] if planar else list(range(6))
    columns = []
    for nozzle in one.nozzles.values():
        line = np.array(nozzle.direction) / np.linalg.norm(nozzle.direction)
        push = (one.thrust if nozzle.thrust is None else nozzle.thrust) * line
        columns.append(np.concatenate([push, np.cross(nozzle.position, push)])[rows])
    full = np.array(columns).T
    alone = np.array([min(_reach(full, sign * side) for sign in (1, -1)) for side in np.eye(len(rows))])
    alone[alone < SMALL * alone.max(initial=0.0)] = 0.0
    found, sides = np.zeros(6), np.flatnonzero(alone)
    if sides.size:
        corners = (np.array(signs) for signs in itertools.product((1, -1), repeat=sides.size))
        onto = np.eye(len(rows))[:, sides] * alone[sides]
        found[rows] = min(_reach(full, onto @ signs) for signs in corners) * alone
    return found


def _reach(full: Array, wanted: Array) -> float:
    """How much of a wrench nozzles between shut and open give, and nothing else."""
    count = full.shape[1]
    size = np.abs(full).max(axis=1, keepdims=True) + (np.abs(full).max(axis=1, keepdims=True) == 0)
    equal = np.hstack([full, -wanted[:, None]]) / size
    cost = np.append(np.zeros(count), -1.0)
    bounds = [(0, 1)] * count + [(0, None)]
    found = linprog(cost, A_eq=equal, b_eq=np.zeros(len(wanted)), bounds=bounds)
    return float(found.x[-1]) if found.status == 0 else 0.0
