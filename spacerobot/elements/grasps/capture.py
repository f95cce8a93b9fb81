"""Capture, release and failure of a grasp: sections with their conditions."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from spacerobot.common.section import Section, Vector, quantity
from spacerobot.elements.core.failure import Failure

ENVELOPE = ("distance", "misalignment_deg", "closing_speed", "lateral_speed", "spin_deg")
"""Optional limits of a capture envelope."""


class Capture(Section):
    """Conditions under which an open grasp closes: an envelope for a dwell time, or a time."""

    at: float | None = quantity(
        "s", "time at which it closes wherever the tip is, instead of an envelope", default=None, ge=0
    )
    distance: float | None = quantity("m", "maximum distance of tip and mating frame", default=None, gt=0)
    misalignment_deg: float | None = quantity(
        "deg", "maximum angle between the tip and where it is mated", default=None, gt=0, le=180
    )
    closing_speed: float | None = quantity(
        "m/s", "maximum speed of the tip along the axis, relative to the target", default=None, gt=0
    )
    lateral_speed: float | None = quantity("m/s", "maximum speed across the axis", default=None, gt=0)
    spin_deg: float | None = quantity("deg/s", "maximum relative spin", default=None, gt=0)
    dwell: float = quantity("s", "time for which all limits must hold", default=0.0, ge=0)
    axis: Vector = quantity(
        "1", "direction in which a tip approaches, axes of the mating frame", default=(1.0, 0.0, 0.0)
    )
    mated_deg: Vector = quantity(
        "deg", "roll, pitch, yaw of the tip in the mating frame where mated", default=(0.0, 0.0, 0.0)
    )
    draw_in: float | None = quantity(
        "m/s",
        "maximum rate at which the tip is drawn to the mating frame; as captured if not given",
        default=None,
        gt=0,
    )
    draw_in_deg: float | None = quantity(
        "deg/s",
        "maximum rate at which it is turned to where it is mated; as captured if none",
        default=None,
        gt=0,
    )

    @property
    def limits(self) -> tuple[str, ...]:
        """Limits of the envelope that are given."""
        return tuple(name for name in ENVELOPE if getattr(self, name) is not None)

    def words(self) -> str:
        """Conditions of the capture as text."""
        if self.at is not None:
            return f"closes at {self.at:g} s"
        units = {"distance": "m", "misalignment_deg": "deg", "spin_deg": "deg/s"}
        limits = (
            f"{name.removesuffix('_deg').replace('_', ' ')} {getattr(self, name):g} {units.get(name, 'm/s')}"
            for name in self.limits
        )
        return f"closes within {', '.join(limits)}" + (f" for {self.dwell:g} s" if self.dwell else "")

    @model_validator(mode="after")
    def _check(self) -> Capture:
        if self.at is not None and (self.limits or self.dwell):
            raise ValueError(
                f"give either `at` or an envelope, found both: at, {', '.join(self.limits) or 'dwell'}"
            )
        if self.at is None and not self.limits:
            raise ValueError(f"when it closes is missing: give `at`, or limits of {', '.join(ENVELOPE)}")
        if not any(self.axis):
            raise ValueError("axis: found 0 0 0, allowed: a direction, as [1, 0, 0]")
        return self


class Release(Section):
    """Release of a closed grasp: at a time, or by breaking away under an excessive load."""

    at: float | None = quantity("s", "time at which the grasp is released", default=None, ge=0)
    force: float | None = quantity(
        "N", "maximum force that it transmits before it breaks away", default=None, gt=0
    )
    torque: float | None = quantity(
        "N m", "maximum torque that it transmits before it breaks away", default=None, gt=0
    )

    @model_validator(mode="after")
    def _check(self) -> Release:
        if self.at is None and self.force is None and self.torque is None:
            raise ValueError("no release condition: give `at`, `force` or `torque`")
        return self

    def words(self) -> str:
        """Conditions of the release as text."""
        conditions = [] if self.at is None else [f"at {self.at:g} s"]
        conditions += [] if self.force is None else [f"above {self.force:g} N"]
        conditions += [] if self.torque is None else [f"above {self.torque:g} N m"]
        return f"released {' or '.join(conditions)}"


class GraspFailure(Failure):
    """Failure of a gripper."""

    mode: Literal["misses", "jammed", "weak"] = Field(
        default="misses",
        description="misses: its next attempt to close fails, and it tries again after `retry`; jammed: it "
        "neither closes nor opens; weak: it breaks away under the part `remaining` of `release.force` and "
        "`release.torque`",
    )
    retry: float = quantity("s", "time from the attempt that fails to the next one", default=1.0, ge=0)
    remaining: float = quantity("1", "part of the greatest load that is left", default=0.5, gt=0, le=1)
