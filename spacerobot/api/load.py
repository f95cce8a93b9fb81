"""Reader of all results of the public namespace."""

from __future__ import annotations

import pkgutil
from typing import TYPE_CHECKING, TypeAlias

from spacerobot.api.plan_studies import DesignStudyResult, ParetoFrontResult
from spacerobot.api.results import CampaignResult, ComparisonResult, PlanResult
from spacerobot.api.saved_kinds import EVALUATION, saved_kind
from spacerobot.api.study import Study
from spacerobot.common.files import StrPath
from spacerobot.result import Result

if TYPE_CHECKING:
    from optim.comparison.sweep import SweepResult
    from optim.evaluation import BatchResult, GradientResult
    from optim.identification import IdentificationResult
    from optim.reliability.falsification import Falsification
    from optim.reliability.probability import FailureProbability
    from optim.robust.problem import RobustTuningResult
    from optim.tuning import TuningResult
    from spacerobot.linear import SavedMargins


Loaded: TypeAlias = (
    "Result | Study | TuningResult | RobustTuningResult | SweepResult | SavedMargins | GradientResult "
    "| BatchResult | IdentificationResult | FailureProbability | Falsification"
)
"""Results that are saved."""

STUDIES: tuple[type[Study], ...] = (
    CampaignResult,
    ComparisonResult,
    ParetoFrontResult,
    DesignStudyResult,
    PlanResult,
)
"""Kinds of studies in the order of the search for their files; that of a design study has a plan too."""


def load(path: StrPath) -> Loaded:
    """Read a result that was written by its ``save`` or by a command with ``--out``.

    Args:
        path: Folder of a result, campaign, plan, Pareto front, design study, comparison, tuning, robust
            tuning, sweep or margins; or file of a gradient, batch, identification, failure probability or
            falsification.

    Returns:
        object: Result of the class that was saved. The folder of a tuning also contains the simulation of the
            best design, which :meth:`spacerobot.Result.load` reads.

    Raises:
        ResultError: If the path is not a result or cannot be read.
    """
    kind = saved_kind(path)
    reader = pkgutil.resolve_name(kind)
    result: Loaded = reader(path) if kind == EVALUATION else reader.load(path)
    return result
