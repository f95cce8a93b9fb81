"""Reader of all results of the public namespace."""

from __future__ import annotations

import json
import pkgutil
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

FOLDERS = {
    **{kind.file: f"{kind.__module__}:{kind.__name__}" for kind in STUDIES},
    "tuning.json": "optim.tuning:TuningResult",
    "robust.json": "optim.robust.problem:RobustTuningResult",
    "sweep.json": "optim.comparison.sweep:SweepResult",
    "margins.nc": "spacerobot.linear:SavedMargins",
}
"""Class of the result in a folder by the file that it contains, in the order of the search."""

JSON_FILES = {
    "identification": "optim.identification:IdentificationResult",
    "failure_probability": "optim.reliability.probability:FailureProbability",
    "falsification": "optim.reliability.falsification:Falsification",
}
"""Class of a JSON file's result by the key that it contains."""


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
    path = Path(path)
    if path.is_file() and path.suffix == ".json":
        try:
            key = next(iter(json.loads(path.read_text(encoding="utf-8"))))
        except (OSError, ValueError, TypeError, StopIteration) as fault:
            raise ResultError(f"cannot be read: {fault}", source=path) from None
        if key not in JSON_FILES:
            raise ResultError(f"holds {key!r}, allowed: {', '.join(JSON_FILES)}", source=path)
        return _load(JSON_FILES[key], path)
    if path.is_file():
        from optim.evaluation import load_evaluation

        return load_evaluation(path)
    if not path.is_dir():
        raise ResultError("no such file or folder", source=path)
    files = {entry.name for entry in path.iterdir()}
    for file, kind in FOLDERS.items():
        if file in files:
            return _load(kind, path)
    return Result.load(path)


def _load(kind: str, path: Path) -> Loaded:
    """Result of a class, ``module:Class``, which is imported now."""
    result: Loaded = pkgutil.resolve_name(kind).load(path)
    return result
