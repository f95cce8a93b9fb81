"""Maximum speed of any prismatic joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from spacerobot.elements.core.registry import register
from spacerobot.elements.limits.plan_limit import JointQuantity, PlanLimit, PlannedJoint
from spacerobot.section import quantity


@register
class JointSpeedLimit(PlanLimit):
    """Maximum speed of any prismatic joint."""

    kind: Literal["joint_speed"] = "joint_speed"
    upper: float = quantity("m/s", "maximum speed of any prismatic joint", gt=0)

    def joint_limits(self, joint: PlannedJoint) -> Mapping[JointQuantity, float]:
        """Speed of a joint that slides."""
        return {"rate": self.upper} if joint.kind == "prismatic" else {}
