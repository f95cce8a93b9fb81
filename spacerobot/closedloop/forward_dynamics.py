"""Accelerations of the closed loop: ideal derivatives and rigid grasps solved exactly, together.

The unknowns are the channel outputs u that depend on the acceleration (ideal derivative) and the wrenches
w of the rigid grasps. The acceleration is linear in both,

    v' = a_0 + A_u u + A_w w,

every column of A being the response to a unit load on one articulated-body factorisation. With
``u = command - K_d (C v' + ...)`` and ``G v' + drift = 0`` a small system remains,

    [1 + K_d C A_u      K_d C A_w] [u]   [command - K_d C a_0]
    [G A_u              G A_w    ] [w] = [-drift - G a_0     ].

Where torques are limited, u is the controller's command as if they were not; the clipped torques then act,
and the wrenches are solved for once more.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from spacerobot.closedloop.grasps import Constraint, Coupling, opposite
from spacerobot.closedloop.joint_control import JointControl
from spacerobot.closedloop.parameters import Constants, Parameters
from spacerobot.closedloop.plant import Plant
from spacerobot.closedloop.tip_control import Channel
from spacerobot.dynamics import Wrench
from spacerobot.scenario import Robot


@dataclass(frozen=True)
class Solution:
    """What the closed loop does at one instant.

    Attributes
    ----------
    acceleration
        v' (nv x 1).
    torque
        Actuator torques, as generalized forces (nv x 1).
    wrenches
        Force and torque of each rigid grasp on its target at the tip's point (pairs of 3x1), in the
        constraints' order.
    """

    acceleration: ca.SX
    torque: ca.SX
    wrenches: tuple[tuple[ca.SX, ca.SX], ...]


def solve_accelerations(
    plant: Plant,
    channels: Sequence[Channel],
    joint_controls: Sequence[JointControl],
    couplings: Sequence[Coupling],
    constraints: Sequence[Constraint],
    parameters: Parameters,
    constants: Constants,
) -> Solution:
    """Accelerations, actuator torques and constraint wrenches."""
    wrenches = [w for c in couplings for w in opposite(c.relative, c.force, c.torque)]
    ideal = [channel for channel in channels if channel.derivative_gain is not None]
    columns = {channel.name: _unit_responses(plant, channel) for channel in _needed(channels, joint_controls)}
    known = ca.SX(plant.v.size1(), 1)
    for channel in channels:
        if channel.derivative_gain is None:
            known = known + ca.mtimes(channel.actuation, channel.command)
    for control in joint_controls:
        known = known + _projected(plant, control, channels, columns)
    loads = _constraint_responses(plant, constraints)
    free = plant.acceleration(known, wrenches)
    outputs, reactions = _solve(free, ideal, constraints, [columns[c.name] for c in ideal], loads)

    torque, acceleration = known, free
    for channel, output in zip(ideal, outputs, strict=True):
        torque = torque + ca.mtimes(channel.actuation, output)
        acceleration = acceleration + ca.mtimes(columns[channel.name], output)
    clipped = _clip(plant, torque, parameters, constants)
    if clipped is not None:
        torque, acceleration = clipped, plant.acceleration(clipped, wrenches)
        _, reactions = _solve(acceleration, [], constraints, [], loads)
    for load, reaction in zip(loads, reactions, strict=True):
        acceleration = acceleration + ca.mtimes(load, reaction)
    return Solution(acceleration, torque, _as_wrenches(constraints, reactions))


def _needed(channels: Sequence[Channel], joint_controls: Sequence[JointControl]) -> list[Channel]:
    """Channels whose unit responses are used: ideal derivatives, and those a null space is taken of."""
    projected = {control.body.name for control in joint_controls if control.null_space}
    return [c for c in channels if c.derivative_gain is not None or c.tip.body.name in projected]


def _unit_responses(plant: Plant, channel: Channel) -> ca.SX:
    """Acceleration for each unit output of a channel (nv x n)."""
    units = [plant.response(channel.actuation[:, k]) for k in range(channel.size)]
    return ca.horzcat(*units)


def _constraint_responses(plant: Plant, constraints: Sequence[Constraint]) -> list[ca.SX]:
    """Acceleration for each unit constraint wrench (nv x n)."""
    responses = []
    for constraint in constraints:
        columns = []
        for force, torque in constraint.directions:
            pair: Sequence[Wrench] = opposite(constraint.relative, force, torque)
            columns.append(plant.response(wrenches=pair))
        responses.append(ca.horzcat(*columns))
    return responses


def _projected(
    plant: Plant, control: JointControl, channels: Sequence[Channel], columns: dict[str, ca.SX]
) -> ca.SX:
    """Torque of a joint PD; in the null space, without the part that accelerates the robot's tips.

    Subtracted is ``J^T F`` with the tip force F that cancels the acceleration the tips' feedback would see.
    """
    own = [channel for channel in channels if channel.tip.body.name == control.body.name]
    if not control.null_space or not own:
        return control.torque
    feedback = ca.vertcat(*(channel.feedback for channel in own))
    actuation = ca.horzcat(*(channel.actuation for channel in own))
    responses = ca.horzcat(*(columns[channel.name] for channel in own))
    seen = ca.mtimes(feedback, plant.response(control.torque))
    force = eliminate(ca.mtimes(feedback, responses), seen)
    return control.torque - ca.mtimes(actuation, force)


def _solve(
    free: ca.SX,
    ideal: Sequence[Channel],
    constraints: Sequence[Constraint],
    columns: Sequence[ca.SX],
    loads: Sequence[ca.SX],
) -> tuple[list[ca.SX], list[ca.SX]]:
    """Outputs of ideal channels and constraint wrenches, one vector each."""
    rows, right = [], []
    responses = [*columns, *loads]
    if not responses:
        return [], []
    for i, channel in enumerate(ideal):
        gain = ca.SX(channel.size, 1) if channel.derivative_gain is None else channel.derivative_gain
        weighted = ca.mtimes(ca.diag(gain), channel.feedback)
        blocks = [ca.mtimes(weighted, response) for response in responses]
        blocks[i] = blocks[i] + ca.SX.eye(channel.size)
        rows.append(ca.horzcat(*blocks))
        right.append(channel.command - ca.mtimes(weighted, free))
    for constraint in constraints:
        rows.append(ca.horzcat(*(ca.mtimes(constraint.jacobian, response) for response in responses)))
        right.append(-constraint.drift - ca.mtimes(constraint.jacobian, free))
    solution = eliminate(ca.vertcat(*rows), ca.vertcat(*right))
    sizes = [channel.size for channel in ideal] + [constraint.size for constraint in constraints]
    starts = [sum(sizes[:i]) for i in range(len(sizes) + 1)]
    parts = [solution[a:b] for a, b in itertools.pairwise(starts)]
    return parts[: len(ideal)], parts[len(ideal) :]


def eliminate(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solution of a small linear system by elimination without pivoting, structural zeros skipped (n x 1).

    Safe here because the leading blocks are ``1 + K_d C A`` and, behind them, minus a mobility: well away
    from singular unless the posture itself is.
    """
    size = matrix.size1()
    a, b = ca.SX(matrix), [right[i] for i in range(size)]
    for k in range(size):
        inverse = 1 / a[k, k]
        for i in range(k + 1, size):
            if not a.sparsity().has_nz(i, k):
                continue
            factor = a[i, k] * inverse
            for j in range(k + 1, size):
                if a.sparsity().has_nz(k, j):
                    a[i, j] = a[i, j] - factor * a[k, j]
            b[i] = b[i] - factor * b[k]
    for k in reversed(range(size)):
        total = b[k]
        for j in range(k + 1, size):
            if a.sparsity().has_nz(k, j):
                total = total - a[k, j] * b[j]
        b[k] = total / a[k, k]
    return ca.vertcat(*b)


def _clip(plant: Plant, torque: ca.SX, parameters: Parameters, constants: Constants) -> ca.SX | None:
    """Torques within their limits; none if no robot has limits."""
    limited = [b for b in plant.scene.robots if isinstance(b.config, Robot) and b.config.torque_limits]
    if not limited:
        return None
    clipped = ca.SX(torque)
    for body in limited:
        for name in body.config.joints:
            column = plant.model.joints[plant.model.getJointId(f"{body.name}/{name}")].idx_v
            path = f"{body.path}.joints.{name}.torque_limit"
            limit = constants.hoist(path, parameters(path))
            clipped[column] = ca.fmin(ca.fmax(torque[column], -limit), limit)
    return clipped


def _as_wrenches(
    constraints: Sequence[Constraint], reactions: Sequence[ca.SX]
) -> tuple[tuple[ca.SX, ca.SX], ...]:
    wrenches = []
    for constraint, reaction in zip(constraints, reactions, strict=True):
        force, torque = ca.SX(3, 1), ca.SX(3, 1)
        for k, (along, about) in enumerate(constraint.directions):
            force, torque = force + along * reaction[k], torque + about * reaction[k]
        wrenches.append((force, torque))
    return tuple(wrenches)
