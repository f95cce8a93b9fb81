"""Cubic spline through waypoints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.arrays import Array
from spacerobot.common.section import Vector
from spacerobot.elements.core.desired_motion import TimeProfile
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.references.reference import Reference

OVERSHOOT = 0.25
"""Overshoot beyond the waypoints that causes a warning, relative to the diagonal of their bounding box."""


@register
class Spline(Reference):
    """Cubic spline through waypoints, at rest at both ends."""

    kind: Literal["spline"] = "spline"
    times: tuple[float, ...] = Field(
        min_length=2, max_length=200, description="times of the waypoints, rising, the first one 0 [s]"
    )
    displacements: tuple[Vector, ...] = Field(
        min_length=2,
        max_length=200,
        description="waypoints relative to the initial position, world axes; the first one 0 0 0 [m]",
    )

    @model_validator(mode="after")
    def _check(self) -> Spline:
        if len(self.times) != len(self.displacements):
            raise ValueError(f"{len(self.times)} times but {len(self.displacements)} displacements")
        if self.times[0] != 0:
            raise ValueError(f"times must start at 0, found {self.times[0]}")
        if any(b <= a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError("times must rise strictly")
        if any(self.displacements[0]):
            raise ValueError(
                "the first displacement must be 0 0 0: the motion starts at the initial position"
            )
        return self

    def moved(self, context: SectionContext) -> TimeProfile:
        """Displacement by a clamped cubic spline; its coefficients are linear in the waypoints."""
        knots, count = np.array(self.times), len(self.times)
        coordinates = [
            context.parameters.sparse_vector(f"{context.path}.displacements.{i}").T for i in range(count)
        ]
        points = ca.vertcat(*coordinates)
        second = context.once("curvature", ca.mtimes(_clamped_spline_operator(knots), points))
        points = context.once("displacements", points)
        profile = TimeProfile(points[count - 1, :].T, ca.SX(3, 1), ca.SX(3, 1))
        for i in reversed(range(count - 1)):
            is_before = context.time < context.jump(f"times.{i + 1}", float(knots[i + 1]))
            # cubic between two knots, from the waypoints and second derivatives there
            width = float(knots[i + 1] - knots[i])
            before, after = (knots[i + 1] - context.time) / width, (context.time - knots[i]) / width
            a, b, m, n = points[i, :].T, points[i + 1, :].T, second[i, :].T, second[i + 1, :].T
            inside = TimeProfile(
                before * a + after * b + (m * (before**3 - before) + n * (after**3 - after)) * (width**2 / 6),
                (b - a) / width + (n * (3 * after**2 - 1) - m * (3 * before**2 - 1)) * (width / 6),
                before * m + after * n,
            )
            profile = TimeProfile(
                ca.if_else(is_before, inside.value, profile.value),
                ca.if_else(is_before, inside.rate, profile.rate),
                ca.if_else(is_before, inside.acceleration, profile.acceleration),
            )
        return profile

    def warnings(self) -> list[str]:
        """Warnings about axes with a large overshoot beyond the waypoints."""
        points = np.array(self.displacements)
        lower, upper = points.min(axis=0), points.max(axis=0)
        # displacements (m, 3) on the whole way, at as many times in each piece
        knots = np.array(self.times)
        second = _clamped_spline_operator(knots).full() @ points
        right = np.linspace(0.0, 1.0, 33)[:, None, None]
        left, bend = 1 - right, np.diff(knots)[:, None] ** 2 / 6
        inner = left * points[:-1] + right * points[1:]
        inner = inner + bend * (second[:-1] * (left**3 - left) + second[1:] * (right**3 - right))
        extremes: Array = inner.reshape(-1, 3)
        beyond = np.maximum(lower - extremes, extremes - upper).max(axis=0)
        axis = int(beyond.argmax())
        if beyond[axis] <= OVERSHOOT * np.linalg.norm(upper - lower):
            return []
        return [
            f"swings {beyond[axis]:.3g} m beyond its waypoints along {'xyz'[axis]}, which lie between "
            f"{lower[axis]:.3g} and {upper[axis]:.3g} m; set `times` more evenly, or waypoints in between"
        ]

    def jumps(self) -> tuple[float, ...]:
        """Times of its waypoints after the first one [s]."""
        return self.times[1:]

    def leaves_plane(self) -> Iterator[tuple[str, list[float]]]:
        """Waypoints off the x-y plane."""
        for i, displacement in enumerate(self.displacements):
            if displacement[2]:
                yield f"displacements.{i}", list(displacement)


def _clamped_spline_operator(knots: Array) -> ca.DM:
    """Matrix (n, n) from waypoints to second derivatives at the knots, with zero slopes at both ends."""
    n, h = len(knots), np.diff(knots)
    left, right = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        if i > 0:
            left[i, i - 1], left[i, i] = h[i - 1] / 6, left[i, i] + h[i - 1] / 3
            right[i, i - 1] += 1 / h[i - 1]
            right[i, i] -= 1 / h[i - 1]
        if i < n - 1:
            left[i, i + 1], left[i, i] = h[i] / 6, left[i, i] + h[i] / 3
            right[i, i + 1] += 1 / h[i]
            right[i, i] -= 1 / h[i]
    return ca.DM(np.linalg.solve(left, right))
