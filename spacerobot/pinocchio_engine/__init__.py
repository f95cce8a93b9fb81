"""The second engine: slow and independent, over Pinocchio's own algorithms, to check the first one by."""

from spacerobot.pinocchio_engine.engine import Engine
from spacerobot.pinocchio_engine.simulate import simulate

__all__ = ["Engine", "simulate"]
