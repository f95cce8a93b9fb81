"""Fixed-step rollouts of a closed loop: one, many at once, and their exact derivatives."""

from spacerobot.rollout.batch import BatchProgress
from spacerobot.rollout.build import Backend, build_rollout, choose_step
from spacerobot.rollout.closed_loop_protocol import ClosedLoopFunctions, EventRule
from spacerobot.rollout.initial_gaps import unclosed
from spacerobot.rollout.measures import Measure, Measures, Signals, final, integral, peak
from spacerobot.rollout.rollout import Rollout
from spacerobot.rollout.step_choice import StepChoice
from spacerobot.rollout.time_grid import TimeGrid, time_grid
from spacerobot.rollout.trajectory import (
    Batch,
    BatchEvents,
    FiredEvent,
    Gradient,
    Jacobian,
    Slopes,
    Trajectory,
)

__all__ = [
    "Backend",
    "Batch",
    "BatchEvents",
    "BatchProgress",
    "ClosedLoopFunctions",
    "EventRule",
    "FiredEvent",
    "Gradient",
    "Jacobian",
    "Measure",
    "Measures",
    "Rollout",
    "Signals",
    "Slopes",
    "StepChoice",
    "TimeGrid",
    "Trajectory",
    "build_rollout",
    "choose_step",
    "final",
    "integral",
    "peak",
    "time_grid",
    "unclosed",
]
