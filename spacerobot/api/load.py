"""Read any result of the public namespace."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from spacerobot.api.results import CampaignResult, ComparisonResult, PlanResult
from spacerobot.api.studies import DesignStudyResult, ParetoFrontResult
from spacerobot.api.study import Study
from spacerobot.common.errors import ResultError
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


FolderResult: TypeAlias = "Study | TuningResult | RobustTuningResult | SweepResult | SavedMargins"
"""Results that are folders, those of simulations aside."""


def _tuning(path: Path) -> TuningResult:
    from optim.tuning import TuningResult

    return TuningResult.load(path)


def _robust_tuning(path: Path) -> RobustTuningResult:
    from optim.robust.problem import RobustTuningResult

    return RobustTuningResult.load(path)


def _sweep(path: Path) -> SweepResult:
    from optim.comparison.sweep import SweepResult

    return SweepResult.load(path)


def _margins(path: Path) -> SavedMargins:
    from spacerobot.linear import SavedMargins

    return SavedMargins.load(path)


STUDIES: tuple[type[Study], ...] = (
    CampaignResult,
    ComparisonResult,
    ParetoFrontResult,
    DesignStudyResult,
    PlanResult,
)
"""Kinds of studies, in the order in which their files are looked for: a design study holds a plan too."""

FOLDERS: dict[str, Callable[[Path], FolderResult]] = {
    **{kind.file: kind.load for kind in STUDIES},
    "tuning.json": _tuning,
    "robust.json": _robust_tuning,
    "sweep.json": _sweep,
    "margins.nc": _margins,
}
"""Files by which folders are known, in this order, and what reads each; other folders hold a result."""


def load(
    path: StrPath,
) -> (
    Result
    | FolderResult
    | GradientResult
    | BatchResult
    | IdentificationResult
    | FailureProbability
    | Falsification
):
    """Read what a result's ``save`` wrote, or a command with ``--out``.

    Args:
        path: Folder of a result, campaign, plan, Pareto front, design study, comparison, tuning, robust
            tuning, sweep or margins; or file of a gradient, batch, identification, failure probability or
            falsification.

    Returns:
        object: Of the class that was saved. A folder with a tuning's best design as a result gives the
            tuning, whose result is read by :meth:`spacerobot.Result.load`.

    Raises:
        ResultError: If it is none of these or cannot be read.
    """
    path = Path(path)
    if path.is_file() and path.suffix == ".json":
        from optim.identification import IdentificationResult
        from optim.reliability.falsification import Falsification
        from optim.reliability.probability import FailureProbability

        try:
            key = next(iter(json.loads(path.read_text(encoding="utf-8"))))
        except (OSError, ValueError, TypeError, StopIteration) as fault:
            raise ResultError(f"cannot be read: {fault}", source=path) from None
        kinds = {kind.key: kind for kind in (IdentificationResult, FailureProbability, Falsification)}
        if key not in kinds:
            raise ResultError(f"holds {key!r}, allowed: {', '.join(kinds)}", source=path)
        return kinds[key].load(path)
    if path.is_file():
        from optim.evaluation import load_evaluation

        return load_evaluation(path)
    if not path.is_dir():
        raise ResultError("no such file or folder", source=path)
    files = {entry.name for entry in path.iterdir()}
    for file, read in FOLDERS.items():
        if file in files:
            return read(path)
    return Result.load(path)
