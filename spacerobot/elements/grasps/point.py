"""Rigid point contact."""

from __future__ import annotations

from typing import Literal

from spacerobot.elements.core.registry import register
from spacerobot.elements.grasps.rigid_grasp import RigidGrasp


@register
class Point(RigidGrasp):
    """Rigid point contact: the tip stays at the mating frame and may turn about it."""

    kind: Literal["point"] = "point"
