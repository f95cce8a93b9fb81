"""Fixed-step rollouts of a closed loop: one, many at once, and their exact derivatives."""

from spacerobot.rollout.batch import Report
from spacerobot.rollout.grid import TimeGrid, time_grid
from spacerobot.rollout.measures import Measure, Measures, Signals, final, integral, peak
from spacerobot.rollout.protocol import ClosedLoopFunctions
from spacerobot.rollout.rollout import Rollout, build_rollout
from spacerobot.rollout.trajectory import Batch, Gradient, Jacobian, Trajectory

__all__ = [
    "Batch",
    "ClosedLoopFunctions",
    "Gradient",
    "Jacobian",
    "Measure",
    "Measures",
    "Report",
    "Rollout",
    "Signals",
    "TimeGrid",
    "Trajectory",
    "build_rollout",
    "final",
    "integral",
    "peak",
    "time_grid",
]
