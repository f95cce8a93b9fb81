r"""A goal of one's own: a tip that points in a direction at the end of a plan, as a camera does.

spacerobot plan bounce --plugin pointing.py --set plan.duration=3 --set 'plan.costs={torque: 1}' \
    --set 'plan.goals={camera: {kind: pointing, tip: arm/tip, towards: [0, 1, 0]}}'
"""

from collections.abc import Iterator
from typing import Literal

import casadi as ca
import numpy as np
from pydantic import Field

import spacerobot as sr
from spacerobot.elements import BoundedRow, Goal, PlanInstant, Vector, quantity


@sr.register
class Pointing(Goal):
    """A tip's axis points in a direction of the world."""

    kind: Literal["pointing"] = "pointing"
    tip: str = Field(description="which tip, as robot/tip")
    axis: Vector = quantity("1", "direction in which the tip looks, its axes", default=(1.0, 0.0, 0.0))
    towards: Vector = quantity("1", "direction in which it points at the end, world axes")
    within_deg: float = quantity("deg", "greatest angle between the two", default=1.0, gt=0, lt=90)

    @property
    def body(self) -> str:
        """Robot whose joints rest at the end."""
        return self.tip.partition("/")[0]

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Cosine of the angle between both directions; at the bound its slope is the angle's sine."""
        axis, towards = (np.array(v) / np.linalg.norm(v) for v in (self.axis, self.towards))
        cosine = ca.dot(ca.mtimes(instant.tip(self.tip).rotation, axis), towards)
        limit = np.radians(self.within_deg)
        lower, scale = float(np.cos(limit)), float(1 / np.sin(limit))
        yield BoundedRow("pointing error", "rad", cosine, lower=lower, scale=scale, form="cosine")
