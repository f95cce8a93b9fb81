"""Elements: references, grasps, actuators, environments, ...; a kind is one file, section and law."""

from spacerobot.elements.actuator import Actuator
from spacerobot.elements.collision_shape import CollisionShape
from spacerobot.elements.contact import Contact
from spacerobot.elements.context import (
    ActuatorContext,
    Affine,
    ContactContext,
    GraspContext,
    RobotContext,
    TipContext,
)
from spacerobot.elements.contribution import (
    AccelerationConstraint,
    ActuatorDrive,
    CommandedTorque,
    Contribution,
    ControlChannel,
    Output,
    PowerTerm,
    State,
    StoredMomentum,
    memory,
)
from spacerobot.elements.controller import RobotController, TipController
from spacerobot.elements.desired_motion import DesiredMotion, InitialMotion, TimeProfile, cubic_blend
from spacerobot.elements.element import Element
from spacerobot.elements.environment import Environment, EnvironmentContext
from spacerobot.elements.estimator import Estimator, EstimatorContext
from spacerobot.elements.event import Event, both, either, negated
from spacerobot.elements.flexible_link import FlexibleContext, FlexibleLink
from spacerobot.elements.goal import Goal, TipGoal
from spacerobot.elements.grasp import Grasp
from spacerobot.elements.plan_instant import BoundedRow, PlanInstant, within, zero
from spacerobot.elements.plan_limit import PlanLimit, PlannedJoint
from spacerobot.elements.reference import Reference
from spacerobot.elements.registry import FAMILIES, PLANS, Family, create, kinds, load_plugin, register
from spacerobot.elements.robot_element import RobotElement, RobotProperties
from spacerobot.elements.section_context import SectionContext, StartInstant
from spacerobot.elements.sensor import Sensor
from spacerobot.section import SIGNALS_UNIT, Vector, quantity
from spacerobot.shapes import CrownedTerm, SmoothTerm, Support

__all__ = [
    "FAMILIES",
    "PLANS",
    "SIGNALS_UNIT",
    "AccelerationConstraint",
    "Actuator",
    "ActuatorContext",
    "ActuatorDrive",
    "Affine",
    "BoundedRow",
    "CollisionShape",
    "CommandedTorque",
    "Contact",
    "ContactContext",
    "Contribution",
    "ControlChannel",
    "CrownedTerm",
    "DesiredMotion",
    "Element",
    "Environment",
    "EnvironmentContext",
    "Estimator",
    "EstimatorContext",
    "Event",
    "Family",
    "FlexibleContext",
    "FlexibleLink",
    "Goal",
    "Grasp",
    "GraspContext",
    "InitialMotion",
    "Output",
    "PlanInstant",
    "PlanLimit",
    "PlannedJoint",
    "PowerTerm",
    "Reference",
    "RobotContext",
    "RobotController",
    "RobotElement",
    "RobotProperties",
    "SectionContext",
    "Sensor",
    "SmoothTerm",
    "StartInstant",
    "State",
    "StoredMomentum",
    "Support",
    "TimeProfile",
    "TipContext",
    "TipController",
    "TipGoal",
    "Vector",
    "both",
    "create",
    "cubic_blend",
    "either",
    "kinds",
    "load_plugin",
    "memory",
    "negated",
    "quantity",
    "register",
    "within",
    "zero",
]
