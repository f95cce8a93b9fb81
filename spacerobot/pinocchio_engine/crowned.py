"""Signed distances of crowned shapes, written again: coal finds where, Newton's method the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.arrays import Array
from spacerobot.scene.scene import SceneShape

_LOOKS = 200
_GOLDEN = np.pi * (3 - 5**0.5)
_HEIGHTS = np.linspace(-1, 1, _LOOKS)
_AROUND = np.sqrt(1 - _HEIGHTS**2)[:, None] * np.exp(1j * _GOLDEN * np.arange(_LOOKS))[:, None]
DIRECTIONS = np.hstack([_AROUND.real, _AROUND.imag, _HEIGHTS[:, None]])
"""Unit vectors (200, 3) all around."""
_STEPS, _HALVINGS = 200, 40
_SMALL, _LEVEL = 1e-14, 1e-13
"""Last step, and by how much rounding may lower a distance [m]."""


@dataclass(frozen=True)
class Crowned:
    """How far crowned shapes reach: sums of a ball and ellipsoids, thickened segments and discs.

    Attributes
    ----------
    roots
        Of the ellipsoids' squared support functions (k, 3, 3), world axes [m^2].
    ball
        Radius [m].
    """

    roots: Array
    ball: float

    @classmethod
    def of(cls, shape: SceneShape, rotation: Array, crown: float) -> Crowned:
        """Of a shape that is turned (3, 3)."""
        radius, half = shape.measures
        axes = np.einsum("ik,jk->kij", rotation, rotation)
        thin = list(zip(half, axes if shape.kind == "box" else axes[2:], strict=True))
        if shape.kind == "cylinder":
            thin.append((radius, np.eye(3) - axes[2]))
        roots = np.array([size**2 * (flat + crown**2 * np.eye(3)) for size, flat in thin])
        return cls(roots, radius if shape.kind == "capsule" else 0.0)

    def farthest(self, n: Array) -> Array:
        """Its farthest point along a unit vector (3,), from its centre [m]."""
        seen = self.roots @ n
        return np.asarray((seen / np.sqrt(seen @ n)[:, None]).sum(axis=0) + self.ball * n)

    def curvature(self, n: Array) -> Array:
        """Derivative of the farthest point (3, 3) [m]."""
        seen = self.roots @ n
        reach = np.sqrt(seen @ n)[:, None, None]
        parts = self.roots / reach - np.einsum("ki,kj->kij", seen, seen) / reach**3
        return np.asarray(parts.sum(axis=0) + self.ball * (np.eye(3) - np.outer(n, n)))


def crowned_distance(
    pair: tuple[SceneShape, SceneShape], links: Sequence[Any], crown: float, normal: Array
) -> tuple[float, Array, Array]:
    """Signed distance [m], normal (3,) and point halfway (3,) [m] of two shapes.

    Parameters
    ----------
    pair
        The shapes; at most one is a plane, none a sphere.
    links
        Placements of their links in the world (``pin.SE3``).
    crown
        Height of the domes, of half the lengths.
    normal
        Of the shapes as they are without domes (3,), from which that with domes is sought. Inside one another
        coal's may be a far longer way out, seen from some directions all around.
    """
    at = [link * pin.SE3(shape.placement) for link, shape in zip(links, pair, strict=True)]
    centre = at[1].translation - at[0].translation
    none = Crowned(np.empty((0, 3, 3)), 0.0)
    one, other = (
        none if shape.kind == "plane" else Crowned.of(shape, place.rotation, crown)
        for shape, place in zip(pair, at, strict=True)
    )
    if pair[0].kind == "plane":
        n = at[0].rotation[:, 2]
    elif pair[1].kind == "plane":
        n = -at[1].rotation[:, 2]
    else:
        both = Crowned(np.concatenate([one.roots, other.roots]), one.ball + other.ball)
        n = _greatest(centre, both, normal)
    ends = at[0].translation + one.farthest(n), at[1].translation - other.farthest(n)
    # two points on a plane differ by what lies along it
    gap = float(n @ (ends[1] - ends[0]))
    point = ends[0] + gap / 2 * n if pair[0].kind != "plane" else ends[1] - gap / 2 * n
    return gap, n, point


def _greatest(centre: Array, both: Crowned, start: Array) -> Array:
    """Unit vector (3,) that is uphill from another one and along which shapes are farthest apart."""
    looks = np.vstack([start, DIRECTIONS]) if np.isfinite(start).all() else DIRECTIONS
    reach = np.sqrt(np.einsum("ni,kij,nj->nk", looks, both.roots, looks)).sum(axis=1) + both.ball
    gaps = np.where(np.linalg.norm(looks, axis=1) > 0.5, looks @ centre - reach, -np.inf)
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
            found = float(ahead @ (centre - both.farthest(ahead)))
            if found >= gap - _LEVEL:
                break
            step = step / 2
        n, gap = ahead, found
        if np.linalg.norm(step) < _SMALL:
            break
    return np.asarray(n)
