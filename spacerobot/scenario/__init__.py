"""Scenarios: the validated description of what is simulated."""

from spacerobot.scenario.bodies import Base, Body, Joint, Link, Robot, Target, Tip
from spacerobot.scenario.campaign import Campaign, Limits, Uncertain
from spacerobot.scenario.control import Amnesia, Calibration, JointPd, Pid, Sensors
from spacerobot.scenario.grasp import Compliant, Grasp, Point, Weld
from spacerobot.scenario.reference import Circle, Hold, Line, Reference, Spline
from spacerobot.scenario.scenario import Scenario, Simulation
from spacerobot.scenario.tuning import Constraints, Objective, Robustness, Tuning, Variable

__all__ = [
    "Amnesia",
    "Base",
    "Body",
    "Calibration",
    "Campaign",
    "Circle",
    "Compliant",
    "Constraints",
    "Grasp",
    "Hold",
    "Joint",
    "JointPd",
    "Limits",
    "Line",
    "Link",
    "Objective",
    "Pid",
    "Point",
    "Reference",
    "Robot",
    "Robustness",
    "Scenario",
    "Sensors",
    "Simulation",
    "Spline",
    "Target",
    "Tip",
    "Tuning",
    "Uncertain",
    "Variable",
    "Weld",
]
