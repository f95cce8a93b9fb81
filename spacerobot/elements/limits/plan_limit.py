"""Limits: conditions at all times of a planned motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from spacerobot.elements.core.element import Element
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant
from spacerobot.elements.shapes.collision_shape import Wrap

JointQuantity = Literal["rate", "torque"]
WrenchPart = Literal["force", "torque"]


@dataclass(frozen=True)
class PlannedJoint:
    """A joint that is planned, as a limit sees it.

    Attributes:
        label: ``robot/joint``.
        kind: ``revolute``, ``continuous`` or ``prismatic``.
        limited: Names among ``position``, ``rate`` and ``torque`` that the URDF, or the scenario, limits.
        file: Name of the URDF's file.
    """

    label: str
    kind: str
    limited: frozenset[str]
    file: str


@dataclass(frozen=True)
class SeparatedShapes:
    """Shapes that a limit keeps separated.

    Attributes:
        between: Two sides, each the name of a pad, or a link with ``*`` for any letters.
        wrap: Shape that replaces meshes and cylinders.
    """

    between: tuple[str, str]
    wrap: Wrap | None


@dataclass(frozen=True)
class ApproachCone:
    """A cone that opens from a mating frame against the direction of approach.

    Attributes:
        frame: The mating frame, a link of the target's URDF.
        axis: Direction of approach in that frame (3,).
        half_angle_deg: Between its axis and its surface [deg].
        radius: Radius of its cut in the frame's plane [m].
    """

    frame: str
    axis: tuple[float, ...]
    half_angle_deg: float
    radius: float


class PlanLimit(Element):
    """Limit of a plan: bounds on unknowns, which cost the solver nothing, or path constraints.

    In a scenario a single number or list is the value of the key :attr:`short`. The section's key is the kind
    if the section names none: ``torque: 3`` is ``torque: {kind: torque, upper: 3}``.
    """

    family: ClassVar[str] = "plan_limit"
    short: ClassVar[str | None] = "upper"

    def joint_limits(self, joint: PlannedJoint) -> Mapping[JointQuantity, float]:
        """Maximum rate [rad/s or m/s] and torque [N m or N] of a joint, if the limit applies to them."""
        del joint
        return {}

    def base_limits(self) -> Mapping[WrenchPart, float]:
        """Maximum force [N] along and torque [N m] about each axis that drives a floating base."""
        return {}

    @property
    def relative_to_start(self) -> bool:
        """Whether it is measured from the initial pose of the base."""
        return False

    @property
    def separated(self) -> SeparatedShapes | None:
        """Shapes that it keeps separated, for drawings and checks before planning; None if it has none."""
        return None

    @property
    def approach_cone(self) -> ApproachCone | None:
        """Cone in which it keeps a tip, for drawings; None if it has none."""
        return None

    def faults(self, joint: PlannedJoint) -> Iterator[str]:
        """Reasons why a joint cannot be planned with the limit."""
        del joint
        yield from ()

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Path constraints.

        Raises:
            ScenarioError: If it names an unknown body, link or joint.
        """
        del instant
        yield from ()
