"""Flexible links: joints and springs in place of a link that bends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeVar

import casadi as ca
from pydantic import Field

from spacerobot.common.arrays import Array
from spacerobot.common.registry import required
from spacerobot.description.read import Description
from spacerobot.elements.core.contribution import Contribution
from spacerobot.elements.core.element import Element
from spacerobot.symbolic import Plant

Number = TypeVar("Number", float, ca.SX)


@dataclass(frozen=True)
class FlexibleContext:
    """A flexible link as its law sees it.

    Attributes:
        plant: Mechanics now.
        description: The URDF, with the links and joints of the flexible link.
        body, name: Names of the robot or the target, and of the flexible link.
    """

    plant: Plant
    description: Description
    body: str
    name: str

    def position(self, joint: str) -> ca.SX | None:
        """Position (1x1) [rad or m] of one of the joints; None if it is locked."""
        model, full = self.plant.model, f"{self.body}/{joint}"
        exists = model.existJointName(full)
        return self.plant.q[model.joints[model.getJointId(full)].idx_q] if exists else None

    def placement(self, link: str) -> tuple[ca.SX, ca.SX]:
        """Rotation (3x3) and origin (3x1) [m] of a link."""
        return self.plant.placement(int(self.plant.model.getFrameId(f"{self.body}/{link}")))


class FlexibleLink(Element):
    """Flexible link: passive joints with springs and dampers that controllers do not measure.

    The joints are part of the model, so every algorithm applies to them. Their mass is subtracted from the
    link's mass properties, so that the total is that of the whole link: see
    :attr:`~spacerobot.description.parts.UrdfLink.borrowed`.
    """

    family: ClassVar[str] = "flexible_link"

    link: str = Field(description="link of the URDF that bends")

    @required()
    def expanded(self, description: Description, name: str) -> Description:
        """Description with the links and joints of the flexible link.

        Args:
            description: The URDF.
            name: Name of the flexible link, the prefix of its links and joints.

        Raises:
            DescriptionError: If the link does not exist, or the flexible link cannot be realised.
        """
        raise NotImplementedError

    @required()
    def springs(
        self, description: Description, name: str, number: Callable[[str], Number]
    ) -> Mapping[str, tuple[Number, Number]]:
        """Stiffness [N m/rad or N/m] and damping [N m s/rad or N s/m] of each joint, by its name.

        Args:
            description: Description after the expansion.
            name: Name of the flexible link.
            number: Function from a key of the section to its number.
        """
        raise NotImplementedError

    @required()
    def moving_inertia(self, description: Description, name: str) -> Array:
        """Share of the link's spatial inertia that moves in the joints (6, 6), linear rows first.

        Args:
            description: Description after the expansion.
            name: Name of the flexible link.

        Returns:
            numpy.ndarray: About the origin of the link it is taken from, in its axes.
        """
        raise NotImplementedError

    def carrier(self, name: str) -> str:
        """Name of the link from whose mass properties the moving parts are subtracted."""
        del name
        return self.link

    def words(self) -> str:
        """Kind and link, in a few words."""
        return f"{self.kind} of {self.link}"

    @required()
    def build(self, flexible: FlexibleContext) -> Contribution:
        """Outputs by which its deflection is observed."""
        raise NotImplementedError
