"""Scenarios: the validated description of what is simulated."""

from spacerobot.scenario.bodies import Base, Body, Joint, Link, Robot, Target, Tip
from spacerobot.scenario.control import Amnesia, Calibration, JointPd, Pid, Sensors
from spacerobot.scenario.grasp import Compliant, Grasp, Point, Weld
from spacerobot.scenario.reference import Circle, Hold, Line, Reference, Spline
from spacerobot.scenario.scenario import Scenario, Simulation

__all__ = [
    "Amnesia",
    "Base",
    "Body",
    "Calibration",
    "Circle",
    "Compliant",
    "Grasp",
    "Hold",
    "Joint",
    "JointPd",
    "Line",
    "Link",
    "Pid",
    "Point",
    "Reference",
    "Robot",
    "Scenario",
    "Sensors",
    "Simulation",
    "Spline",
    "Target",
    "Tip",
    "Weld",
]
