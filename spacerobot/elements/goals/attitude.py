"""Goal of a floating base at a given attitude."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from spacerobot.common.section import Name, Vector, quantity
from spacerobot.dynamics.joints import exact_directions
from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.goal import Goal
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, within, zero


@register
class Attitude(Goal):
    """The floating base of a robot reaches an attitude."""

    told_by: ClassVar[str | None] = "attitude"

    kind: Literal["attitude"] = "attitude"
    attitude: Name = Field(description="robot whose root link has `rotation_deg` at the end")
    rotation_deg: Vector = quantity("deg", "roll, pitch, yaw of the root link at the end, world axes")
    rotation_within_deg: float | None = quantity(
        "deg", "maximum rotation from `rotation_deg`; none if not given", default=None, gt=0
    )

    @property
    def body(self) -> str:
        """The robot."""
        return self.attitude

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Terminal constraints on the remaining rotation."""
        import pinocchio as pin  # not needed to validate a section

        target_rotation = exact_directions(pin.rpy.rpyToMatrix(np.radians(self.rotation_deg)))
        turn = instant.turned(target_rotation, instant.base(self.attitude, "attitude").rotation)
        if self.rotation_within_deg is not None:
            yield within("attitude", "rad", turn, float(np.radians(self.rotation_within_deg)))
            return
        for k, i in enumerate(instant.turns):
            yield zero(f"attitude {'xyz'[i]}", "rad", turn[k])
