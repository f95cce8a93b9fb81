"""Linear analysis: linearised closed loops at instants of a simulation, and their stability margins."""

from spacerobot.linear.linearisation import Linearisation, Mode, linearise
from spacerobot.linear.loop_margins import LoopMargins, MarginAnalysis, loop_response, margins

__all__ = ["Linearisation", "LoopMargins", "MarginAnalysis", "Mode", "linearise", "loop_response", "margins"]
