"""The second engine: the elements' laws over Pinocchio's own algorithms, in numbers."""

from spacerobot.pinocchio_engine.closed_loop import PinocchioLoop
from spacerobot.pinocchio_engine.simulate import PinocchioRun, PinocchioTrajectory, simulate

__all__ = ["PinocchioLoop", "PinocchioRun", "PinocchioTrajectory", "simulate"]
