"""Tuning methods compared: problems, their cost unit, expected running times and data profiles."""

from optim.comparison.benchmark_problem import ProblemComparison
from optim.comparison.compare import Comparison, compare
from optim.search.session import SearchSession

__all__ = ["Comparison", "ProblemComparison", "SearchSession", "compare"]
