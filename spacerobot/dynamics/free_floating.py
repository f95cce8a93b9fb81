r"""Kinematics of one free-floating robot: its base reacts to its joints by conservation of momentum.

With the base velocity $v_b$ and joint rates $r$, the momentum is $h = H_b v_b + H_{bm} r$. It is conserved
while no external load acts, so that the joint rates determine the velocities of base and tip:

$$ v_\text{tip} = J^* r + B h, \qquad J^* = J_m - J_b H_b^{-1} H_{bm}, \qquad B = J_b H_b^{-1} $$

$J^*$ is Umetani and Yoshida's generalized Jacobian. Joint rates with $H_{bm} r = 0$ leave the base at rest
(the reaction null space of Nenchev and Yoshida).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError, near_names
from spacerobot.dynamics.algebra import IDENTITY3, SymmetricFactors, cross_columns
from spacerobot.dynamics.composite import mass_matrix
from spacerobot.dynamics.inertias import Inertias
from spacerobot.dynamics.joints import JointKind, JointModel
from spacerobot.dynamics.kinematics import Kinematics, forward_kinematics, frame_jacobian
from spacerobot.dynamics.momentum import centre_of_mass, subtree

if TYPE_CHECKING:
    import pinocchio


@dataclass(frozen=True)
class FreeFloating:
    """Momentum of one free-floating subtree, split into base and joints, at one posture.

    Attributes:
        model, kinematics, inertias: The model that holds the robot, and its posture.
        base: The robot's root joint, planar (k = 3) or free-flyer (k = 6).
        columns: Velocity indices of the n joints after the base.
        base_inertia: H_b, kxk: momentum along the base's velocity coordinates per base velocity.
        base_coupling: H_bm, kxn: the same per joint rate.
    """

    model: pinocchio.Model
    kinematics: Kinematics
    inertias: Inertias
    base: JointModel
    columns: tuple[int, ...]
    base_inertia: ca.SX
    base_coupling: ca.SX

    @classmethod
    def split(
        cls, model: pinocchio.Model, kinematics: Kinematics, inertias: Inertias, root: int = 1
    ) -> FreeFloating:
        """Split the momentum of the subtree that starts at joint ``root``.

        Args:
            model: Model that holds the robot.
            kinematics, inertias: Its posture and its mass properties.
            root: Id of the robot's planar or free-flyer joint on the universe.

        Raises:
            DescriptionError: If the joint is not a planar or free-flyer joint on the universe.
        """
        base = _base(model, kinematics, root)
        ids = subtree(model, root)[1:]
        columns = tuple(c for i in ids for c in _range(kinematics.joints[i - 1]))
        rows = list(_range(base))
        still = ca.SX(model.nv, 1)  # rotors belong to the drives, not to the momentum balance of bodies
        matrix = mass_matrix(model, kinematics, inertias, rotor_inertia=still)
        return cls(
            model, kinematics, inertias, base, columns, matrix[rows, rows], matrix[rows, list(columns)]
        )

    def generalized_jacobian(self, frame_id: int) -> ca.SX:
        """J*: velocity of a frame per joint rate at zero momentum, 6xn, linear rows first, world axes."""
        jacobian = frame_jacobian(self.model, self.kinematics, frame_id)
        reaction = SymmetricFactors(self.base_inertia).solve_negated(self.base_coupling)
        base = jacobian[:, list(_range(self.base))]
        return jacobian[:, list(self.columns)] + ca.mtimes(base, reaction)

    def momentum_map(self, frame_id: int) -> ca.SX:
        """B: velocity of a frame per momentum of the robot, 6x6.

        Columns are linear momentum (N s) and angular momentum about the world's origin (N m s), as
        :func:`~spacerobot.dynamics.momentum.momentum` gives them; rows as in :meth:`generalized_jacobian`.
        """
        jacobian = frame_jacobian(self.model, self.kinematics, frame_id)
        return ca.mtimes(jacobian[:, list(_range(self.base))], self._base_velocity_per_momentum())

    def base_velocity(self, rates: ca.SX, momentum: ca.SX | None = None) -> ca.SX:
        """Base velocity that follows from joint rates and momentum.

        Args:
            rates: Joint rates, n [rad/s or m/s].
            momentum: Linear momentum [N s] and angular momentum about the world's origin [N m s], world axes,
                6; zero if ``None``.

        Returns:
            casadi.SX: Velocity of the base in Pinocchio's coordinates, k.
        """
        reaction = SymmetricFactors(self.base_inertia).solve_negated(ca.mtimes(self.base_coupling, rates))
        if momentum is None:
            return reaction
        return reaction + ca.mtimes(self._base_velocity_per_momentum(), momentum)

    def coupling(self) -> ca.SX:
        """Momentum per joint rate while the base is at rest, 6xn.

        Linear momentum (kg m), then angular momentum about the robot's centre of mass (kg m^2), world
        axes. A planar base has only the in-plane components; it cannot react to the others.
        """
        index = self.base.index
        wrench = ca.mtimes(self._base_subspace(), self.base_coupling)
        bodies = subtree(self.model, index)
        centre = centre_of_mass(self.model, self.kinematics, self.inertias, bodies)
        lever = self.kinematics.origin[index] - centre
        moved = cross_columns(lever, wrench[:3, :])
        if self.base.kind is JointKind.PLANAR:
            normal = self.kinematics.angular[index][:, 2]
            moved = ca.mtimes(normal, ca.mtimes(normal.T, moved))
        return ca.vertcat(wrench[:3, :], wrench[3:, :] + moved)

    def _base_subspace(self) -> ca.SX:
        index = self.base.index
        return ca.vertcat(self.kinematics.linear[index], self.kinematics.angular[index])

    def _base_velocity_per_momentum(self) -> ca.SX:
        """Map ``H_b^-1 S_b^T X``, kx6.

        X refers angular momentum to the base's origin instead of the world's.
        """
        lever = cross_columns(self.kinematics.origin[self.base.index], IDENTITY3)
        move = ca.vertcat(ca.horzcat(IDENTITY3, ca.SX(3, 3)), ca.horzcat(-lever, IDENTITY3))
        return -SymmetricFactors(self.base_inertia).solve_negated(ca.mtimes(self._base_subspace().T, move))


@dataclass(frozen=True)
class FreeFloatingRobot:
    """Numeric free-floating kinematics of one robot and one tip; built once, called with arrays.

    Attributes:
        columns: Velocity indices of the robot's n joints, in the order of all joint rates in this class.
        function: ``(q, momentum, rates) -> (jacobian, momentum_map, coupling, base_velocity)``.
    """

    columns: tuple[int, ...]
    function: ca.Function

    @classmethod
    def of(cls, model: pinocchio.Model, tip: str, root: str | None = None) -> FreeFloatingRobot:
        """Kinematics of the robot that carries the frame ``tip``.

        Args:
            model: Model that holds the robot; other robots in it are left out of the momentum.
            tip: Name of a frame.
            root: Name of the robot's root joint; ``None`` searches from the tip to the universe.

        Raises:
            DescriptionError: If a name is not in the model or the root is not a free base.
        """
        if not model.existFrame(tip):
            names = (frame.name for frame in model.frames)
            raise DescriptionError(f"no frame {tip!r} in the model; {near_names(tip, names)}")
        frame = model.getFrameId(tip)
        q, momentum = ca.SX.sym("q", model.nq), ca.SX.sym("momentum", 6)
        kinematics = forward_kinematics(model, q)
        if root is None:
            chain = kinematics.support(int(model.frames[frame].parentJoint))
            base = chain[0].index if chain else 0
        elif model.existJointName(root):
            base = int(model.getJointId(root))
        else:
            raise DescriptionError(f"no joint {root!r} in the model; {near_names(root, model.names)}")
        split = FreeFloating.split(model, kinematics, Inertias.from_model(model), base)
        rates = ca.SX.sym("rates", len(split.columns))
        function = ca.Function(
            "free_floating",
            [q, momentum, rates],
            [
                ca.densify(split.generalized_jacobian(frame)),
                ca.densify(split.momentum_map(frame)),
                ca.densify(split.coupling()),
                ca.densify(split.base_velocity(rates, momentum)),
            ],
            ["q", "momentum", "rates"],
            ["jacobian", "momentum_map", "coupling", "base_velocity"],
        )
        return cls(split.columns, function)

    def generalized_jacobian(self, q: Array) -> Array:
        """J* of the tip, (6, n): linear rows first, world axes. Tip velocity = J* rates + B momentum."""
        return np.asarray(self.function(q, 0, 0)[0])

    def momentum_map(self, q: Array) -> Array:
        """B, (6, 6): tip velocity per (linear, angular about the world's origin) momentum."""
        return np.asarray(self.function(q, 0, 0)[1])

    def coupling(self, q: Array) -> Array:
        """Momentum per joint rate while the base is at rest, (6, n).

        Angular about the robot's centre of mass.
        """
        return np.asarray(self.function(q, 0, 0)[2])

    def base_velocity(self, q: Array, rates: Array, momentum: Array | None = None) -> Array:
        """Base velocity that follows from joint rates and momentum.

        Args:
            q: Configuration of the whole model, (nq,).
            rates: Joint rates, (n,) [rad/s or m/s].
            momentum: Linear momentum [N s] and angular momentum about the world's origin [N m s], world axes,
                (6,); zero if ``None``.

        Returns:
            numpy.ndarray: Velocity of the base in Pinocchio's coordinates, (k,): k = 3 for a planar base, 6
                for a free-flyer.
        """
        return np.asarray(self.function(q, 0 if momentum is None else momentum, rates)[3]).ravel()

    def reaction_null_space(self, q: Array, *, angular_only: bool = False, tolerance: float = 1e-10) -> Array:
        """Orthonormal basis of joint rates that leave the base at rest.

        Args:
            q: Configuration of the whole model, (nq,).
            angular_only: Keep only the base's attitude; its origin may move while the centre of mass is at
                rest.
            tolerance: Singular values below this fraction of the largest count as zero.

        Returns:
            numpy.ndarray: (n, d): d basis vectors of joint rates; d may be 0.
        """
        coupling = self.coupling(q)[3:] if angular_only else self.coupling(q)
        _, values, right = np.linalg.svd(coupling)
        rank = int(np.sum(values > tolerance * max(values[0], np.finfo(float).tiny))) if values.size else 0
        return np.asarray(right[rank:].T)


def _range(joint: JointModel) -> range:
    return range(joint.idx_v, joint.idx_v + joint.nv)


def _base(model: pinocchio.Model, kinematics: Kinematics, root: int) -> JointModel:
    """Root joint of a free-floating robot, or an error that names the joint in its place."""
    if root:
        joint = kinematics.joints[root - 1]
        if joint.kind in (JointKind.PLANAR, JointKind.FREE_FLYER) and joint.parent == 0:
            return joint
        description = f"a {joint.kind.value} joint on {model.names[joint.parent]!r}"
    else:
        description = "a frame fixed to the universe"
    raise DescriptionError(
        f"a free-floating robot needs a planar or free-flyer joint to the universe; found {description}",
        where=f"joint {model.names[root]!r}",
    )
