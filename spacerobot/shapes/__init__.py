"""Convex primitives as CasADi expressions: signed distance, normal and one point of a pair."""

from spacerobot.shapes.pairs import CROWN, Implicit, Proximity, have_distance, held_gap, proximity
from spacerobot.shapes.shape import Shape, ShapeKind

__all__ = ["CROWN", "Implicit", "Proximity", "Shape", "ShapeKind", "have_distance", "held_gap", "proximity"]
