"""Forward dynamics with articulated bodies (Featherstone 2008, Table 7.1).

The work is split as a closed loop needs it: :meth:`ArticulatedBody.factorise` depends on the posture alone,
and amounts to factors of the inverse inertia matrix (Rodriguez, Jain and Kreutz-Delgado 1991),

    M^-1 = N^T D^-1 N,   D diagonal.

A backward sweep *reduces* a load tau to N tau (:meth:`ArticulatedBody.reduced`). The acceleration along one
load that another load causes is then a product of nv numbers (:meth:`ArticulatedBody.negated_mobility`). A
forward sweep (:meth:`ArticulatedBody.motion`) gives the acceleration of all joints. Velocity terms enter as
loads: the inertia forces at zero joint acceleration, from the kinematics.

A spatial inertia maps (linear acceleration of the joint origin, angular acceleration) to (force, torque
about the origin) as a symmetric 6x6 matrix ``[[M, G], [G^T, J]]``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca

from spacerobot.dynamics.algebra import (
    SymmetricFactors,
    cross,
    cross_columns,
    inertia_torque,
    mirror,
    rotate_square,
    rotate_symmetric,
)
from spacerobot.dynamics.inertias import Inertias, sparse_rotor_inertia
from spacerobot.dynamics.joints import sparse
from spacerobot.dynamics.kinematics import Kinematics
from spacerobot.dynamics.local_motion import LocalMotion
from spacerobot.dynamics.recorded import recorded

if TYPE_CHECKING:
    import pinocchio


@dataclass(frozen=True)
class Wrench:
    """Force and torque applied to a joint's body, or n load cases of them, world axes.

    Attributes:
        joint_id: The body's joint; a wrench on the universe (0) does nothing.
        force: N, 3xn, acting at ``point``.
        torque: N m, 3xn, in addition to the force's own moment.
        point: World position of the point of attack, m, 3x1.
    """

    joint_id: int
    force: ca.SX
    torque: ca.SX
    point: ca.SX


@dataclass(frozen=True)
class _Elimination:
    """Factors of a joint's articulated inertia after its own motion was eliminated.

    The joint's motion subspace is ``A T``: A (6xk) has unit vectors as columns if possible, T (kxk) is
    orthogonal.

    Attributes:
        rows: Rows of the unit vectors if A consists of unit vectors; else ``None``.
        axes: A.
        turn: T, from velocity coordinates to coordinates along A.
        factors: Factors of ``D = A^T I A`` (plus the reflected rotor inertia).
        gain: ``K = -I A D^-1``, 6xk, the rows of :attr:`rows` left out (they are minus the identity).
    """

    rows: tuple[int, ...] | None
    axes: ca.SX
    turn: ca.SX
    factors: SymmetricFactors
    gain: ca.SX


@dataclass(frozen=True)
class ArticulatedBody:
    """Articulated-body factorisation of the inertia matrix at one posture.

    Build it with :meth:`factorise`; the cost of that and of every sweep is linear in the number of joints.

    Attributes:
        model, kinematics: The system and its posture.
        bodies: Mass, first moment and rotational inertia of every body in calculation axes.
        eliminations: Factors of each joint, without the universe.
    """

    model: pinocchio.Model
    kinematics: Kinematics
    bodies: tuple[tuple[ca.SX, ca.SX, ca.SX], ...]
    eliminations: tuple[_Elimination, ...]

    @classmethod
    def factorise(
        cls,
        model: pinocchio.Model,
        kinematics: Kinematics,
        inertias: Inertias,
    ) -> ArticulatedBody:
        """Eliminate every joint, from the leaves to the roots.

        Args:
            model, kinematics, inertias: The system and its posture.
        """
        rotor = sparse_rotor_inertia(model)
        bodies = [inertias.rotated(motion.body, index) for index, motion in enumerate(kinematics.local)]
        spatial = [_rigid(*body) for body in bodies]
        eliminations: list[_Elimination] = []
        for joint in reversed(kinematics.joints):
            motion = kinematics.local[joint.index]
            elimination, rest = _eliminate(motion, spatial[joint.index], joint.rates(rotor))
            eliminations.append(elimination)
            if joint.parent:
                # The parent carries I + K A^T I, with the gain K = -I A D^-1 (Featherstone 2008, Table 7.1),
                # about its own origin; ``arm`` points from that to the old origin, a = skew(arm):
                # G' = G - M a (``moved``), J' = J - G^T a + a G' (``turned``).
                inertia = _rotated(rest, motion.to_parent)
                mass, coupling, rotational = inertia[:3, :3], inertia[:3, 3:], inertia[3:, 3:]
                moved = coupling + cross_columns(motion.arm, mass).T
                turned = rotational + cross_columns(motion.arm, coupling).T + cross_columns(motion.arm, moved)
                shifted = mirror(ca.vertcat(ca.horzcat(mass, ca.SX(3, 3)), ca.horzcat(moved.T, turned)))
                spatial[joint.parent] = mirror(spatial[joint.parent] + shifted)
        return cls(model, kinematics, tuple(bodies), tuple(reversed(eliminations)))

    def reduced(
        self, tau: ca.SX | None = None, wrenches: Iterable[Wrench] = (), *, moving: bool = False
    ) -> ca.SX:
        """Loads reduced by a backward sweep, ``N (tau + sum J^T f)``.

        The entries of joints that carry no load are structurally zero.

        One sweep reduces any number n of load cases, the columns of the result (nvxn).

        Args:
            tau: Generalised force in velocity coordinates, nvxn; may be sparse.
            wrenches: Applied forces and couples.
            moving: Whether gravity and the inertia forces at the current velocity are added to the loads;
                requires n = 1.
        """
        wrenches = tuple(wrenches)
        cases = load_cases(tau, wrenches)
        loads = applied_loads(self.model, self.kinematics, wrenches, cases)
        if moving:
            for joint in self.kinematics.joints:
                motion, body = self.kinematics.local[joint.index], self.bodies[joint.index]
                loads[joint.index] = loads[joint.index] - inertia_force(self.model, motion, body)
        # Backward sweep: the joint force u = T tau + A^T p is reduced to L^-1 u; the parent carries p + K u.
        efforts = ca.SX(self.model.nv, cases) if tau is None else tau
        reduced: list[ca.SX] = []
        for joint in reversed(self.kinematics.joints):
            index, elimination = joint.index, self.eliminations[joint.index - 1]
            effort = joint.rates(efforts)
            if not (effort.nnz() or loads[index].nnz()):
                reduced.append(effort)
                continue
            effort = ca.mtimes(elimination.turn, effort)
            drive = effort + ca.mtimes(elimination.axes.T, loads[index])
            reduced.append(elimination.factors.reduced(drive))
            if joint.parent:
                # load that reaches the parent through the joint, 6xn
                passed = loads[index] + ca.mtimes(elimination.gain, drive)
                if elimination.rows is not None:
                    # Along its own axes a joint transmits exactly the reaction to its own effort.
                    passed[list(elimination.rows), :] = -effort
                motion = self.kinematics.local[index]
                force = motion.outward(passed[:3, :])
                torque = motion.outward(passed[3:, :]) + cross_columns(motion.arm, force)
                loads[joint.parent] = loads[joint.parent] + ca.vertcat(force, torque)
        return ca.vertcat(*reversed(reduced))

    def motion(self, reduced: ca.SX) -> ca.SX:
        """Acceleration that reduced loads cause: ``N^T D^-1 reduced``, v-dot in velocity coordinates, nv."""
        accelerations = [ca.SX(6, 1)] * self.model.njoints
        result: list[ca.SX] = []
        for joint in self.kinematics.joints:
            elimination = self.eliminations[joint.index - 1]
            carried = self.kinematics.local[joint.index].carried(accelerations[joint.parent])
            # acceleration of the parent at this joint (6x1); then the joint's rate of velocity along A (kx1):
            # a_rel = D^-1 u + K^T a_parent, so that a = a_parent + A a_rel
            factors = elimination.factors
            driven = factors.restored(ca.mtimes(ca.diag(factors.negated_pivots), joint.rates(reduced)))
            relative = ca.mtimes(elimination.gain.T, carried) - driven
            if elimination.rows is None:
                accelerations[joint.index], rate = carried + ca.mtimes(elimination.axes, relative), relative
            else:
                rows = list(elimination.rows)
                moved = ca.SX(carried)
                moved[rows] = relative
                accelerations[joint.index], rate = moved, relative - carried[rows]
            result.append(ca.mtimes(elimination.turn.T, rate))
        return ca.vertcat(*result)

    def resistance(self, acceleration: ca.SX) -> ca.SX:
        """Reduced loads that cause an acceleration from rest: ``N M a``, nv, the inverse of :meth:`motion`.

        Args:
            acceleration: v-dot in velocity coordinates, nv; may be sparse.
        """
        carried = [ca.SX(6, 1)] * self.model.njoints
        result: list[ca.SX] = []
        for joint in self.kinematics.joints:
            elimination = self.eliminations[joint.index - 1]
            passed = self.kinematics.local[joint.index].carried(carried[joint.parent])
            relative = ca.mtimes(elimination.turn, joint.rates(acceleration))
            carried[joint.index] = passed + ca.mtimes(elimination.axes, relative)
            if elimination.rows is not None:
                relative = relative + passed[list(elimination.rows)]
            driven = relative - ca.mtimes(elimination.gain.T, passed)
            result.append(elimination.factors.unreduced(driven))
        return ca.vertcat(*result)

    def inertia_force(self, joints: Iterable[int]) -> tuple[ca.SX, ca.SX]:
        """Force and torque that move bodies as at zero joint acceleration, gravity removed.

        Args:
            joints: Ids of the bodies' joints, each after its parent. The first one carries all others, and
                the torque is about its origin; 3x1 each, world axes.
        """
        loads = [ca.SX(6, 1)] * self.model.njoints
        root, *behind = joints
        for index in reversed((root, *behind)):
            motion = self.kinematics.local[index]
            loads[index] = loads[index] + inertia_force(self.model, motion, self.bodies[index])
            if index != root:
                parent = self.kinematics.joints[index - 1].parent
                force = motion.outward(loads[index][:3])
                torque = motion.outward(loads[index][3:]) + cross(motion.arm, force)
                loads[parent] = loads[parent] + ca.vertcat(force, torque)
        in_world = self.kinematics.local[root].in_world
        return in_world(loads[root][:3]), in_world(loads[root][3:])

    def negated_mobility(self, rows: ca.SX, columns: ca.SX) -> ca.SX:
        """Acceleration along loads B (m of them) that loads A (n) cause, negated: ``-B^T M^-1 A``, mxn.

        Args:
            rows, columns: B and A, :meth:`reduced`, nvxm and nvxn.
        """
        pivots = ca.vertcat(*(elimination.factors.negated_pivots for elimination in self.eliminations))
        return ca.mtimes(rows.T, ca.mtimes(ca.diag(pivots), columns))

    def response(self, tau: ca.SX | None = None, wrenches: Iterable[Wrench] = ()) -> ca.SX:
        """Acceleration that loads alone cause: ``M^-1 (tau + sum J^T f)``, nv.

        Joints that carry no load cost nothing in the backward sweep; velocity and gravity are left out.

        Args:
            tau, wrenches: As for :meth:`reduced`.
        """
        return self.motion(self.reduced(tau, wrenches))

    def acceleration(self, tau: ca.SX | None = None, wrenches: Iterable[Wrench] = ()) -> ca.SX:
        """Forward dynamics: v-dot in Pinocchio's velocity coordinates, nv.

        Args:
            tau, wrenches: As for :meth:`reduced`; the model's gravity is added.
        """
        return self.motion(self.reduced(tau, wrenches, moving=True))


def load_cases(tau: ca.SX | None, wrenches: Iterable[Wrench]) -> int:
    """Number n of load cases of a generalised force and wrenches."""
    loads = [wrench.force for wrench in wrenches] if tau is None else [tau]
    return loads[0].size2() if loads else 1


def applied_loads(
    model: pinocchio.Model, kinematics: Kinematics, wrenches: Iterable[Wrench], cases: int = 1
) -> list[ca.SX]:
    """Applied (force, torque about the joint origin) by joint, calculation axes, 6xcases each."""
    loads = [ca.SX(6, cases)] * model.njoints
    for wrench in wrenches:
        axes = kinematics.local[wrench.joint_id].axes
        lever = wrench.point - kinematics.origin[wrench.joint_id]
        torque = wrench.torque + cross_columns(lever, wrench.force)
        load = ca.vertcat(ca.mtimes(axes.T, wrench.force), ca.mtimes(axes.T, torque))
        loads[wrench.joint_id] = loads[wrench.joint_id] + load
    return loads


def inertia_force(model: pinocchio.Model, motion: LocalMotion, body: tuple[ca.SX, ca.SX, ca.SX]) -> ca.SX:
    """Wrench that moves a body as at zero joint acceleration, gravity removed, 6x1."""
    mass, moment, rotational = body
    gravity = ca.mtimes(motion.axes.T, sparse(model.gravity.linear))
    turning = inertia_torque(rotational, motion.products, motion.gradient, motion.spin_bias)
    return _inertia_force(mass, moment, motion.velocity_bias - gravity, motion.gradient, turning)


@recorded((1, 1), (3, 1), (3, 1), (3, 3), (3, 1))
def _inertia_force(mass: ca.SX, moment: ca.SX, felt: ca.SX, gradient: ca.SX, turning: ca.SX) -> ca.SX:
    return ca.vertcat(mass * felt + ca.mtimes(gradient, moment), cross(moment, felt) + turning)


@recorded((1, 1), (3, 1), (3, 3))
def _rigid(mass: ca.SX, moment: ca.SX, rotational: ca.SX) -> ca.SX:
    """Spatial inertia of one body about its joint origin, 6x6."""
    coupling = -cross_columns(moment, ca.SX.eye(3))
    return mirror(
        ca.vertcat(
            ca.horzcat(mass * ca.SX.eye(3), ca.SX(3, 3)),
            ca.horzcat(coupling.T, rotational),
        )
    )


def _eliminate(motion: LocalMotion, inertia: ca.SX, rotor: ca.SX) -> tuple[_Elimination, ca.SX]:
    """Factors of a joint, and the articulated inertia ``I + K A^T I`` that its parent has to carry."""
    rows, axes, turn = _subspace(motion)
    if rows is not None and not rotor.nnz():
        others = [row for row in range(6) if row not in rows]
        factors = SymmetricFactors(inertia[list(rows), list(rows)])
        gain, rest = ca.SX(6, len(rows)), ca.SX(6, 6)
        if others:
            force = inertia[others, list(rows)]
            gain[others, :] = factors.solve_negated(force.T).T
            rest[others, others] = mirror(inertia[others, others] + ca.mtimes(gain[others, :], force.T))
        return _Elimination(rows, axes, turn, factors, gain), rest
    force = ca.mtimes(inertia, axes)
    reflected = ca.mtimes(turn, ca.mtimes(ca.diag(rotor), turn.T))
    factors = SymmetricFactors(ca.mtimes(axes.T, force) + reflected)
    gain = factors.solve_negated(force.T).T
    return _Elimination(None, axes, turn, factors, gain), mirror(inertia + ca.mtimes(gain, force.T))


def _subspace(motion: LocalMotion) -> tuple[tuple[int, ...] | None, ca.SX, ca.SX]:
    """Motion subspace as ``A T``; A consists of unit vectors if no more rows than columns are non-zero."""
    subspace = ca.vertcat(motion.linear, motion.angular)
    rows = tuple(row for row in range(6) if subspace[row, :].nnz())
    if len(rows) != subspace.size2():
        return None, subspace, ca.SX.eye(subspace.size2())
    axes = ca.SX(6, len(rows))
    for column, row in enumerate(rows):
        axes[row, column] = 1
    return rows, axes, subspace[list(rows), :]


def _rotated(inertia: ca.SX, rotation: ca.SX | None) -> ca.SX:
    """Articulated inertia in the parent's calculation axes, 6x6; ``None`` means that they are the same."""
    if rotation is None:
        return inertia
    mass, rotational = (rotate_symmetric(rotation, inertia[rows, rows]) for rows in (slice(3), slice(3, 6)))
    coupling = rotate_square(rotation, inertia[:3, 3:])
    return mirror(ca.vertcat(ca.horzcat(mass, ca.SX(3, 3)), ca.horzcat(coupling.T, rotational)))
