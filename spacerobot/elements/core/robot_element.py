"""Base of controllers and actuators of a whole robot: they are verified against its properties."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from spacerobot.arrays import Array
from spacerobot.elements.core.element import Element

Part = Literal["force", "torque"]
"""Part of a wrench on a base."""


@dataclass(frozen=True)
class RobotProperties:
    """A robot in its initial posture, in numbers.

    Attributes:
        name: Name of the robot.
        joints: Names of its free joints: none that mimics another one, none that an actuator owns.
        limits: Greatest torque of each joint [N m or N] by name; none where neither scenario nor URDF gives
            one.
        efforts: The URDF's effort of each joint [N m or N] by name.
        find_moved: Finds :attr:`moved`, which takes time.
        begins: Initial position of each joint [rad or m] by name, as far as the scenario gives it.
        base: Joint between its base and the world: ``planar``, ``free_flyer`` or ``fixed``.
        spinning: Axis (3,), root link's axes, of each joint by name that turns without end on that link and
            carries no other joint; also of those that actuators own.
        owned: Names of the joints that actuators own, as wheels.
        sensors: Sections of its sensors (:class:`spacerobot.elements.Sensor`) by signal; none where they are
            ideal.
        tips: Names of its tips.
        target_links: Names of the target's links.
    """

    name: str
    joints: tuple[str, ...]
    limits: Mapping[str, float | None]
    efforts: Mapping[str, float]
    find_moved: Callable[[], Array]
    begins: Mapping[str, float] = field(default_factory=dict)
    base: str = "free_flyer"
    spinning: Mapping[str, Array] = field(default_factory=dict)
    owned: tuple[str, ...] = ()
    sensors: Mapping[str, Any] = field(default_factory=dict)
    tips: tuple[str, ...] = ()
    target_links: tuple[str, ...] = ()

    @functools.cached_property
    def moved(self) -> Array:
        """Velocities of the controlled directions of its tips by its joints' rates (directions, joints)."""
        return self.find_moved()

    @property
    def rank(self) -> int:
        """Number of independent controlled directions."""
        return int(np.linalg.matrix_rank(self.moved, tol=1e-9)) if self.moved.size else 0


class RobotElement(Element):
    """An element of a whole robot.

    Attributes:
        base_wrench: Parts of a wrench on the robot's base that a controller asks for, or an actuator takes
            over.
    """

    base_wrench: ClassVar[frozenset[Part]] = frozenset()

    @property
    def own_wrench(self) -> frozenset[Part]:
        """Parts of the base wrench that it commands or takes over, by its section."""
        return self.base_wrench

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Reasons why the element cannot act on this robot: key of the section or empty, and a sentence."""
        del robot
        return ()

    def cautions(self, robot: RobotProperties) -> Iterable[str]:
        """Cautions for the user where it acts on this robot, a sentence each."""
        del robot
        return ()
