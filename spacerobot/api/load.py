"""Reader of all results of the public namespace."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from spacerobot.api.plan_studies import DesignStudyResult, ParetoFrontResult
from spacerobot.api.results import CampaignResult, ComparisonResult, PlanResult
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
"""Results in folders, except those of simulations."""


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
"""Kinds of studies in the order of the search for their files; that of a design study has a plan too."""

FOLDERS: dict[str, Callable[[Path], FolderResult]] = {
    **{kind.file: kind.load for kind in STUDIES},
    "tuning.json": _tuning,
    "robust.json": _robust_tuning,
    "sweep.json": _sweep,
    "margins.nc": _margins,
}
"""Reader of a folder by the file that it contains, in the order of the search; other folders are results."""


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
