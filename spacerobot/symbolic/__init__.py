"""Scene as CasADi expressions: parameters, constants, initial state, rigid-body quantities."""

from spacerobot.symbolic.noise import NoiseTable
from spacerobot.symbolic.parameters import Constants, Parameters, WindowTable
from spacerobot.symbolic.plant import InitialState, Plant

__all__ = ["Constants", "InitialState", "NoiseTable", "Parameters", "Plant", "WindowTable"]
