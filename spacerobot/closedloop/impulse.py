"""What impulses in rigid grasps do to a velocity."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.elements import Constraint
from spacerobot.symbolic import Plant


def close_velocity(plant: Plant, constraints: Sequence[Constraint]) -> ca.SX:
    """The plant's velocity, changed so that no rigid grasp slips, at the least kinetic energy (nv x 1).

    The change is what an impulse in each grasp makes, as if all closed at once; none where nothing slips.
    """
    sense = ca.horzcat(*(constraint.sense for constraint in constraints), plant.ties)
    slip = ca.vertcat(*(constraint.slip for constraint in constraints), ca.SX(plant.ties.size2(), 1))
    factors = SymmetricFactors(-plant.articulated.negated_mobility(sense, sense))
    return plant.v + plant.articulated.motion(ca.mtimes(sense, factors.solve_negated(slip)))
