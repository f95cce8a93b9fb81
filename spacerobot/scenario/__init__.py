"""Scenarios: the validated description of what is simulated."""

from spacerobot.scenario.bodies import Base, Body, Joint, Link, Robot, Target, Tip
from spacerobot.scenario.campaign import Campaign, Limits, Uncertain
from spacerobot.scenario.scenario import Scenario, Simulation
from spacerobot.scenario.tuning import Constraints, Objective, Robustness, Tuning, Variable

__all__ = [
    "Base",
    "Body",
    "Campaign",
    "Constraints",
    "Joint",
    "Limits",
    "Link",
    "Objective",
    "Robot",
    "Robustness",
    "Scenario",
    "Simulation",
    "Target",
    "Tip",
    "Tuning",
    "Uncertain",
    "Variable",
]
