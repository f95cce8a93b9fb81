"""Numerical methods, each a table of numbers in a file of its own."""

from collections.abc import Mapping
from types import MappingProxyType

from spacerobot.rollout.methods.dop853 import DOP853
from spacerobot.rollout.methods.rk4 import RK4
from spacerobot.rollout.methods.tableau import Tableau
from spacerobot.rollout.methods.tanaka6 import TANAKA6
from spacerobot.rollout.methods.verner7 import VERNER7

METHODS: Mapping[str, Tableau] = MappingProxyType({m.name: m for m in (TANAKA6, VERNER7, DOP853, RK4)})
"""Every method by its name."""

DEFAULT = "tanaka6"
"""What is taken where none is named: quick at equal error, stable at long steps."""

__all__ = ["DEFAULT", "METHODS", "Tableau"]
