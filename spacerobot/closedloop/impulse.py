"""Velocity changes by impulses in rigid connections."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.elements import AccelerationConstraint
from spacerobot.symbolic import Plant


@dataclass(frozen=True)
class PlasticImpact:
    """Plastic impact that stops the relative motion of all rigidly connected parts.

    Attributes:
        velocity: Velocity of the plant after the impact (nv x 1).
        impulses: Impulses on the tip along the directions of each constraint (n x 1 each) [N s, N m s]; zero
            if inactive.
        loss: Dissipated energy (1x1) [J].
    """

    velocity: ca.SX
    impulses: tuple[ca.SX, ...]
    loss: ca.SX


def strike(plant: Plant, constraints: Sequence[AccelerationConstraint]) -> PlasticImpact:
    """Velocity after an impact: no active constraint slips, and the change has minimum kinetic energy.

    This is the effect of simultaneous impulses j in all constraints, ``M (v+ - v-) = G^T j`` with ``G v+ =
    0``; they are zero without slip. The dissipated energy is ``(v+ - v-)^T M (v+ - v-) / 2 = -j^T G v- / 2``.
    If a constraint enforces a velocity r, then ``G v+ = r``, and with ``s = G v- - r`` it is ``-j^T (s / 2 +
    r)``.
    """
    senses = [masked(constraint.sense, constraint.active) for constraint in constraints]
    slips = [masked(constraint.slip, constraint.active) for constraint in constraints]
    idle = [idleness(constraint) for constraint in constraints]
    ties = plant.ties.size2()
    sense = ca.horzcat(*senses, plant.ties)
    slip = ca.vertcat(*slips, ca.SX(ties, 1))
    matrix = ca.diag(ca.vertcat(*idle, ca.SX(ties, 1))) - plant.articulated.negated_mobility(sense, sense)
    impulse = SymmetricFactors(matrix).solve_negated(slip)
    velocity = plant.v + plant.articulated.motion(ca.mtimes(sense, impulse))
    ends = [0]
    for constraint in constraints:
        ends.append(ends[-1] + constraint.size)
    parts = tuple(impulse[a:b] for a, b in itertools.pairwise(ends))
    driven = ca.vertcat(*(imposed(constraint) for constraint in constraints), ca.SX(ties, 1))
    return PlasticImpact(velocity, parts, -ca.dot(impulse, slip) / 2 - ca.dot(impulse, driven))


def masked(loads: ca.SX, active: ca.SX | None) -> ca.SX:
    """Loads or rows of a constraint, zero while it is not active."""
    return loads if active is None else loads * active


def imposed(constraint: AccelerationConstraint) -> ca.SX:
    """Velocity (n x 1) that a constraint drives, zero while it is not active."""
    driven = ca.SX(constraint.size, 1) if constraint.imposed is None else constraint.imposed
    return masked(driven, constraint.active)


def idleness(constraint: AccelerationConstraint) -> ca.SX:
    """Diagonal entries of the constraint system (n x 1): 1 while inactive, the compliance while active.

    With masked loads, the reaction of an inactive constraint is then zero and the rest of the system is
    unaffected.
    """
    active, size = constraint.active, constraint.size
    entries = ca.SX(size, 1) if active is None else ca.repmat(1 - active, size, 1)
    return entries if constraint.compliance is None else entries + masked(constraint.compliance, active)
