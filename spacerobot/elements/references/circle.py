"""Motion along a circle (Eq. 39-44)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import casadi as ca
import numpy as np

from spacerobot.common.section import Vector, quantity
from spacerobot.dynamics.rotations import rotation_from_rpy
from spacerobot.elements.core.desired_motion import TimeProfile
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.references.reference import DEGREE, PLANE_TOLERANCE, TimedReference


@register
class Circle(TimedReference):
    """A circle through the initial position (Eq. 39-44), counter-clockwise for growing angles."""

    kind: Literal["circle"] = "circle"
    radius: float = quantity("m", "radius R", default=0.1, gt=0)
    start_deg: float = quantity("deg", "angle delta_0 at the start", default=0.0)
    end_deg: float = quantity("deg", "angle delta_f at the end", default=360.0)
    plane_deg: Vector = quantity(
        "deg",
        "roll, pitch, yaw of the circle's plane; zero is the world's x-y plane",
        default=(0.0, 0.0, 0.0),
    )

    def moved(self, context: SectionContext) -> TimeProfile:
        """X_ref - X_ref(0) of Eq. 40, 41, and its derivatives (Eq. 43, 44)."""
        blend, parameters, path = self.blend(context), context.parameters, context.path
        first = context.once("start_angle", parameters.sparse(f"{path}.start_deg") * DEGREE)
        last = context.once("end_angle", parameters(f"{path}.end_deg") * DEGREE)
        radius = context.number("radius")
        delta = first + (last - first) * blend.value
        rate, acceleration = (last - first) * blend.rate, (last - first) * blend.acceleration
        cos, sin = ca.cos(delta), ca.sin(delta)
        plane = ca.SX.eye(3)  # axes of the circle's plane
        if any(self.plane_deg):
            angles = context.parameters.vector(f"{context.path}.plane_deg") * DEGREE
            plane = context.once("plane", rotation_from_rpy(angles))
        across = radius * plane[:, :2]

        def in_plane(x: ca.SX, y: ca.SX) -> ca.SX:
            return ca.mtimes(across, ca.vertcat(x, y))

        return TimeProfile(
            value=in_plane(cos - ca.cos(first), sin - ca.sin(first)),
            rate=in_plane(-sin * rate, cos * rate),
            acceleration=in_plane(-sin * acceleration - cos * rate**2, cos * acceleration - sin * rate**2),
        )

    def leaves_plane(self) -> Iterator[tuple[str, list[float]]]:
        """A rotation about another axis than z, or a plane that is not the x-y plane."""
        import pinocchio as pin  # not needed to validate a section

        yield from super().leaves_plane()
        normal = pin.rpy.rpyToMatrix(np.radians(self.plane_deg))[:, 2]
        if np.abs(normal[:2]).max() > PLANE_TOLERANCE:
            yield "plane_deg", list(self.plane_deg)
