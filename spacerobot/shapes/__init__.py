"""Convex primitives as CasADi expressions: signed distance, normal and one point of a pair."""

from spacerobot.shapes.pairs import CROWN, Proximity, gap_about, have_distance, proximity
from spacerobot.shapes.shape import Shape, ShapeKind

__all__ = ["CROWN", "Proximity", "Shape", "ShapeKind", "gap_about", "have_distance", "proximity"]
