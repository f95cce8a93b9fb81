"""Elements: references, grasps, actuators, environments, ...; a kind is one file, section and law."""

from spacerobot.elements.actuators.actuator import Actuator
from spacerobot.elements.contacts.contact import Contact
from spacerobot.elements.controllers.controller import RobotController, TipController
from spacerobot.elements.controllers.python_controller import HeldForces, PythonController
from spacerobot.elements.core.context import (
    ActuatorContext,
    Affine,
    ContactContext,
    GraspContext,
    RobotContext,
    TipContext,
)
from spacerobot.elements.core.contribution import (
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
from spacerobot.elements.core.desired_motion import DesiredMotion, InitialMotion, TimeProfile, cubic_blend
from spacerobot.elements.core.element import Element
from spacerobot.elements.core.event import Event, both, either, negated
from spacerobot.elements.core.registry import FAMILIES, PLANS, Family, create, kinds, load_plugin, register
from spacerobot.elements.core.robot_element import RobotElement, RobotProperties
from spacerobot.elements.core.section_context import SectionContext, StartInstant
from spacerobot.elements.environments.environment import Environment, EnvironmentContext
from spacerobot.elements.estimators.estimator import Estimator, EstimatorContext
from spacerobot.elements.flexible.flexible_link import FlexibleContext, FlexibleLink
from spacerobot.elements.goals.goal import Goal, TipGoal
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, within, zero
from spacerobot.elements.grasps.grasp import Grasp
from spacerobot.elements.limits.plan_limit import PlanLimit, PlannedJoint
from spacerobot.elements.references.reference import Reference
from spacerobot.elements.sensors.sensor import Sensor
from spacerobot.elements.shapes.collision_shape import CollisionShape
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
    "HeldForces",
    "InitialMotion",
    "Output",
    "PlanInstant",
    "PlanLimit",
    "PlannedJoint",
    "PowerTerm",
    "PythonController",
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
