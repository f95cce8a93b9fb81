"""Robots and target: URDFs, initial states, changed mass properties, elements."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, model_validator

from spacerobot.common.section import Name, Section, Vector, quantity
from spacerobot.elements.core.registry import create
from spacerobot.scenario.element_fields import (
    Actuator,
    Estimator,
    FlexibleLink,
    JointPd,
    Pid,
    Reference,
    RobotController,
    TipController,
)
from spacerobot.scenario.sensors import Sensors

if TYPE_CHECKING:
    from spacerobot.elements import RobotElement


class Base(Section):
    """Joint between a body's root link and the world, and its initial pose and motion."""

    joint: Literal["planar", "free_flyer", "fixed"] = Field(
        default="free_flyer",
        description="planar: free in the world's x-y plane; free_flyer: free in space; fixed",
    )
    position: Vector = quantity("m", "root link's origin, world axes", default=(0.0, 0.0, 0.0))
    rotation_deg: Vector = quantity(
        "deg", "roll, pitch, yaw of the root link (as in URDF)", default=(0.0, 0.0, 0.0)
    )
    velocity: Vector = quantity(
        "m/s", "initial velocity of the root link's origin, world axes", default=(0.0, 0.0, 0.0)
    )
    spin_deg: Vector = quantity("deg/s", "initial angular velocity, world axes", default=(0.0, 0.0, 0.0))
    close_grasp: Name | None = Field(
        default=None,
        description="place the base so that this grasp closes; `position` is then computed, not given; "
        "so is its motion for a rigid grasp",
    )
    align: bool = Field(
        default=False,
        description="with `close_grasp`: turn the base too, so that the tip's axes begin as the mating "
        "frame's; `rotation_deg` is then computed, not given",
    )
    align_rotation_deg: Vector = quantity(
        "deg", "roll, pitch, yaw of the tip in the mating frame, where aligned", default=(0.0, 0.0, 0.0)
    )

    @model_validator(mode="after")
    def _check(self) -> Base:
        if self.joint == "planar" and (
            any(self.rotation_deg[:2])
            or any(self.align_rotation_deg[:2])
            or any(self.spin_deg[:2])
            or self.velocity[2]
        ):
            raise ValueError("a planar base turns about z and moves in x and y only")
        if self.joint == "fixed" and (any(self.velocity) or any(self.spin_deg)):
            raise ValueError("a fixed base has no velocity")
        if self.joint == "fixed" and self.close_grasp:
            raise ValueError("a fixed base is not placed by closing a grasp; place the target by it instead")
        if self.close_grasp and any(self.position):
            raise ValueError("give either `position` or `close_grasp`, not both")
        if self.align and not self.close_grasp:
            raise ValueError("align: which grasp? give `close_grasp` too")
        if self.align and any(self.rotation_deg):
            raise ValueError("give either `rotation_deg` or `align`, not both")
        if any(self.align_rotation_deg) and not self.align:
            raise ValueError("align_rotation_deg: without effect; give `align: true` too")
        return self


class Link(Section):
    """Mass properties of one link; missing values are those of the URDF."""

    mass: float | None = quantity("kg", "mass", default=None, ge=0)
    com: Vector | None = quantity("m", "centre of mass, link axes", default=None)
    inertia: tuple[float, float, float, float, float, float] | None = quantity(
        "kg m^2", "ixx, iyy, izz, ixy, ixz, iyz about the centre of mass, link axes", default=None
    )
    inertia_at_mass: float | None = quantity(
        "kg",
        "mass to which `inertia` belongs, so that it scales with another mass; the URDF's if not given, but "
        "an `inertia` that is given alone does not scale",
        default=None,
        gt=0,
    )

    @model_validator(mode="after")
    def _check(self) -> Link:
        if self.inertia_at_mass is not None and self.inertia is None:
            raise ValueError("inertia_at_mass: of which inertia? give `inertia` too")
        return self


