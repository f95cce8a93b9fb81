"""Convex primitives as CasADi expressions: signed distance, normal and one point of a pair."""

from spacerobot.shapes.pairs import PAIRS, Proximity, ShapeKind, proximity
from spacerobot.shapes.shape import Shape

__all__ = ["PAIRS", "Proximity", "Shape", "ShapeKind", "proximity"]
