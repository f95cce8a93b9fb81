"""Convex shapes as CasADi expressions: signed distance, contact normal and contact point of a pair."""

from spacerobot.shapes.pairs import (
    CROWN,
    Implicit,
    MovingShape,
    Proximity,
    approach_speed,
    core_radius,
    have_distance,
    held_gap,
    is_exact,
    proximity,
)
from spacerobot.shapes.shape import ConvexKind, Nearest, Shape
from spacerobot.shapes.support import CrownedTerm, SmoothTerm, Support

__all__ = [
    "CROWN",
    "ConvexKind",
    "CrownedTerm",
    "Implicit",
    "MovingShape",
    "Nearest",
    "Proximity",
    "Shape",
    "SmoothTerm",
    "Support",
    "approach_speed",
    "core_radius",
    "have_distance",
    "held_gap",
    "is_exact",
    "proximity",
]