class Joint(Section):
    """Initial state, damping and torque limit of one joint; missing values are those of the URDF."""

    angle_deg: float | None = quantity("deg", "initial angle of a revolute or continuous joint", default=None)
    offset: float | None = quantity("m", "initial offset of a prismatic joint", default=None)
    rate_deg: float | None = quantity("deg/s", "initial rate of a revolute or continuous joint", default=None)
    speed: float | None = quantity("m/s", "initial speed of a prismatic joint", default=None)
    damping: float | None = quantity("N m s/rad or N s/m", "viscous resistance R_j", default=None, ge=0)
    torque_limit: float | None = quantity(
        "N m or N", "maximum torque or force of the actuator", default=None, gt=0
    )
    locked: bool | None = Field(
        default=None, description="hold the joint where it begins, as if it were fixed"
    )

    @model_validator(mode="after")
    def _check(self) -> Joint:
        if self.locked and (self.rate_deg or self.speed):
            raise ValueError("a locked joint has no rate")
        return self


class Placement(Section):
    """Placement of a link on its parent with its joint at zero; missing values are those of the URDF."""

    position: Vector | None = quantity("m", "of its joint, axes of the parent link", default=None)
    rotation_deg: Vector | None = quantity(
        "deg", "roll, pitch, yaw of its joint in the parent link's axes", default=None
    )


def _expanded_urdf() -> Any:
    return Field(default=None, description="URDF text that a .xacro file expands to; filled in")


class Body(Section):
    """Section of a body that a URDF describes: a robot or the target."""

    urdf: str = Field(
        min_length=1,
        max_length=4096,
        description="URDF file: a path (relative to the scenario), or a shipped file's name",
    )
    expanded_urdf: str | None = _expanded_urdf()
    base: Base = Field(default=Base(), description="joint between root link and world")
    links: dict[str, Link] = Field(
        default={},
        description="mass properties that differ from the URDF, by link name; `*` in a name "
        "matches any letters",
    )
    placements: dict[str, Placement] = Field(
        default={},
        description="placements on their parents, by link name, that differ from the URDF: mating frames, "
        "tips, links of another length",
    )
    joints: dict[str, Joint] = Field(
        default={},
        description="initial state and resistance, by joint name; `*` in a name matches any letters",
    )
    flexible: dict[Name, FlexibleLink] = Field(
        default={}, description="links that bend, of any kind, by name; their joints are called NAME_..."
    )


class Amnesia(Section):
    """Leaky integral of the tip's position error that corrects the reference velocity (Eq. 37, 38)."""

    ge: float = quantity("1/s^2", "gain G_e", ge=0)
    ta: float = quantity("1/s", "forgetting rate t_a = K_e / R_e", ge=0)


class Tip(Section):
    """A robot's frame that can hold something, with its controllers."""

    frame: str | None = Field(
        default=None, description="URDF link that is the tip; the tip's own name if not given"
    )
    pid: Pid | None = Field(default=None, description="velocity PID of the tip's position")
    amnesia: Amnesia | None = Field(default=None, description="amnesia controller of the tip's position")
    orientation_pid: Pid | None = Field(
        default=None, description="angular velocity PID of the tip [N m s/rad, N m/rad, N m s^2/rad]"
    )
    orientation_amnesia: Amnesia | None = Field(
        default=None, description="amnesia controller of the tip's orientation"
    )
    reference: Reference | None = Field(
        default=None,
        description="the tip's reference; derived from the target's if not given, and to hold if neither is",
    )
    controllers: dict[Name, TipController] = Field(
        default={}, description="further controllers of the tip, of any kind, by name"
    )

    @model_validator(mode="after")
    def _check(self) -> Tip:
        if self.amnesia and not self.pid:
            raise ValueError("the amnesia controller corrects the PID's reference: give `pid` too")
        if self.orientation_amnesia and not self.orientation_pid:
            raise ValueError("`orientation_amnesia` corrects `orientation_pid`: give it too")
        return self

    @property
    def sections(self) -> dict[str, Section]:
        """Sections by key."""
        return {key: value for key, value in self if isinstance(value, Section)}

    def elements(self) -> Iterator[tuple[str, TipController]]:
        """Controllers of the tip with their keys in the section."""
        for key, pid in (("pid", self.pid), ("orientation_pid", self.orientation_pid)):
            if pid is not None:
                yield key, pid
        for name, controller in self.controllers.items():
            yield f"controllers.{name}", controller


