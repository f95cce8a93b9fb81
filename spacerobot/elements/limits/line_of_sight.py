"""Line of sight: a mating frame stays inside a cone about the axis of a camera."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.section import Vector, quantity
from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, unit
from spacerobot.elements.limits.plan_limit import PlanLimit

NEAR = 1e-4
"""Distance [m] from the camera below which the direction to the frame is regularised."""


@register
class LineOfSightLimit(PlanLimit):
    """Line of sight: a camera keeps a mating frame inside its view cone."""

    short: ClassVar[str | None] = None

    kind: Literal["line_of_sight"] = "line_of_sight"
    camera: str = Field(description="link that carries it, as robot/link; it is at the link's origin")
    axis: Vector = quantity("1", "direction in which it looks, axes of that link", default=(1.0, 0.0, 0.0))
    frame: str = Field(description="mating frame, a link of the target's URDF")
    half_angle_deg: float = quantity("deg", "between its axis and the edge of what it sees", gt=0, lt=180)
    final_fraction: float = quantity(
        "1", "part of the duration, at its end, for which it holds", default=1.0, gt=0, le=1
    )

    @model_validator(mode="after")
    def _check(self) -> LineOfSightLimit:
        if not any(self.axis):
            raise ValueError("axis: found 0 0 0, allowed: a direction")
        return self

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Cosine of the angle between the camera's axis and the direction to the mating frame."""
        camera = instant.link(self.camera, "camera")
        away = instant.mating(self.frame).origin - camera.origin
        cosine = ca.dot(ca.mtimes(camera.rotation, unit(self.axis)), away) / ca.sqrt(
            ca.sumsqr(away) + NEAR**2
        )
        limit = np.radians(self.half_angle_deg)
        yield BoundedRow(
            "off the camera's axis",
            "rad",
            cosine,
            lower=float(np.cos(limit)),
            final_fraction=self.final_fraction,
            scale=float(1 / np.sin(limit)),
            form="cosine",
        )
