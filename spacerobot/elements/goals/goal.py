"""Goals: conditions at the end of a planned motion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import casadi as ca
from pydantic import Field, model_validator

from spacerobot.common.registry import required
from spacerobot.common.section import quantity
from spacerobot.elements.core.element import Element
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant
from spacerobot.elements.references.reference import Reference

FLAT: dict[str, Any] = {
    "tip": None,
    "frame": None,
    "standoff": 0.0,
    "axis": [1.0, 0.0, 0.0],
    "mated_deg": [0.0, 0.0, 0.0],
    "closing_speed": 0.0,
    "position": None,
    "rotation_deg": None,
    "orientation": True,
    "robot": None,
    "joints": {},
    "still": None,
}
"""Keys of older results, in which every goal had all keys, with their defaults."""


class Goal(Element):
    """Something that holds at the end."""

    family: ClassVar[str] = "goal"

    rest: bool | None = Field(
        default=None,
        description="whether the robot's joints rest at the end, for `still` those of all robots that hold "
        "the same object; they do if not given, but for `mated`",
    )

    rate_within: float = quantity(
        "rad/s or m/s", "tolerance of the joints' rates where they rest", default=0.0, ge=0
    )

    @model_validator(mode="before")
    @classmethod
    def _former_keys(cls, data: Any) -> Any:
        """Drop keys of other kinds that hold default values, from older results."""
        if not isinstance(data, dict):
            return data
        values = {k: list(v) if isinstance(v, tuple) else v for k, v in data.items()}
        return {
            key: data[key]
            for key, value in values.items()
            if key in cls.model_fields or key not in FLAT or value != FLAT[key]
        }

    @property
    def rests(self) -> bool:
        """Whether the robot's joints are at rest at the end."""
        return True if self.rest is None else self.rest

    @property
    def ends_in_motion(self) -> bool:
        """Whether the body's joints may have any rates and accelerations at the end."""
        return not self.rests

    @property
    @required()
    def body(self) -> str:
        """Name of the body whose joints the goal concerns."""
        raise NotImplementedError

    def resting(self, instant: PlanInstant) -> Iterator[Goal]:
        """Goals of the bodies whose joints are at rest at the end: this one, and those that it implies.

        Args:
            instant: Last instant of the plan.
        """
        del instant
        if self.rests:
            yield self

    @property
    def stops(self) -> str | None:
        """Name of the body that has no motion at all in the world at the end, momentum included.

        None if none.
        """
        return None

    def settling(self, instant: PlanInstant) -> ca.SX | None:
        """Motion of a tip at the end, which the joints produce with minimum rates and without acceleration.

        Args:
            instant: The last instant.

        Returns:
            casadi.SX or None: Velocities [m/s] and spins [rad/s] of the tip (n x 1); None if joint rates at
                the end are free.
        """
        del instant
        return None

    def arrival(self, instant: PlanInstant) -> tuple[ca.SX, ca.SX] | None:
        """Velocity [m/s] and spin [rad/s] of a tip relative to its mating frame, for a goal that has one."""
        del instant
        return None

    @property
    def tip_label(self) -> str | None:
        """Tip that it places, ``robot/tip``; None for a goal without :meth:`place`."""
        return None

    @property
    def mating(self) -> tuple[str, str] | None:
        """Tip and link of the target that it brings together, if any."""
        return None

    @property
    def end_distance(self) -> float:
        """Distance from the followed frame at the end [m]."""
        return 0.0

    @property
    def is_exact(self) -> bool:
        """Whether the tip's pose has no tolerance."""
        return True

    @property
    def end_speed(self) -> float | None:
        """Speed of the tip relative to the followed frame at the end [m/s].

        None if its joints, or part of its motion relative to the frame, are free.
        """
        return None

    def place(self, instant: PlanInstant) -> ca.SX:
        """Desired position of the tip (3x1) [m], world axes. Only goals with a ``tip_label`` have one.

        Raises:
            ScenarioError: If it names an unknown body, link or joint.
        """
        raise NotImplementedError

    def kept(self, scenario_reference: Reference | None) -> dict[str, Any]:
        """Section of a reference that keeps the goal satisfied after the plan.

        Args:
            scenario_reference: Reference of the tip after the plan by the scenario.
        """
        del scenario_reference
        return {"kind": "hold"}

    @required()
    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Terminal constraints, except joints at rest.

        Raises:
            ScenarioError: If the goal names an unknown body, link or joint.
        """
        raise NotImplementedError


class TipGoal(Goal):
    """Terminal condition of a tip."""

    tip: str = Field(description="which tip, as robot/tip")

    @property
    def body(self) -> str:
        """The tip's robot."""
        return self.tip.partition("/")[0]

    @property
    def tip_label(self) -> str:
        """The tip."""
        return self.tip

    @property
    def mating(self) -> tuple[str, str] | None:
        """The tip, and the link of the target that it follows."""
        return None if self.follows is None else (self.tip, self.follows)

    @property
    def follows(self) -> str | None:
        """Link of the target that it follows, if any."""
        return None

    @required()
    def place(self, instant: PlanInstant) -> ca.SX:
        """Desired position of the tip (3x1) [m], world axes.

        Raises:
            ScenarioError: If it names an unknown body, link or joint.
        """
        raise NotImplementedError
