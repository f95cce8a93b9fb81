"""Scenarios: the validated description of what is simulated."""

from spacerobot.scenario.bodies import Base, Body, Joint, Link, Robot, Target, Tip
from spacerobot.scenario.campaign import Campaign, Limits, UncertainParameter
from spacerobot.scenario.scenario import Scenario, Simulation
from spacerobot.scenario.tuning import Constraints, DesignVariable, Objective, Robustness, Tuning

__all__ = [
    "Base",
    "Body",
    "Campaign",
    "Constraints",
    "DesignVariable",
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
    "UncertainParameter",
]
