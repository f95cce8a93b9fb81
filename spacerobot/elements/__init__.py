"""Elements: references, grasps, controllers and sensors, each kind one file with its section and its law."""

from spacerobot.elements.context import GraspContext, RobotContext, TipContext
from spacerobot.elements.contribution import (
    Channel,
    Constraint,
    Contribution,
    Output,
    Power,
    State,
    Torque,
    memory,
)
from spacerobot.elements.controller import RobotController, TipController
from spacerobot.elements.element import Element
from spacerobot.elements.event import Event, both, either, negated
from spacerobot.elements.grasp import Grasp
from spacerobot.elements.motion import Motion, Profile, cubic_blend
from spacerobot.elements.numbers import Context
from spacerobot.elements.reference import Reference
from spacerobot.elements.registry import FAMILIES, Family, kinds, load_plugin, register
from spacerobot.elements.sensor import Sensor

__all__ = [
    "FAMILIES",
    "Channel",
    "Constraint",
    "Context",
    "Contribution",
    "Element",
    "Event",
    "Family",
    "Grasp",
    "GraspContext",
    "Motion",
    "Output",
    "Power",
    "Profile",
    "Reference",
    "RobotContext",
    "RobotController",
    "Sensor",
    "State",
    "TipContext",
    "TipController",
    "Torque",
    "both",
    "cubic_blend",
    "either",
    "kinds",
    "load_plugin",
    "memory",
    "negated",
    "register",
]
