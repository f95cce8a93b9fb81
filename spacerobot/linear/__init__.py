"""Linear analysis: linearised closed loops at instants of a simulation, and their stability margins."""

from spacerobot.linear.linearisation import LinearSystem, Mode, linearise
from spacerobot.linear.loop_margins import LoopMargins, MarginAnalysis, SavedMargins, margins
from spacerobot.linear.loop_response import loop_response

__all__ = [
    "LinearSystem",
    "LoopMargins",
    "MarginAnalysis",
    "Mode",
    "SavedMargins",
    "linearise",
    "loop_response",
    "margins",
]
