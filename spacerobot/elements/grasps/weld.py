"""Rigid grip."""

from __future__ import annotations

from typing import ClassVar, Literal

from spacerobot.elements.core.registry import register
from spacerobot.elements.grasps.rigid_grasp import RigidGrasp


@register
class Weld(RigidGrasp):
    """Rigid grip: the tip keeps its initial or captured pose in the mating frame."""

    fixes_orientation: ClassVar[bool] = True

    kind: Literal["weld"] = "weld"

    def assumptions(self) -> list[str]:
        """Duration and orientation of the connection."""
        return ["welded in the initial relative orientation"] if self.begins == "closed" else []
