"""Scene as CasADi expressions: parameters, constants, initial state, rigid-body quantities."""

from spacerobot.symbolic.initial_state import InitialState
from spacerobot.symbolic.noise import NoiseTable
from spacerobot.symbolic.parameters import Constants, Parameters
from spacerobot.symbolic.plant import Plant
from spacerobot.symbolic.tables import WindowTable

__all__ = ["Constants", "InitialState", "NoiseTable", "Parameters", "Plant", "WindowTable"]
