"""Signed distance from a cylinder to a half-space."""

from __future__ import annotations

import casadi as ca

from spacerobot.shapes import points
from spacerobot.shapes.points import Nearest
from spacerobot.shapes.shape import Shape


def to_plane(cylinder: Shape, plane: Shape) -> Nearest:
    """From a cylinder to a half-space: from its lowest point, or the middle of its lowest line or disc."""
    lean = ca.dot(plane.axis, cylinder.axis)
    out = plane.axis - lean * cylinder.axis
    rim = cylinder.radius * out / ca.sqrt(ca.dot(out, out) + points.TINY)
    low = cylinder.position - ca.sign(lean) * cylinder.half * cylinder.axis - rim
    return points.to_plane(low, plane)
