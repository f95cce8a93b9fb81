"""What may become small: each term is the integrand of one field of the `costs` section."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import casadi as ca
import numpy as np

from optim.planning.formulation.goals import Seen
from optim.planning.formulation.stage import Stage
from optim.planning.formulation.wheels import wheel_cost
from spacerobot.dynamics import Inertias, centre_of_mass, forward_kinematics, momentum, total_mass
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.joints import exact_directions, sparse
from spacerobot.elements.goals.mated import Mated
from spacerobot.scenario.plan import Costs, Planning
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody


def cost_terms(stage: Stage, costs: Costs) -> dict[str, ca.SX]:
    """Integrands by name, without their weights; those whose weight is zero are left out."""
    return {name: TERMS[name](stage) for name in TERMS if getattr(costs, name)}


def end_terms(stage: Stage, plan: Planning) -> dict[str, ca.SX]:
    """What the last instant costs, by name, without weights: squares of tips' speeds at mating frames."""
    if not plan.costs.impact_speed:
        return {}
    found = ca.SX(0)
    for name, goal in plan.goals.items():
        if isinstance(goal, Mated):
            seen = Seen(stage, f"plan.goals.{name}")
            _, speed, spin = seen.tip(goal.tip).seen_from(seen.mating(goal.frame))
            found += ca.sumsqr(speed) + (ca.sumsqr(spin) if goal.orientation else 0)
    return {"impact_speed": found}


def base_turns(stage: Stage) -> dict[str, ca.SX]:
    """Rotation vectors of the robots' floating bases since the start [rad], by robot."""
    start = _start(stage.scene)
    return {
        body.name: stage.turned(start[body.root_joint][0], stage.kinematics.rotation[body.root_joint])
        for body in stage.scene.robots
        if body.root_joint
    }


def base_shifts(stage: Stage) -> dict[str, ca.SX]:
    """Displacements of the robots' floating bases since the start (3x1) [m], by robot."""
    start = _start(stage.scene)
    return {
        body.name: stage.kinematics.origin[body.root_joint] - start[body.root_joint][1]
        for body in stage.scene.robots
        if body.root_joint
    }


def _start(scene: Scene) -> Sequence[tuple[ca.SX, ca.SX]]:
    """Rotation and origin of each joint at the start, as numbers."""
    still = forward_kinematics(scene.model, ca.SX(np.asarray(scene.q)))
    return [
        (exact_directions(np.array(ca.DM(turn))), ca.SX(ca.DM(place)))
        for turn, place in zip(still.rotation, still.origin, strict=True)
    ]


def _squares(values: Sequence[ca.SX]) -> ca.SX:
    return sum((ca.sumsqr(value) for value in values), ca.SX(0))


def _driven(stage: Stage, joints: bool) -> ca.SX:
    """What drives the joints, or the bases."""
    count = len(stage.driven.joints)
    return stage.u[:count] if joints else stage.u[count:]


def _columns(stage: Stage) -> list[int]:
    """Velocities of the joints that are driven."""
    return list(stage.driven.columns[: len(stage.driven.joints)])


def base_reactions(stage: Stage) -> dict[str, ca.SX]:
    """Wrenches that the robots' arms put on their bases, by robot: force [N], then torque about the root
    link's origin [N m], world axes, as far as the scene has them; on a fixed base with the opposite sign.

    On a floating base that is the rate of the momentum of the root link, and of wheels on it, less gravity
    and what drives the base; under a fixed one the same of the arm. Grasps act where their tips are.
    """
    found = {}
    for body in stage.scene.robots:
        wrench = _taken(stage, (body.root_joint, *body.owned) if body.root_joint else body.arm_joints, body)
        rotation = stage.placement(body.root_frame)[0]
        for name, drive in zip(stage.driven.names, ca.vertsplit(stage.u), strict=True):
            base, _, axis = name.rpartition(".")
            if base == f"{body.name}/base":
                first = 0 if axis[0] == "f" else 3
                wrench[first : first + 3] -= rotation[:, "xyz".index(axis[1])] * drive
        axes = (*stage.scene.translation_axes, *(3 + axis for axis in stage.scene.rotation_axes))
        found[body.name] = wrench[list(axes)]
    return found


