"""Kinds of saved results, recognised by their files; no library that reads data is imported."""

from __future__ import annotations

import json
from pathlib import Path

from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath
from spacerobot.result.store import FILES

SIMULATION, EVALUATION = "spacerobot.result:Result", "optim.evaluation:load_evaluation"

FOLDERS = {
    "campaign.json": "spacerobot.api.results:CampaignResult",
    "comparison.json": "spacerobot.api.results:ComparisonResult",
    "front.json": "spacerobot.api.plan_studies:ParetoFrontResult",
    "design.json": "spacerobot.api.plan_studies:DesignStudyResult",
    "plan.json": "spacerobot.api.results:PlanResult",
    "tuning.json": "optim.tuning:TuningResult",
    "robust.json": "optim.robust.problem:RobustTuningResult",
    "sweep.json": "optim.comparison.sweep:SweepResult",
    "margins.nc": "spacerobot.linear:SavedMargins",
    **dict.fromkeys(FILES, SIMULATION),
}
"""Class of the result in a folder by a file that it contains, in the order of the search.

A design study has a plan too, and a tuning the simulation of its best design.
"""

JSON_FILES = {
    "identification": "optim.identification:IdentificationResult",
    "failure_probability": "optim.reliability.probability:FailureProbability",
    "falsification": "optim.reliability.falsification:Falsification",
}
"""Class of a JSON file's result by the key that it contains."""

NETCDF = (b"\x89HDF\r\n\x1a\n", b"CDF")
"""First bytes of netCDF files."""

ALLOWED = (
    "a folder that a command has written with --out (run, plan, tune, campaign, compare, margins, ...), or "
    "the file of a gradient, batch, failure probability, falsification or identification"
)


def saved_kind(path: StrPath) -> str:
    """Class of a saved result, as ``module:Class``.

    Args:
        path: Folder or file.

    Raises:
        ResultError: If the path is no result.
    """
    path = Path(path)
    if path.is_dir():
        files = {entry.name for entry in path.iterdir()}
        kind = next((kind for file, kind in FOLDERS.items() if file in files), None)
        if kind is None:
            inside = sorted({str(file.parent) for file in path.glob("*/*") if file.name in FOLDERS})
            hint = f"its subfolders hold some: {', '.join(inside[:3])}" if inside else f"allowed: {ALLOWED}"
            raise ResultError(f"no result in this folder; {hint}", source=path)
        return kind
    if not path.is_file():
        raise ResultError("no such file or folder", source=path)
    try:
        with path.open("rb") as stream:
            if stream.read(8).startswith(NETCDF):
                return EVALUATION
        key = next(iter(json.loads(path.read_text(encoding="utf-8"))))
    except OSError as fault:
        raise ResultError(f"cannot be read: {fault.strerror}", source=path) from None
    except (ValueError, TypeError, StopIteration, RecursionError):
        key = None
    if key not in JSON_FILES:
        raise ResultError(f"no result in this file; allowed: {ALLOWED}", source=path)
    return JSON_FILES[key]
