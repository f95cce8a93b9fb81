"""Estimators: filters that combine several measurements into estimates at sample instants."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import casadi as ca

from spacerobot.common.arrays import Array
from spacerobot.common.registry import required
from spacerobot.elements.core.contribution import Contribution, Innovation
from spacerobot.elements.core.robot_element import RobotElement, RobotProperties
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.sensors.measurement import Measurement
from spacerobot.symbolic import Plant

HELD_INERTIA = "held_inertia"
"""Estimated signal: ten inertial parameters of the held object, tip axes; zero without one."""


@dataclass(frozen=True)
class TargetModel:
    """Target at the start, as one rigid body with the scenario's numbers.

    Attributes:
        root, links: Frames of its root link, and of all links by name, in the model.
        mass, moments: Mass [kg] and principal moments of inertia (3,) [kg m^2].
        centre, axes: Centre of mass (3,) [m] and principal axes (3, 3), both in the root link's axes.
        poses: Rotation (3, 3) and origin (3,) [m] of the links in the root link's axes, by name.
    """

    root: int
    links: Mapping[str, int]
    mass: float
    moments: Array
    centre: Array
    axes: Array
    poses: Mapping[str, tuple[Array, Array]]


class EstimatorContext(Protocol):
    """A robot as its estimators see it; vectors are in world axes."""

    @property
    def context(self) -> SectionContext:
        """Time and the numbers of the estimator's section."""

    @property
    def plant(self) -> Plant:
        """Mechanics at the current state."""

    @property
    def label(self) -> str:
        """Name of the estimator, unique in the closed loop."""

    @property
    def robot(self) -> str:
        """Name of the robot."""

    @property
    def base_frame(self) -> int:
        """Frame of the robot's root link in the model."""

    @property
    def joints(self) -> tuple[int, ...]:
        """Ids of the robot's driven joints."""

    @property
    def tips(self) -> Mapping[str, int]:
        """Frames of the robot's tips in the model, by name."""

    @property
    def target(self) -> TargetModel | None:
        """Rigid-body model of the target; None without a floating target."""

    @property
    def attitude(self) -> ca.SX:
        """Attitude of the base at the start (3x3), an expression of the parameters."""

    def errors(self, signal: str) -> SectionContext:
        """Context of the section ``errors`` of a signal's sensor."""

    def sample(
        self,
        signal: str,
        value: ca.SX,
        axes: tuple[int, ...],
        carrier: ca.SX | None = None,
        away: tuple[ca.SX, ca.SX] | None = None,
    ) -> Measurement:
        """Samples with their times, for this estimator only.

        Args:
            signal: Name of the signal.
            value: Vector (3x1), or attitude (3x3), whose errors are small rotations about world axes.
            axes: Measured components.
            carrier: Axes of the link that carries the sensor, in those of the signal (3x3); None if the
                sensor measures in its own axes.
            away: Position (3x1) [m] from which the vector is seen, which is added to it, and distance (1x1)
                [m].
        """

    def positions(self, driven: ca.SX) -> Mapping[int, ca.SX]:
        """Positions of all joints by id, from the driven joints' positions (n x 1) [rad or m]."""

    def read(self, signal: str, value: ca.SX) -> ca.SX:
        """Signal as controllers read it now (n x 1), with the estimates of the estimators listed earlier.

        Args:
            signal: Name of the signal.
            value: True value (n x 1).
        """

    def delay_s(self, signal: str) -> float:
        """Delay of a signal that is read [s]; zero of one that is estimated."""

    def holds(self, tip: str, link: str) -> ca.SX:
        """Switch (1x1) that is nonzero while a tip holds a link of the target.

        Args:
            tip, link: Names of the tip and of the link.
        """

    def stored_momentum(self) -> ca.SX:
        """Angular momentum (3x1) of the robot's wheels, world axes [N m s]."""

    def innovations(self, key: str) -> Sequence[Innovation]:
        """Innovations of an earlier estimator of the robot, by its key."""

    def rejected(self, signal: str) -> ca.SX:
        """Switch (1x1): nonzero once samples of a signal must no longer be used by this estimator."""

    def base_impulse(self) -> ca.SX:
        """Impulse (6x1) that the actuators of the robot's base have delivered since the start.

        Linear, and angular about the world's origin [N s, N m s].
        """


class Estimator(RobotElement):
    """Estimator of signals that the robot's controllers read.

    Attributes:
        needs: Signals that must be measured by sensors with ``errors``.
        makes: Signals that it estimates.
    """

    family: ClassVar[str] = "estimator"
    needs: ClassVar[tuple[str, ...]] = ()
    makes: ClassVar[tuple[str, ...]] = ()

    def frames(self) -> tuple[str, str] | None:
        """Tip that carries its camera, and link of the target that it sees; None for one without."""
        return None

    def rejects(self) -> tuple[str, str] | None:
        """Estimator, by key, and signal that it no longer uses once this one's switch ``detected`` is on."""
        return None

    @required()
    def build(self, robot: EstimatorContext) -> Contribution:
        """Contribution to the closed loop, with its estimates."""
        raise NotImplementedError

    def reads(self) -> set[str]:
        """Signals that it reads from sensors."""
        return set(self.needs)

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Measurements that it lacks."""
        for signal in self.needs:
            sensor = robot.sensors.get(signal)
            if sensor is None or sensor.errors is None:
                yield (
                    "",
                    f"needs samples of {signal}, found none; give robots.{robot.name}.sensors.{signal} a "
                    "sensor with `errors`, as the presets have",
                )
