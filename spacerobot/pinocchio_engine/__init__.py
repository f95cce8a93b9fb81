"""The second engine: the elements' laws over Pinocchio's own algorithms, in numbers."""

from spacerobot.pinocchio_engine.engine import Engine
from spacerobot.pinocchio_engine.simulate import Checked, simulate

__all__ = ["Checked", "Engine", "simulate"]
