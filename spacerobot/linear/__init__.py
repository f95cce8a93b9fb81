"""Linear analysis: linearised closed loops at instants of a simulation, and their stability margins."""

from spacerobot.linear.linearisation import LinearSystem, Mode, linearise
from spacerobot.linear.loop_margins import LoopMargins, MarginAnalysis, SavedMargins, margins
from spacerobot.linear.loop_response import loop_response
from spacerobot.linear.simultaneous import (
    SimultaneousMargins,
    simultaneous_disk_margin,
    simultaneous_margins,
)

__all__ = [
    "LinearSystem",
    "LoopMargins",
    "MarginAnalysis",
    "Mode",
    "SavedMargins",
    "SimultaneousMargins",
    "linearise",
    "loop_response",
    "margins",
    "simultaneous_disk_margin",
    "simultaneous_margins",
]
