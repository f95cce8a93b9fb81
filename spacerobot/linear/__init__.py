"""Linear analysis: linearised closed loops at instants of a simulation, and their stability margins."""

from spacerobot.linear.linearisation import LinearSystem, Mode, linearise
from spacerobot.linear.loop_margins import LoopMargins, MarginAnalysis, loop_response, margins

__all__ = ["LinearSystem", "LoopMargins", "MarginAnalysis", "Mode", "linearise", "loop_response", "margins"]