class Mount(Section):
    """An arm welded to one of the robot's links; it has no base of its own."""

    urdf: str = Field(min_length=1, max_length=4096, description="URDF file of the arm, named as a robot's")
    expanded_urdf: str | None = _expanded_urdf()
    link: str | None = Field(
        default=None,
        description="link that carries it, of the robot or of an earlier mount; the root link if none",
    )
    position: Vector = quantity("m", "its root link's origin, axes of that link", default=(0.0, 0.0, 0.0))
    rotation_deg: Vector = quantity(
        "deg", "roll, pitch, yaw of its root link in that link's axes", default=(0.0, 0.0, 0.0)
    )


class Robot(Body):
    """A robot: a body with tips and controllers."""

    mounts: dict[Name, Mount] = Field(
        default={},
        description="arms welded to it, by name; their links and joints are called NAME_link and NAME_joint",
    )
    tips: dict[Name, Tip] = Field(default={}, description="frames that can hold something")
    joint_pd: JointPd | None = Field(
        default=None, description="joint PD towards the inverse kinematics of the references"
    )
    controllers: dict[Name, RobotController] = Field(
        default={}, description="further controllers of all joints, of any kind, by name"
    )
    sensors: Sensors | None = Field(default=None, description="sensor errors; ideal sensors if not given")
    estimators: dict[Name, Estimator] = Field(
        default={},
        description="filters whose estimates its controllers read instead of sensors, of any kind, by name",
    )
    torque_limits: bool = Field(
        default=False,
        description="clip joint torques at `torque_limit`, the URDF's effort limits; an actuator of kind "
        "torque_limit for all joints",
    )
    actuators: dict[Name, Actuator] = Field(
        default={},
        description="actuators of its joints and its base, of any kind, by name; forces that none takes "
        "over are delivered as commanded",
    )

    @model_validator(mode="after")
    def _check_encoders(self) -> Robot:
        motors = [signal for signal, sensor in self.sensors or () if sensor.reads_motors]
        if motors and not any(actuator.has_motors for actuator in self.actuators.values()):
            raise ValueError(f"sensors.{motors[0]}.side: found motor, allowed without a transmission: link")
        for name, tip in self.tips.items():
            for key, controller in tip.elements():
                if "joint_rate" in motors and controller.feeds_back_joint_acceleration:
                    raise ValueError(
                        f"tips.{name}.{key}.derivative: found ideal, allowed with `joint_rate` measured at "
                        "the motors: filtered"
                    )
        return self

    def elements(self) -> Iterator[tuple[str, RobotController]]:
        """Controllers of the robot, without those of tips, with their keys in the section."""
        if self.joint_pd is not None:
            yield "joint_pd", self.joint_pd
        for name, controller in self.controllers.items():
            yield f"controllers.{name}", controller

    def driven_by(self) -> Iterator[tuple[str, Actuator]]:
        """Actuators of the robot in the order in which they act, with their keys in the section."""
        if self.torque_limits:
            yield "torque_limits", create("actuator", "torque_limit")
        for name, actuator in self.actuators.items():
            yield f"actuators.{name}", actuator

    def parts(self) -> Iterator[tuple[str, RobotElement]]:
        """Controllers, actuators and estimators of the robot with their keys in the section."""
        yield from self.elements()
        yield from self.driven_by()
        for name, estimator in self.estimators.items():
            yield f"estimators.{name}", estimator


class Target(Body):
    """Object that is captured, held or carried."""

    reference: Reference | None = Field(
        default=None, description="the object's reference, from which tips derive theirs"
    )
