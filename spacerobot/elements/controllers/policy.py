"""Controller whose forces are the actions of a reinforcement-learning environment."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy.typing as npt
from pydantic import Field

from spacerobot.elements.controllers.python_controller import Measurements, PythonController
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import Part


@register
class Policy(PythonController):
    """Torques of joints, and a wrench on the base, that an environment's actions set.

    :mod:`spacerobot.learning` adds one to each robot of a scene. The saved scenario of an episode has it as
    well.
    """

    base_wrench: ClassVar[frozenset[Part]] = frozenset({"force", "torque"})

    kind: Literal["policy"] = "policy"
    parts: tuple[Part, ...] = Field(
        default=(), description="parts of the wrench on the base, world axes, that it sets"
    )

    @property
    def own_wrench(self) -> frozenset[Part]:
        """Parts of the wrench, by its section."""
        return frozenset(self.parts)

    def update(self, t: float, measurements: Measurements) -> npt.ArrayLike:
        """Raise an error: only an environment sets the actions."""
        del t, measurements
        raise ValueError("only an environment of spacerobot.learning sets its actions")
