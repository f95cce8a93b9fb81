"""Maximum rate of any revolute or continuous joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from spacerobot.elements.core.registry import register
from spacerobot.elements.limits.plan_limit import JointQuantity, PlanLimit, PlannedJoint
from spacerobot.section import quantity


@register
class JointRateLimit(PlanLimit):
    """Maximum rate of any revolute or continuous joint."""

    kind: Literal["joint_rate_deg"] = "joint_rate_deg"
    upper: float = quantity("deg/s", "maximum rate of any revolute or continuous joint", gt=0)

    def joint_limits(self, joint: PlannedJoint) -> Mapping[JointQuantity, float]:
        """Maximum rate of a revolute or continuous joint."""
        return {} if joint.kind == "prismatic" else {"rate": float(np.radians(self.upper))}
