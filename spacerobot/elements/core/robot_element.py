"""Base class of controllers and actuators of a whole robot, which are validated against its properties."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.elements.core.element import Element

Part = Literal["force", "torque"]
"""Part of a wrench on a base."""


@dataclass(frozen=True)
class RobotProperties:
    """Properties of a robot in its initial posture.

    Attributes:
        name: Name of the robot.
        joints: Names of its free joints, without mimic joints and those that actuators own.
        limits: Maximum torque or force of each joint [N m or N] by name; None if neither scenario nor URDF
            states one.
        efforts: Effort limit in the URDF of each joint [N m or N] by name.
        find_moved: Function that computes :attr:`moved`, on demand because it takes time.
        begins: Initial position of each joint [rad or m] by name, if the scenario states it.
        base: Joint between its base and the world: ``planar``, ``free_flyer`` or ``fixed``.
        spinning: Axis (3,), root link's axes, by name of each continuous joint on that link that carries no
            other joint; includes joints that actuators own.
        owned: Names of the joints that actuators own, such as wheels.
        sensors: Sections of its sensors (:class:`spacerobot.elements.Sensor`) by signal, ideal ones included;
            empty if the scenario has no sensors for the robot.
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
        """Jacobian (directions, joints) from the robot's joint rates to the controlled tip directions."""
        return self.find_moved()

    @property
    def rank(self) -> int:
        """Number of independent controlled directions."""
        return int(np.linalg.matrix_rank(self.moved, tol=1e-9)) if self.moved.size else 0


class RobotElement(Element):
    """Element of a whole robot.

    Attributes:
        base_wrench: Parts of the wrench on the robot's base that a controller commands or an actuator
            delivers.
    """

    base_wrench: ClassVar[frozenset[Part]] = frozenset()

    @property
    def own_wrench(self) -> frozenset[Part]:
        """Parts of the base wrench that it commands or delivers."""
        return self.base_wrench

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Reasons why the element cannot act on this robot: key of the section or empty, and a sentence."""
        del robot
        return ()

    def cautions(self, robot: RobotProperties) -> Iterable[str]:
        """Warnings about the element on this robot, one sentence each."""
        del robot
        return ()
