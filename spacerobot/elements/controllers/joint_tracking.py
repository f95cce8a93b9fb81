"""Tracking of a planned motion of the joints; see :mod:`spacerobot.elements.controllers.joint_plan`."""

from __future__ import annotations

from typing import Literal

from spacerobot.elements.controllers.joint_plan import JointPlanController
from spacerobot.elements.core.registry import register


@register
class JointTracking(JointPlanController):
    """Torques of a planned motion, and joint PD towards its positions and rates."""

    kind: Literal["joint_tracking"] = "joint_tracking"
