"""Controllers and sensors (Eq. 26-38, section 1.6 of the paper)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from spacerobot.scenario.section import Section, quantity


class Pid(Section):
    """PID on the tip's velocity error, mapped to joint torques by the Jacobian's transpose (Eq. 35).

    For an orientation PID units are those of torque per angular velocity: N m s/rad, N m/rad, N m s^2/rad.
    """

    kp: float = quantity("N s/m", "proportional gain K_p", default=0.0, ge=0)
    ki: float = quantity("N/m", "integral gain K_i", default=0.0, ge=0)
    kd: float = quantity("kg", "derivative gain K_d", default=0.0, ge=0)
    feedback: Literal["base", "inertial"] = Field(
        default="base",
        description="velocity that is fed back: seen from the robot's own base (joint rates through the "
        "manipulator Jacobian), or the true one",
    )
    derivative: Literal["ideal", "filtered"] = Field(
        default="ideal",
        description="ideal: the algebraic loop through the tip's acceleration, solved exactly; "
        "filtered: a first-order lag, as a real controller has",
    )
    filter_time: float = quantity("s", "time constant of the filtered derivative", default=0.02, gt=0)


class Amnesia(Section):
    """Leaky integral of the tip's position error that corrects the reference velocity (Eq. 37, 38)."""

    ge: float = quantity("1/s^2", "gain G_e", ge=0)
    ta: float = quantity("1/s", "forgetting rate t_a = K_e / R_e", ge=0)


class JointPd(Section):
    """Joint PD towards the inverse kinematics of the reference (Eq. 34)."""

    kp: float = quantity("N m/rad or N/m", "proportional gain K_p2", default=0.0, ge=0)
    kd: float = quantity("N m s/rad or N s/m", "derivative gain K_d2", default=0.0, ge=0)
    null_space: bool = Field(
        default=False,
        description="only the part of the torque that does not accelerate the robot's tips; the "
        "robot needs more joints than controlled directions",
    )
    ik_rate: float = quantity(
        "1/s", "rate at which the inverse kinematics removes its position error", default=10.0, ge=0
    )
    ik_damping: float = quantity("m", "damping of the inverse kinematics' pseudo-inverse", default=1e-3, ge=0)


SIGNALS_UNIT = "signal's unit"
"""Unit of a number that is in the unit of the section it stands in."""


class Calibration(Section):
    """Linear sensor S = a + b s, the same for every component of the signal (section 1.6)."""

    offset: float = quantity(SIGNALS_UNIT, "a", default=0.0)
    scale: float = quantity("1", "b", default=1.0)


class Sensors(Section):
    """Sensors of one robot, one calibration for each signal that a controller feeds back."""

    joint_position: Calibration = quantity(
        "rad, m", "joint positions, used by the joint PD", default=Calibration()
    )
    joint_rate: Calibration = quantity(
        "rad/s, m/s", "joint rates, used by `feedback: base` and the joint PD", default=Calibration()
    )
    tip_position: Calibration = quantity(
        "m", "tip positions, used by the amnesia controller", default=Calibration()
    )
    tip_velocity: Calibration = quantity(
        "m/s", "tip velocities, used by `feedback: inertial`", default=Calibration()
    )
    tip_orientation: Calibration = quantity(
        "rad",
        "rotation vector of tips relative to their references, for the amnesia controller",
        default=Calibration(),
    )
    tip_angular_velocity: Calibration = quantity(
        "rad/s", "angular velocities of tips, used by `feedback: inertial`", default=Calibration()
    )
