r"""Accelerations of the closed loop: ideal derivatives and rigid grasps solved exactly, together.

The unknowns are the channel outputs $u$ that depend on the acceleration (ideal derivative) and the wrenches
$w$ of the rigid grasps on their tips. The acceleration is linear in both,

$$ \dot v = a_0 + M^{-1} (J_u^\top u + G^\top w), $$

with the manipulator Jacobians $J_u$ and the constraints $G \dot v + d_G = 0$: rigid grasps, and joints that
mimic others, of which $w$ is then a torque. With $u = c - K_d\,(C \dot v + d)$ a small system remains,

$$ \begin{bmatrix} 1 + K_d C M^{-1} J_u^\top & K_d C M^{-1} G^\top \\
                   G M^{-1} J_u^\top & G M^{-1} G^\top \end{bmatrix}
   \begin{bmatrix} u \\ w \end{bmatrix} =
   \begin{bmatrix} c - K_d\,(C a_0 + d) \\ -d_G - G a_0 \end{bmatrix} $$

All loads are reduced first (:mod:`spacerobot.dynamics.articulated`), which makes each entry a product of few
numbers, those of the joints that both loads pass through.

A constraint that is not active keeps its place: its loads are masked, and its rows state $w = 0$.

If actuators act between command and joints, $u$ is first solved as if they delivered every command. Then
their delivered forces replace $u$, and the wrenches are solved for once more. Actuators that act on other
coordinates, those of a base or of joints that belong to no arm, deliver before.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca

from spacerobot.closedloop.impulse import idleness, masked
from spacerobot.elements import (
    AccelerationConstraint,
    ActuatorDrive,
    CommandedTorque,
    Contribution,
    ControlChannel,
    both,
)
from spacerobot.elements.core.contribution import SampledLaw, concatenate, jointly
from spacerobot.symbolic import Plant


@dataclass(frozen=True)
class ForwardDynamicsResult:
    """Accelerations, torques and reactions of the closed loop at one instant.

    Attributes:
        acceleration: Acceleration v' (nv x 1).
        torque: Actuator torques, as generalized forces (nv x 1).
        wrenches: Force and torque of each rigid grasp on its target at the tip's point (pairs of 3x1), in the
            constraints' order.
        driven: Contributions of actuators in addition to delivered torques.
        sampled: Present outputs of sampled laws (n x 1 each).
        commanded: Generalized forces commanded to all actuators (nv x 1).
    """

    acceleration: ca.SX
    torque: ca.SX
    wrenches: tuple[tuple[ca.SX, ca.SX], ...]
    driven: Contribution
    sampled: tuple[ca.SX, ...] = ()
    commanded: ca.SX = field(default_factory=lambda: ca.SX(0, 1))


def solve_accelerations(plant: Plant, acting: Contribution) -> ForwardDynamicsResult:
    """Accelerations, actuator torques and constraint wrenches.

    Args:
        plant: Mechanics.
        acting: Contributions of all elements.
    """
    ideal = [channel for channel in acting.channels if channel.derivative_gain is not None]
    torque = ca.SX(plant.v.size1(), 1)
    for channel in acting.channels:
        if channel.derivative_gain is None:
            torque = torque + ca.mtimes(channel.actuation, channel.command)
    for command in acting.torques:
        torque = torque + _projected(plant, command, acting)
    earlier_drives, later_drives = in_turn(acting.drives, ideal)
    commanded = torque
    torque, early = deliver(
        torque, earlier_drives, {column for drive in later_drives for column in drive.columns}
    )
    wrenches = [*acting.wrenches, *acting.outside, *early.wrenches, *early.outside]
    driven = plant.reduced_moving(torque, wrenches)
    held = [_Held.of(constraint) for constraint in acting.constraints]
    if plant.ties.size2():
        none = ca.SX(plant.ties.size2(), 1)
        held.append(_Held(plant.ties, none, none))
    outputs, reactions = _solve(plant, driven, ideal, held)
    for channel, output in zip(ideal, outputs, strict=True):
        torque = torque + ca.mtimes(channel.actuation, output)
        driven = driven + ca.mtimes(channel.drive, output)
    torque, answer = deliver(torque, later_drives)
    if later_drives:
        driven = plant.reduced_moving(torque, [*wrenches, *answer.wrenches, *answer.outside])
        _, reactions = _solve(plant, driven, [], held)
    for connection, reaction in zip(held, reactions, strict=True):
        driven = driven + ca.mtimes(connection.sense, reaction)
    acceleration = plant.articulated.motion(driven)
    pairs = zip(acting.constraints, reactions[: len(acting.constraints)], strict=True)
    on_targets = tuple(constraint.on_target(along) for constraint, along in pairs)
    laws = jointly(acting.sampled)
    sampled = tuple(_at_instant(plant, acting, law, commanded, (ideal, held)) for law in laws)
    answers = concatenate([early, answer])
    for channel, output in zip(ideal, outputs, strict=True):
        commanded = commanded + ca.mtimes(channel.actuation, output)
    return ForwardDynamicsResult(acceleration, torque, on_targets, answers, sampled, commanded)


def _at_instant(
    plant: Plant,
    acting: Contribution,
    law: SampledLaw,
    commanded: ca.SX,
    solved: tuple[Sequence[ControlChannel], Sequence[_Held]],
) -> ca.SX:
    """Outputs (n x 1) of a sampled law at its instant, solved together with the continuous ideal channels."""
    ideal, held = solved
    torque, answers = deliver(commanded - law.held, law.others(acting.drives))
    wrenches = [*acting.wrenches, *acting.outside, *answers.wrenches, *answers.outside]
    outputs, _ = _solve(plant, plant.reduced_moving(torque, wrenches), [*law.channels, *ideal], held)
    output: ca.SX = law.of(ca.vertcat(*outputs[: len(law.channels)]))
    return output


@dataclass(frozen=True)
class _Held:
    """Reduced loads (nv x n) along which v' + drift (n x 1) is zero, masked, and diagonal entries (n x 1)."""

    sense: ca.SX
    drift: ca.SX
    idle: ca.SX

    @classmethod
    def of(cls, constraint: AccelerationConstraint) -> _Held:
        """A constraint, which may not be active."""
        active = constraint.active
        return cls(
            masked(constraint.sense, active),
            masked(constraint.drift, active),
            idleness(constraint),
        )


