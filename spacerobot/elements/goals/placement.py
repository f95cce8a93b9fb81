"""Goal of a tip at a place in the world."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from spacerobot.common.section import Vector, quantity
from spacerobot.dynamics.joints import exact_directions, sparse
from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.goal import TipGoal
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, matched, within, zero


@register
class Placed(TipGoal):
    """A tip reaches a position and orientation in the world."""

    told_by: ClassVar[str | None] = "position"

    kind: Literal["placed"] = "placed"
    position: Vector = quantity("m", "of the tip at the end, world axes")
    rotation_deg: Vector | None = quantity(
        "deg", "roll, pitch, yaw of the tip at the end, world axes; free if not given", default=None
    )

    position_within: float | None = quantity(
        "m", "maximum distance from `position`; none if not given", default=None, gt=0
    )
    rotation_within_deg: float | None = quantity(
        "deg", "maximum rotation from `rotation_deg`; none if not given", default=None, gt=0
    )

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Position, and orientation where it is given."""
        import pinocchio as pin  # not needed to validate a section

        tip = instant.tip(self.tip)
        off = tip.origin - self.place(instant)
        yield from matched("position", "m", off, instant.axes, self.position_within)
        if self.rotation_deg is not None:
            target_rotation = exact_directions(pin.rpy.rpyToMatrix(np.radians(self.rotation_deg)))
            turn = instant.turned(target_rotation, tip.rotation)
            limit = self.rotation_within_deg
            if limit is not None:
                yield within("orientation", "rad", turn, float(np.radians(limit)))
                return
            for k, i in enumerate(instant.turns):
                yield zero(f"orientation {'xyz'[i]}", "rad", turn[k])

    def place(self, instant: PlanInstant) -> ca.SX:
        """Position of the section (3x1) [m], world axes."""
        del instant
        return sparse(np.array(self.position))
