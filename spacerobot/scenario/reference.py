"""References: where a tip or the held object shall be at each time (Eq. 39-44).

All kinds start at the initial pose, move by a displacement that the cubic blend of Eq. 42 (or a spline)
carries from rest to rest, and hold the end.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from spacerobot.scenario.section import Section, Vector, quantity


class _Timed(Section):
    duration: float = quantity("s", "time the motion takes; held afterwards", default=10.0, gt=0)
    rotation_deg: Vector = quantity(
        "deg",
        "rotation vector, world axes, reached at the end of the motion by the same blend",
        default=(0.0, 0.0, 0.0),
    )


class Circle(_Timed):
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


class Line(_Timed):
    """A straight line."""

    kind: Literal["line"] = "line"
    displacement: Vector = quantity("m", "from start to end, world axes", default=(0.0, 0.0, 0.0))


class Spline(Section):
    """A cubic spline through waypoints, at rest at both ends."""

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


class Hold(Section):
    """Stay at the initial pose."""

    kind: Literal["hold"] = "hold"


Reference = Annotated[Circle | Line | Spline | Hold, Field(discriminator="kind")]
