"""Convex primitives as CasADi expressions: signed distance, normal and one point of a pair."""

from spacerobot.shapes.pairs import CROWN, Proximity, have_distance, proximity
from spacerobot.shapes.shape import Shape, ShapeKind

__all__ = ["CROWN", "Proximity", "Shape", "ShapeKind", "have_distance", "proximity"]
