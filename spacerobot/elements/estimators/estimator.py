"""Estimators: filters that make one estimate of several measurements, at instants."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import casadi as ca

from spacerobot.arrays import Array
from spacerobot.elements.core.contribution import Contribution, Innovation
from spacerobot.elements.core.robot_element import RobotElement, RobotProperties
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.elements.sensors.measurement import Measurement
from spacerobot.symbolic import Plant

HELD_INERTIA = "held_inertia"
"""Estimated signal: ten inertial parameters of what a tip holds, axes of the tip; zero if nothing."""


class SensorSampler(Protocol):
    """Samples of signals by the sensors of a robot."""

    def __call__(
        self,
        signal: str,
        value: ca.SX,
        axes: tuple[int, ...],
        carrier: ca.SX | None = None,
        away: tuple[ca.SX, ca.SX] | None = None,
    ) -> Measurement:
        """Samples with their times.

        Parameters
        ----------
        signal
            Name of the signal.
        value
            Vector (3x1), or attitude (3x3), whose errors are small rotations about world axes.
        axes
            Components that are measured.
        carrier
            Axes of what carries the sensor, in those of the signal (3x3); None if they are what is measured.
        away
            Place (3x1) [m] from which a vector is seen and which is added to it, and distance (1x1) [m].
        """


@dataclass(frozen=True)
class TargetModel:
    """The target as it is at the start by the scenario's numbers, one rigid body.

    Attributes
    ----------
    root, links
        Frames of its root link, and of all links by name, in the model.
    mass, moments
        Mass [kg] and principal moments of inertia (3,) [kg m^2].
    centre, axes
        Centre of mass (3,) [m] and principal axes (3, 3), both in the root link's axes.
    poses
        Rotation (3, 3) and origin (3,) [m] of the links in the root link's axes, by name.
    """

    root: int
    links: Mapping[str, int]
    mass: float
    moments: Array
    centre: Array
    axes: Array
    poses: Mapping[str, tuple[Array, Array]]


@dataclass(frozen=True)
class EstimatorContext:
    """A robot as its estimators see it; everything in world axes.

    Attributes
    ----------
    context
        Time and the numbers of the estimator's section.
    plant
        Mechanics now.
    label, robot
        Name of the estimator, unique in the closed loop, and of the robot.
    base_frame
        Of the robot's root link in the model.
    errors
        From a signal's name to the section ``errors`` of its sensor.
    sample
        Samples of signals, of this estimator alone.
    tips
        Frames of its tips in the model, by name.
    target
        The target; None if there is none.
    joints, positions
        Ids of its driven joints, and from their positions (n x 1) to those of all its joints, by id.
    attitude
        Of the base at the start (3x3), an expression of the parameters.
    read
        From a signal's name and its true value (n x 1) to what controllers would read of it now, with the
        estimates of the estimators that stand above this one.
    late
        Delay [s] of a signal that is read; zero of one that is estimated.
    closed
        Whether a tip, by name, holds a link of the target, by name (1x1).
    stored
        Gives the angular momentum (3x1) of the robot's wheels, world axes [N m s].
    innovations
        From the key of an estimator above this one to its innovations.
    rejected
        Whether a signal's samples are no longer to be used by this estimator, by the signal's name (1x1).
    pushed
        Gives the impulse (6x1) of the actuators of the robot's base since the start, as it is delivered:
        linear, and angular about the world's origin [N s, N m s].
    """

    context: SectionContext
    plant: Plant
    label: str
    robot: str
    base_frame: int
    errors: Callable[[str], SectionContext]
    sample: SensorSampler
    tips: Mapping[str, int]
    target: TargetModel | None
    joints: tuple[int, ...]
    positions: Callable[[ca.SX], Mapping[int, ca.SX]]
    attitude: ca.SX
    read: Callable[[str, ca.SX], ca.SX]
    late: Callable[[str], float]
    closed: Callable[[str, str], ca.SX]
    stored: Callable[[], ca.SX]
    innovations: Callable[[str], Sequence[Innovation]]
    rejected: Callable[[str], ca.SX]
    pushed: Callable[[], ca.SX]


class Estimator(RobotElement):
    """An estimator of signals that the controllers of a robot read.

    Attributes
    ----------
    needs
        Signals that it must have measurements of, whose sensors have ``errors``.
    makes
        Signals that it estimates.
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
