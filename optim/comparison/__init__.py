"""Tuning methods compared: contests, their currency, expected running times and data profiles."""

from optim.comparison.compare import Comparison, compare
from optim.comparison.contest import Contest
from optim.search.session import Session

__all__ = ["Comparison", "Contest", "Session", "compare"]
