"""Distances of shapes in NumPy: coal's, and Newton's method on support functions where faces are crowned."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.elements import CollisionShape
from spacerobot.scene.contacts import coal_distance
from spacerobot.scene.scene import SceneShape
from spacerobot.shapes import CrownedTerm, Shape, SmoothTerm, is_exact

SmoothSupport = Callable[[Array], Sequence[Array]]
"""Function from directions (3,) or (3, k) to support function, gradient and Hessian."""

_LOOKS = 200
_GOLDEN = np.pi * (3 - 5**0.5)
_HEIGHTS = np.linspace(-1, 1, _LOOKS)
_AROUND = np.sqrt(1 - _HEIGHTS**2)[:, None] * np.exp(1j * _GOLDEN * np.arange(_LOOKS))[:, None]
DIRECTIONS = np.hstack([_AROUND.real, _AROUND.imag, _HEIGHTS[:, None]])
"""Unit vectors (200, 3), evenly distributed over the sphere."""
_STEPS, _HALVINGS = 200, 40
_SMALL, _LEVEL = 1e-14, 1e-13
"""Length of the last step, and maximum decrease of a distance by rounding [m]."""


def shape_distance(
    pair: tuple[SceneShape, SceneShape], links: Sequence[Any], crown: float
) -> tuple[float, Array, Array]:
    """Signed distance [m], normal (3,) and point halfway (3,) [m] of two shapes.

    Coal's distance if a closed form exists; otherwise from support functions, starting at coal's normal.

    Args:
        pair: The shapes; at most one is a half-space.
        links: Placements of their links in the world (``pin.SE3``).
        crown: Height of the domes, relative to half the lengths.
    """
    near = coal_distance(*pair, links)
    normal = np.array(near.normal)
    if _has_closed_form(*(shape.config for shape in pair)):
        return near.min_distance, normal, (near.getNearestPoint1() + near.getNearestPoint2()) / 2
    return crowned_distance(pair, links, crown, normal)


@functools.lru_cache(maxsize=1024)
def _has_closed_form(*shapes: CollisionShape) -> bool:
    """Whether the distance of two shapes has a closed form."""
    one, other = (
        Shape(type(shape), ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3), ca.SX.sym("s", shape.measures().numel()))
        for shape in shapes
    )
    return is_exact(one, other)


@dataclass(frozen=True)
class CrownedSupport:
    """Support function of crowned shapes: a ball, ellipsoids (thickened segments, discs), smooth terms.

    Attributes:
        roots: Matrices of the ellipsoids' squared support functions (k, 3, 3), world axes [m^2].
        ball: Radius [m].
        smooth: Rotation (3, 3), and function to values, gradients and Hessians in the shape's axes, of each
            smooth term.
    """

    roots: Array
    ball: float
    smooth: tuple[tuple[Array, SmoothSupport], ...] = ()

    @classmethod
    def of(cls, shape: SceneShape, rotation: Array, crown: float) -> CrownedSupport:
        """Support function of a shape in world axes."""
        flat, domes, ball, smooth = _own(shape.config)
        roots = rotation @ (flat + crown**2 * domes) @ rotation.T
        return cls(roots, ball, tuple((rotation @ root, term) for root, term in smooth))

    def __add__(self, other: CrownedSupport) -> CrownedSupport:
        """Support function of the Minkowski sum."""
        roots = np.concatenate([self.roots, other.roots])
        return CrownedSupport(roots, self.ball + other.ball, self.smooth + other.smooth)

    def reflected(self) -> CrownedSupport:
        """Support function at -n: that of the shape reflected at its centre."""
        return dataclasses.replace(self, smooth=tuple((-rotation, term) for rotation, term in self.smooth))

    def reach(self, n: Array) -> Array:
        """Support function (k,) [m] of directions (k, 3)."""
        support = np.sqrt(np.einsum("ni,kij,nj->nk", n, self.roots, n)).sum(axis=1) + self.ball
        for rotation, term in self.smooth:
            support = support + term((n @ rotation).T)[0].ravel()
        return np.asarray(support)

    def farthest(self, n: Array) -> Array:
        """Farthest point of the shape along a unit vector (3,), from its centre [m]."""
        directions = self.roots @ n
        point = (directions / np.sqrt(directions @ n)[:, None]).sum(axis=0) + self.ball * n
        for rotation, term in self.smooth:
            point = point + rotation @ term(n @ rotation)[1].ravel()
        return np.asarray(point)

    def curvature(self, n: Array) -> Array:
        """Derivative of the farthest point (3, 3) [m]."""
        directions = self.roots @ n
        reach = np.sqrt(directions @ n)[:, None, None]
        parts = self.roots / reach - np.einsum("ki,kj->kij", directions, directions) / reach**3
        hessian = parts.sum(axis=0) + self.ball * (np.eye(3) - np.outer(n, n))
        for rotation, term in self.smooth:
            hessian = hessian + rotation @ term(n @ rotation)[2] @ rotation.T
        return np.asarray(hessian)


@functools.lru_cache(maxsize=1024)
def _own(shape: CollisionShape) -> tuple[Array, Array, float, tuple[tuple[Array, SmoothSupport], ...]]:
    """Roots without domes and of domes (k, 3, 3) [m^2], ball [m] and smooth terms, in the shape's axes."""
    if shape.is_halfspace:
        return np.empty((0, 3, 3)), np.empty((0, 3, 3)), 0.0, ()
    support = shape.support(ca.SX.eye(3), shape.measures())
    flat, domes, smooth = [np.empty((0, 3, 3))], [np.empty((0, 3, 3))], []
    for term in support.terms:
        if isinstance(term, CrownedTerm):
            size, axis = _numbers(term.size).item(), _numbers(term.axis)
            along = axis @ axis.T
            flat.append(size**2 * (np.eye(3) - along if term.is_disc else along)[None])
            domes.append(size**2 * np.eye(3)[None])
        elif isinstance(term, SmoothTerm):
            smooth.append((_numbers(term.rotation), _smooth(term)))
    return np.concatenate(flat), np.concatenate(domes), _numbers(support.ball).item(), tuple(smooth)


