"""What controllers of whole robots ask for, each kind by its second writing."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from spacerobot.common.arrays import Array
from spacerobot.elements import RobotController
from spacerobot.scene import Scene, SceneBody
from tests.oracles.engine.kinematics import Kinematics
from tests.oracles.engine.laws import refusal
from tests.oracles.engine.references import Motion
from tests.oracles.engine.tip_control import Command


@dataclass(frozen=True)
class Asking:
    """An instant as controllers of robots see it.

    Attributes:
        t, within: Time since the phase began [s], and one that tells which piece of a motion is meant.
        phase: Name of the phase; empty where there are none.
        kinematics: Of the plant.
        motions: Of the tips' references, by label.
    """

    t: float
    within: float
    phase: str
    kinematics: Kinematics
    motions: Mapping[str, Motion]


@dataclass(frozen=True)
class Asked:
    """What a controller of a robot asks for.

    Attributes:
        torque: Generalized forces (nv,).
        rates: Of its states (n,).
        null_space: Whether only the part of the torque that does not accelerate the robot's tips shall act.
        command: In place of the torque: what depends on the acceleration it causes.
    """

    torque: Array
    rates: Array
    null_space: bool = False
    command: Command | None = None


class RobotLaw(Protocol):
    """A controller of one robot."""

    @property
    def body(self) -> SceneBody:
        """The robot."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of its states."""

    @property
    def ends(self) -> tuple[float, ...]:
        """Times since a phase began at which it may not be smooth in it [s]."""

    def initial(self, kinematics: Kinematics) -> Array:
        """States at the start (n,)."""

    def ask(self, now: Asking, states: Array) -> Asked:
        """What it asks for."""


@functools.singledispatch
def robot_law(controller: RobotController, scene: Scene, body: SceneBody, key: str) -> RobotLaw:
    """What a controller of a robot asks for, of each kind; ``key`` is its own in the robot's section."""
    del scene, body, key
    raise refusal(controller)