def known_locks(constraints: Iterable[AccelerationConstraint]) -> list[AccelerationConstraint]:
    """Constraints of held joints, active only while controllers know about them."""
    locks = []
    for one in constraints:
        if one.known is not None and one.active is not None:
            locks.append(replace(one, active=both(one.active, one.known)))
    return locks


def _projected(plant: Plant, command: CommandedTorque, acting: Contribution) -> ca.SX:
    """Commanded torque; in the null space, without the part that accelerates the robot's tips.

    It subtracts ``J^T F`` with the tip force F that cancels the acceleration seen by the tips' feedback;
    joints known to be held stay fixed.
    """
    channels = [
        channel for channel in acting.channels if channel.robot == command.robot and channel.moves_tip
    ]
    if not command.null_space or not channels:
        return command.value
    locks = [_Held.of(lock) for lock in known_locks(acting.constraints)]
    held = [plant.ties, *(lock.sense for lock in locks)]
    sense = ca.horzcat(*(channel.sense for channel in channels), *held)
    actuation = ca.horzcat(*(channel.actuation for channel in channels))
    drive = ca.horzcat(*(channel.drive for channel in channels), *held)
    mobility = plant.articulated.negated_mobility
    matrix = mobility(sense, drive)
    first = matrix.size1() - len(locks)
    for i, lock in enumerate(locks):
        matrix[first + i, first + i] -= lock.idle
    force = eliminate(matrix, mobility(sense, plant.reduced(command.value)))
    return command.value - ca.mtimes(actuation, force[: actuation.size2()])


def _solve(
    plant: Plant, driven: ca.SX, ideal: Sequence[ControlChannel], held: Sequence[_Held]
) -> tuple[list[ca.SX], list[ca.SX]]:
    """Outputs of ideal channels and reactions of held constraints, one vector each.

    ``driven`` are all other loads, reduced (nv x 1).
    """
    if not ideal and not held:
        return [], []
    unknown = ca.horzcat(*(channel.drive for channel in ideal), *(connection.sense for connection in held))
    rows, right, mobility = [], [], plant.articulated.negated_mobility
    for channel in ideal:
        gain = ca.SX(channel.size, 1) if channel.derivative_gain is None else channel.derivative_gain
        rows.append(-ca.mtimes(ca.diag(gain), mobility(channel.sense, unknown)))
        right.append(channel.command + gain * mobility(channel.sense, driven))
    for connection in held:
        rows.append(mobility(connection.sense, unknown))
        right.append(connection.drift - mobility(connection.sense, driven))
    matrix = ca.vertcat(*rows)
    size = sum(channel.size for channel in ideal)
    matrix[:size, :size] += ca.SX.eye(size)
    matrix[size:, size:] -= ca.diag(ca.vertcat(ca.SX(0, 1), *(connection.idle for connection in held)))
    solution = eliminate(matrix, ca.vertcat(*right))
    sizes = [channel.size for channel in ideal] + [connection.drift.size1() for connection in held]
    starts = [sum(sizes[:i]) for i in range(len(sizes) + 1)]
    parts = [solution[a:b] for a, b in itertools.pairwise(starts)]
    return parts[: len(ideal)], parts[len(ideal) :]


def eliminate(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solution of a small linear system by elimination without pivoting, structural zeros skipped (n x 1).

    Safe without pivoting: the leading blocks are ``1 + K_d C A``, followed by minus a mobility; both are far
    from singular unless the posture itself is singular.
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


def in_turn(
    drives: Sequence[ActuatorDrive], ideal: Sequence[ControlChannel]
) -> tuple[list[ActuatorDrive], list[ActuatorDrive]]:
    """Actuators that act where no unsolved output acts, and the other actuators."""
    acting = {row for channel in ideal for row in channel.actuation.sparsity().row()}
    first: list[ActuatorDrive] = []
    dependent_drives: list[ActuatorDrive] = []
    for drive in drives:
        if acting.isdisjoint(drive.columns):
            first.append(drive)
        else:
            dependent_drives.append(drive)
            acting |= set(drive.columns)  # the next one of these places comes after it
    return first, dependent_drives


def deliver(
    torque: ca.SX, drives: Sequence[ActuatorDrive], later: Collection[int] = ()
) -> tuple[ca.SX, Contribution]:
    """Generalized forces that actuators deliver in series, and their further contributions.

    Remaining commands at the indices ``later`` are passed to actuators that come after these.
    """
    delivered, answers, undelivered = ca.SX(torque), [], set[int]()
    for drive in drives:
        columns = list(drive.columns)
        command = delivered[columns]
        delivered[columns] = drive.deliver(command)
        undelivered = undelivered.difference(columns).union(drive.passes_on)
        if drive.answer is not None:
            answers.append(drive.answer(command))
    for column in undelivered.difference(later):
        delivered[column] = ca.SX(1, 1)
    return delivered, concatenate(answers)
