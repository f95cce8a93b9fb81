"""What may become small: each term is the integrand of one field of the `costs` section."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import casadi as ca
import numpy as np

from optim.planning.formulation.stage import Stage
from spacerobot.dynamics import forward_kinematics
from spacerobot.dynamics.joints import exact_directions
from spacerobot.scenario.plan import Costs
from spacerobot.scene import Scene


def cost_terms(stage: Stage, costs: Costs) -> dict[str, ca.SX]:
    """Integrands by name, without their weights; those whose weight is zero are left out."""
    return {name: TERMS[name](stage) for name in TERMS if getattr(costs, name)}


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


TERMS: Mapping[str, Callable[[Stage], ca.SX]] = {
    "torque": lambda stage: ca.sumsqr(_driven(stage, True)),
    "joint_rate": lambda stage: ca.sumsqr(stage.v[_columns(stage)]),
    "joint_acceleration": lambda stage: ca.sumsqr(stage.a[_columns(stage)]),
    "base_rotation": lambda stage: _squares(list(base_turns(stage).values())),
    "base_translation": lambda stage: _squares(list(base_shifts(stage).values())),
    "base_wrench": lambda stage: ca.sumsqr(_driven(stage, False)),
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
    "grip_force": "N",
    "grip_torque": "N m",
    "time": "s",
}
"""Unit of the root of each integrand."""