def _smooth(term: SmoothTerm) -> SmoothSupport:
    """Value, gradient and Hessian of a smooth term in its own axes."""
    function, measures = term.own_derivatives, _numbers(term.measures)
    return lambda directions: [value.full() for value in function(directions, measures)]


def _numbers(expression: ca.SX) -> Array:
    """Numeric values of a constant expression."""
    return np.asarray(ca.evalf(expression).full())


def crowned_distance(
    pair: tuple[SceneShape, SceneShape], links: Sequence[Any], crown: float, normal: Array
) -> tuple[float, Array, Array]:
    """Signed distance [m], normal (3,) and point halfway (3,) [m] of two shapes.

    Args:
        pair: The shapes; at most one is a half-space.
        links: Placements of their links in the world (``pin.SE3``).
        crown: Height of the domes, relative to half the lengths.
        normal: Normal (3,) of the shapes without domes, from which the search starts. If one shape is inside
            the other, coal's normal may belong to a far longer way out; directions all around are therefore
            tried as well.
    """
    at = [link * pin.SE3(shape.placement) for link, shape in zip(links, pair, strict=True)]
    centre = at[1].translation - at[0].translation
    one, other = (
        CrownedSupport.of(shape, place.rotation, crown) for shape, place in zip(pair, at, strict=True)
    )
    below = [shape.config.is_halfspace for shape in pair]
    if below[0]:
        n = at[0].rotation[:, 2]
    elif below[1]:
        n = -at[1].rotation[:, 2]
    else:
        n = _greatest(centre, one + other.reflected(), normal)
    ends = at[0].translation + one.farthest(n), at[1].translation + other.farthest(-n)
    # two points on a plane differ by what lies along it
    gap = float(n @ (ends[1] - ends[0]))
    point = ends[0] + gap / 2 * n if not below[0] else ends[1] - gap / 2 * n
    return gap, n, point


def _greatest(centre: Array, both: CrownedSupport, start: Array) -> Array:
    """Unit vector (3,) that maximises the separation of two shapes, searched uphill from a start vector."""
    looks = np.vstack([start, DIRECTIONS]) if np.isfinite(start).all() else DIRECTIONS
    gaps = np.where(np.linalg.norm(looks, axis=1) > 0.5, looks @ centre - both.reach(looks), -np.inf)
    n, gap = looks[gaps.argmax()], float(gaps.max())
    for _ in range(_STEPS):
        mirror = n + np.copysign(np.eye(3)[2], n[2])  # turns z onto n or -n
        plane = np.eye(3)[:2] - 2 * np.outer(mirror[:2], mirror) / (mirror @ mirror)
        slopes, turned = np.linalg.eigh(plane @ both.curvature(n) @ plane.T + gap * np.eye(2))
        pull = plane @ (centre - both.farthest(n))
        step = turned @ ((turned.T @ pull) / np.maximum(np.abs(slopes), _SMALL)) @ plane
        step /= max(1.0, float(np.linalg.norm(step)))
        for _ in range(_HALVINGS):
            ahead = (n + step) / np.linalg.norm(n + step)
            separation = float(ahead @ (centre - both.farthest(ahead)))
            if separation >= gap - _LEVEL:
                break
            step = step / 2
        n, gap = ahead, separation
        if np.linalg.norm(step) < _SMALL:
            break
    return np.asarray(n)
