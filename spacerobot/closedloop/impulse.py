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
    """A plastic impact: what stops the relative motion of everything that is rigidly connected.

    Attributes:
        velocity: Of the plant afterwards (nv x 1).
        impulses: Along the directions of each constraint, on the tip (n x 1 each) [N s, N m s]; zero where
            inactive.
        loss: Energy that it takes (1x1) [J].
    """

    velocity: ca.SX
    impulses: tuple[ca.SX, ...]
    loss: ca.SX


def strike(plant: Plant, constraints: Sequence[AccelerationConstraint]) -> PlasticImpact:
    """Velocity after an impact: no active constraint slips, and the change has minimum kinetic energy.

    That is what an impulse in each of them makes, ``M (v+ - v-) = G^T j`` with ``G v+ = 0``, as if all closed
    at once; none where nothing slips. It takes the energy ``(v+ - v-)^T M (v+ - v-) / 2 = -j^T G v- / 2``.
    Where a constraint drives a velocity r, ``G v+ = r`` and ``s = G v- - r``, it takes ``-j^T (s / 2 + r)``.
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
    """Diagonal entries of the constraint system (n x 1): 1 while the constraint is not active.

    With its loads masked, its reaction is then zero and everything else as if it did not exist. While it is
    active, its compliance.
    """
    active, size = constraint.active, constraint.size
    entries = ca.SX(size, 1) if active is None else ca.repmat(1 - active, size, 1)
    return entries if constraint.compliance is None else entries + masked(constraint.compliance, active)
