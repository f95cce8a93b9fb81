"""Numerical methods, each a table of coefficients in its own file."""

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
"""Default method: fast at equal error, and stable at long steps."""

__all__ = ["DEFAULT", "METHODS", "Tableau"]