def _taken(stage: Stage, joints: Sequence[int], body: SceneBody) -> ca.SX:
    """Wrench (6x1) that bodies' motion takes beside gravity and grasps, about the root link's origin."""
    scene, model, moving = stage.scene, stage.scene.model, stage.kinematics
    inertias, origin = Inertias.from_model(model), stage.placement(body.root_frame)[1]
    state, rate = ca.vertcat(stage.q, stage.v), ca.vertcat(stage.rate, stage.a)
    momenta = ca.vertcat(*momentum(model, moving, inertias, joints))
    whole = ca.jtimes(momenta, state, rate)
    force, torque = whole[:3], whole[3:]
    weight = total_mass(model, inertias, joints) * sparse(np.asarray(model.gravity.linear))
    acting = [(weight, centre_of_mass(model, moving, inertias, joints))] if weight.nnz() else []
    for grip in (*stage.grips, *stage.springs):
        if int(model.frames[grip.tip.frame].parentJoint) in joints:
            pull, twist = ca.SX(3, 1), ca.SX(3, 1)
            pull[list(scene.translation_axes)], turn = stage.wrench(grip)
            if turn.numel():
                twist[list(scene.rotation_axes)] = turn
            acting.append((pull, stage.placement(grip.tip.frame)[1]))
            torque -= twist
    for pull, place in acting:
        force, torque = force - pull, torque - cross(place, pull)
    return ca.vertcat(force, torque - cross(origin, force))


def _impulse(stage: Stage) -> ca.SX:
    """Magnitudes of the forces on bases along their axes, smooth where they are small (1x1) [N]."""
    joints, found = len(stage.driven.joints), ca.SX(0)
    for k, name in enumerate(stage.driven.names):
        if k >= joints and name.rpartition(".")[2].startswith("f"):
            limit = float(stage.driven.limits[k])
            small = SMOOTH * (limit if np.isfinite(limit) else 1.0)
            found += ca.sqrt(stage.u[k] ** 2 + small**2) - small
    return found


def told(name: str, integral: float, duration: float) -> float:
    """What is told of a term: its root mean square over a duration [s]; of propellant the whole, of what the
    end costs the root.
    """
    return integral if name in WHOLE else float(np.sqrt(integral / (1 if name in ENDS else duration)))


def heading(name: str) -> str:
    """Words for what is told of a term."""
    words = name.replace("_", " ")
    return "duration" if name == "time" else words if name in (*WHOLE, *ENDS) else f"{words}, rms"


SMOOTH = 0.01
"""Part of a force's limit, of 1 N where it has none, below which its magnitude is smooth."""
WHOLE = ("propellant",)
"""Terms that are no squares: their integrals are told as they are."""
ENDS = ("impact_speed",)
"""Terms of the last instant."""
TERMS: Mapping[str, Callable[[Stage], ca.SX]] = {
    "torque": lambda stage: ca.sumsqr(_driven(stage, True)),
    "joint_rate": lambda stage: ca.sumsqr(stage.v[_columns(stage)]),
    "joint_acceleration": lambda stage: ca.sumsqr(stage.a[_columns(stage)]),
    "base_rotation": lambda stage: _squares(list(base_turns(stage).values())),
    "base_translation": lambda stage: _squares(list(base_shifts(stage).values())),
    "base_wrench": lambda stage: ca.sumsqr(_driven(stage, False)),
    "propellant": _impulse,
    "base_reaction": lambda stage: _squares(list(base_reactions(stage).values())),
    "wheel_momentum": wheel_cost,
    "grip_force": lambda stage: _squares([stage.wrench(grip)[0] for grip in (*stage.grips, *stage.springs)]),
    "grip_torque": lambda stage: _squares([stage.wrench(grip)[1] for grip in (*stage.grips, *stage.springs)]),
}
"""Integrand of each term without its weight; the duration's is none, for it is an unknown itself."""

UNITS: Mapping[str, str] = {
    "torque": "N m",
    "joint_rate": "rad/s",
    "joint_acceleration": "rad/s^2",
    "base_rotation": "rad",
    "base_translation": "m",
    "base_wrench": "N",
    "propellant": "N s",
    "impact_speed": "m/s",
    "base_reaction": "N",
    "wheel_momentum": "N m s",
    "grip_force": "N",
    "grip_torque": "N m",
    "time": "s",
}
"""Unit of what is told of each term."""
