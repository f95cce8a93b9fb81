"""Sensitivities of the objective to the variables: exact gradients at a point, in readable terms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from optim.problem.tuning_problem import TuningProblem
from spacerobot.common.arrays import Array


@dataclass(frozen=True)
class Sensitivity:
    """Sensitivities of the objective at some points.

    Attributes:
        names: Variables (k).
        relative: (p / J) dJ/dp by point, each (k,): relative change of the objective per relative change of
            p.
        over_range: (upper - lower) / J dJ/dp by point, each (k,), on a log scale ln(upper / lower) p / J
            dJ/dp: first-order relative change of the objective over the range of p.
    """

    names: tuple[str, ...]
    relative: Mapping[str, Array]
    over_range: Mapping[str, Array]


def sensitivity(problem: TuningProblem, points: Mapping[str, Array]) -> Sensitivity:
    """Sensitivities of the objective at given points; NaN where the rollout diverges.

    Args:
        problem: The tuning problem, of k variables.
        points: Points of the unit cube (k,), by name.
    """
    relative, over_range = {}, {}
    for name, u in points.items():
        at = problem.linearise(u)
        across = at.gradient / at.objective
        values, slope = problem.variables.values(u), problem.variables.slope(u)
        relative[name] = np.asarray(across * values / slope)
        over_range[name] = across
    return Sensitivity(problem.names, relative, over_range)
