"""Joint-space dynamics of a robot whose base reacts to its joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.symbolic import Plant


@dataclass(frozen=True)
class FreeBase:
    """Free-floating dynamics reduced to n joints, with no wrench on the base: v_base' = W q'' + falling.

    Attributes:
        base: Indices of the base in v (k); none for a fixed base.
        factors: Factors of the base's inertia (k x k); None for a fixed base.
        reaction: W (k x n), base acceleration per joint acceleration.
        falling: Base acceleration at zero joint acceleration (k x 1).
        inertia, bias: Joint-space inertia and bias forces that include the base's reaction (n x n and n x 1).
    """

    base: list[int]
    factors: SymmetricFactors | None
    reaction: ca.SX
    falling: ca.SX
    inertia: ca.SX
    bias: ca.SX

    @classmethod
    def of(
        cls,
        plant: Plant,
        base_joint: int,
        columns: Sequence[int],
        added: tuple[ca.SX, ca.SX] | None = None,
    ) -> FreeBase:
        """Dynamics of a robot at the current state.

        Args:
            plant: Mechanics now.
            base_joint: Id of the floating base's joint; 0 for a fixed base.
            columns: Indices of the joints in v (n).
            added: Inertia (nv x nv) and bias (nv x 1) of a payload; None without one.
        """
        joint, joints = plant.model.joints[base_joint], list(columns)
        base = list(range(joint.idx_v, joint.idx_v + joint.nv)) if base_joint else []
        gathered = plant.gathered
        inertia = gathered(gathered(plant.mass_matrix).T)
        bias = gathered(plant.bias)
        if added is not None:
            inertia, bias = inertia + added[0], bias + added[1]
        if not base:
            none = ca.SX(0, len(joints)), ca.SX(0, 1)
            return cls(base, None, *none, inertia[joints, joints], bias[joints])
        factors, coupling = SymmetricFactors(inertia[base, base]), inertia[base, joints]
        reaction, falling = factors.solve_negated(coupling), factors.solve_negated(bias[base])
        return cls(
            base,
            factors,
            reaction,
            falling,
            inertia[joints, joints] + ca.mtimes(coupling.T, reaction),
            bias[joints] + ca.mtimes(coupling.T, falling),
        )

    def torque(self, acceleration: ca.SX) -> ca.SX:
        """Generalized forces (n x 1) of joint accelerations (n x 1)."""
        return ca.mtimes(self.inertia, acceleration) + self.bias
