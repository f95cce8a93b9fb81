"""Elements: references, grasps, actuators, environments, ...; a kind is one file, section and law."""

from spacerobot.elements.actuator import Actuator
from spacerobot.elements.contact import Contact
from spacerobot.elements.context import (
    ActuatorContext,
    ContactContext,
    GraspContext,
    RobotContext,
    TipContext,
)
from spacerobot.elements.contribution import (
    Channel,
    Constraint,
    Contribution,
    Drive,
    Output,
    Power,
    State,
    Stored,
    Torque,
    memory,
)
from spacerobot.elements.controller import RobotController, TipController
from spacerobot.elements.element import Element
from spacerobot.elements.environment import Environment, EnvironmentContext
from spacerobot.elements.event import Event, both, either, negated
from spacerobot.elements.goal import Goal, TipGoal
from spacerobot.elements.grasp import Grasp
from spacerobot.elements.instant import Instant, Row, within, zero
from spacerobot.elements.motion import Beginning, Motion, Profile, cubic_blend
from spacerobot.elements.numbers import Context, Since
from spacerobot.elements.plan_cost import AxesCost, JointCost, PlanCost
from spacerobot.elements.plan_limit import PlanLimit, PlannedJoint
from spacerobot.elements.reference import Reference
from spacerobot.elements.registry import FAMILIES, PLANS, Family, kinds, load_plugin, register
from spacerobot.elements.robot_element import RobotElement, RobotFacts
from spacerobot.elements.sensor import Sensor

__all__ = [
    "FAMILIES",
    "PLANS",
    "Actuator",
    "ActuatorContext",
    "AxesCost",
    "Beginning",
    "Channel",
    "Constraint",
    "Contact",
    "ContactContext",
    "Context",
    "Contribution",
    "Drive",
    "Element",
    "Environment",
    "EnvironmentContext",
    "Event",
    "Family",
    "Goal",
    "Grasp",
    "GraspContext",
    "Instant",
    "JointCost",
    "Motion",
    "Output",
    "PlanCost",
    "PlanLimit",
    "PlannedJoint",
    "Power",
    "Profile",
    "Reference",
    "RobotContext",
    "RobotController",
    "RobotElement",
    "RobotFacts",
    "Row",
    "Sensor",
    "Since",
    "State",
    "Stored",
    "TipContext",
    "TipController",
    "TipGoal",
    "Torque",
    "both",
    "cubic_blend",
    "either",
    "kinds",
    "load_plugin",
    "memory",
    "negated",
    "register",
    "within",
    "zero",
]
