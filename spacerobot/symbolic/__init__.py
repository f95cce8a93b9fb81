"""A scene as CasADi expressions: its numbers, where it begins, its mechanics."""

from spacerobot.symbolic.parameters import Constants, Parameters
from spacerobot.symbolic.plant import Plant
from spacerobot.symbolic.start import Start
from spacerobot.symbolic.tables import Table

__all__ = ["Constants", "Parameters", "Plant", "Start", "Table"]
