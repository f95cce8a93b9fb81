"""Maximum torque or force of any joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from spacerobot.elements.core.registry import register
from spacerobot.elements.limits.plan_limit import JointQuantity, PlanLimit, PlannedJoint
from spacerobot.section import quantity


@register
class JointTorqueLimit(PlanLimit):
    """Maximum torque or force of any joint."""

    kind: Literal["torque"] = "torque"
    upper: float = quantity("N m or N", "maximum torque or force of any joint", gt=0)

    def joint_limits(self, joint: PlannedJoint) -> Mapping[JointQuantity, float]:
        """Torque of every joint."""
        del joint
        return {"torque": self.upper}
