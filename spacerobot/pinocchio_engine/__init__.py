"""Independent engine: the elements' laws evaluated numerically with Pinocchio's own algorithms."""

from spacerobot.pinocchio_engine.closed_loop import PinocchioLoop
from spacerobot.pinocchio_engine.simulate import PinocchioRun, PinocchioTrajectory, simulate

__all__ = ["PinocchioLoop", "PinocchioRun", "PinocchioTrajectory", "simulate"]
