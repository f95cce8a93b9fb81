"""The closed loop: references, sensors, controllers and grasps around the plant."""

from spacerobot.closedloop.build import build_closed_loop
from spacerobot.closedloop.closed_loop import ClosedLoop, OutputVariable
from spacerobot.closedloop.commanded import CommandInput, build_commanded_loop
from spacerobot.closedloop.environment_forces import environment_forces
from spacerobot.closedloop.stiffness import FastestRate, find_fastest_rate

__all__ = [
    "ClosedLoop",
    "CommandInput",
    "FastestRate",
    "OutputVariable",
    "build_closed_loop",
    "build_commanded_loop",
    "environment_forces",
    "find_fastest_rate",
]
