"""The closed loop: references, sensors, controllers and grasps around the plant."""

from spacerobot.closedloop.build import build_closed_loop
from spacerobot.closedloop.closed_loop import ClosedLoop, OutputVariable
from spacerobot.closedloop.stiffness import FastestRate, find_fastest_rate

__all__ = ["ClosedLoop", "FastestRate", "OutputVariable", "build_closed_loop", "find_fastest_rate"]
