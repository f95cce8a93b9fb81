"""Primitives that bound a mesh or a cylinder: no point of it lies outside."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin

from spacerobot.arrays import Array
from spacerobot.description.parts import Geometry
from spacerobot.elements.contact import Wrap
from spacerobot.shapes import ShapeKind

AROUND = 8
"""Points on each rim of a cylinder: those of a capsule along its axis, or of a sphere, are all alike."""


def wrapped(geometry: Geometry, wrap: Wrap) -> tuple[ShapeKind, tuple[float, tuple[float, ...]], Array]:
    """Kind, measures and placement (4x4) of the primitive around a shape, in the shape's own axes.

    A box has the shape's extents along its axes. A sphere is about the middle of these. A capsule is the one
    of the least volume whose segment goes through that middle along one of the axes, of a cylinder its own.

    Parameters
    ----------
    geometry
        A mesh or a cylinder.
    wrap
        Which primitive.
    """
    points, axes = _points(geometry)
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    points = points - middle
    if wrap == "box":
        return "box", (0.0, tuple(map(float, (high - low) / 2))), pin.SE3(np.eye(3), middle).homogeneous
    if wrap == "sphere":
        radius = float(np.linalg.norm(points, axis=1).max())
        return "sphere", (radius, ()), pin.SE3(np.eye(3), middle).homogeneous
    found = [(*_capsule(points, axis), axis) for axis in axes]
    _, radius, half, shift, axis = min(found, key=lambda one: one[0])
    turn = np.roll(np.eye(3), 2 - axis, axis=1)  # own z along the axis
    return "capsule", (radius, (half,)), pin.SE3(turn, middle + shift * turn[:, 2]).homogeneous


def _capsule(points: Array, axis: int) -> tuple[float, float, float, float]:
    """Volume, radius, half length and shift along an axis of the smallest capsule about points (n, 3).

    With the distance d of a point from the axis and its height z, a capsule of radius r holds it if the ends
    of its segment are at least z - s and at most z + s with s = sqrt(r^2 - d^2). So the radius alone is free.
    """
    height = points[:, axis]
    across = np.linalg.norm(np.delete(points, axis, axis=1), axis=1)
    least, most = float(across.max()), float(np.hypot(across, height).max())

    def ends(radius: float) -> tuple[float, float]:
        """Half length and shift of the segment."""
        reach = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
        top, bottom = float((height - reach).max()), float((height + reach).min())
        return max((top - bottom) / 2, 0.0), (top + bottom) / 2

    def volume(radius: float) -> float:
        """Of the cylinder and the two half balls."""
        return float(np.pi * radius**2 * (2 * ends(radius)[0] + 4 / 3 * radius))

    from scipy.optimize import minimize_scalar  # slow to import, and few scenes have meshes to wrap

    inside = minimize_scalar(volume, bounds=(least, most), method="bounded").x if least < most else least
    radius = min((least, float(inside), most), key=volume)
    return volume(radius), radius, *ends(radius)


def _points(geometry: Geometry) -> tuple[Array, Sequence[int]]:
    """Points whose hull is the shape (n, 3) [m], own axes, and the axes along which a capsule may lie.

    Of a cylinder they are some of its rims, each with all extremes along x and y.
    """
    if geometry.mesh is not None:
        mesh = coal.MeshLoader().load(str(geometry.mesh), np.array(geometry.size))
        return np.array(mesh.vertices()), (0, 1, 2)
    radius, length = (float(x) for x in geometry.size)
    angles = 2 * np.pi * np.arange(AROUND) / AROUND
    rim = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    ends = [np.column_stack([rim, np.full(AROUND, side * length / 2)]) for side in (-1, 1)]
    return np.concatenate(ends), (2,)
