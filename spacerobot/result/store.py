"""Atomic writing and checked reading of result folders.

A folder contains ``scenario.yaml`` (resolved), ``summary.json`` and ``result.nc``. The files are first
written to a temporary folder and then moved, so that a full disk or an interruption leaves no incomplete
result. A lock on the folder prevents processes from mixing their results, and readers from reading a mixture.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spacerobot.common.errors import ResultError, ScenarioError
from spacerobot.common.files import STAGE, StrPath, locked, staged
from spacerobot.common.interrupts import uninterrupted
from spacerobot.result.derived_files import DERIVED, remove_derived

if TYPE_CHECKING:
    import xarray as xr

    from spacerobot.result.summary_types import Summary
    from spacerobot.scenario import Scenario

FORMAT = 2
"""Version of the result's layout; results of other versions cannot be read."""
SCENARIO, SUMMARY, DATA = "scenario.yaml", "summary.json", "result.nc"
FILES = (SCENARIO, DATA, SUMMARY)
"""Files in the order in which they are moved, the summary last: a folder with a summary is complete."""
JOBS = {
    "campaign.json": "a campaign",
    "comparison.json": "a comparison",
    "sweep.json": "a sweep",
    "tuning.json": "a tuning",
    "robust.json": "a robust tuning",
    "plan.json": "a plan",
    "front.json": "a front of plans",
}
"""Files that identify the folders of other jobs, with the jobs' names; these folders may contain results."""
WITH_RESULT = ("tuning.json", "robust.json")
"""Files of the jobs that write the result of their best design to the same folder."""
JOURNALS = "journals"
"""Subfolder of the journals from which an interrupted job continues."""


def check_folder(folder: StrPath, job: str | None = None) -> None:
    """Check, before a job begins, that its output folder can be written and has no other content.

    Args:
        folder: Output folder.
        job: File of the job, a key of :data:`JOBS`; None for a result.

    Raises:
        ResultError: If the folder cannot be written, or has other content.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise ResultError("is a file, not a folder", source=folder)
    names = [] if not folder.is_dir() else [p.name for p in folder.iterdir() if not p.name.startswith(STAGE)]
    files = set(names)
    # folders of other jobs may have a summary or a scenario too: only the data identify a result
    result = DATA in files or files <= {*FILES, DERIVED}
    other = next((name for name in JOBS if name in files and name != job), None)
    is_free = result if job is None else not files or job in files
    if job is not None and other is None:  # the job may have been killed before its file was written
        is_free = is_free or JOURNALS in files or (result and job in WITH_RESULT)
    if not is_free:
        expected = "no result" if job is None else f"not {JOBS[job]}"
        holds = "files" if other is None else JOBS[other]
        raise ResultError(f"holds {holds}, {expected}; name an empty or a new folder", source=folder)
    with _writing(folder), _stage(folder):
        pass


def check_same_scenario(folder: StrPath, scenario: str) -> None:
    """Check that a folder has no result of another scenario, which would be replaced.

    Args:
        folder: Output folder.
        scenario: Name of the scenario that will be simulated.

    Raises:
        ResultError: If the folder has a result of a scenario with another name.
    """
    try:
        summary = json.loads((Path(folder) / SUMMARY).read_text(encoding="utf-8"))
        name = summary["name"]
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return
    if name != scenario:
        raise ResultError(
            f"holds a result of the scenario {name!r}, which that of {scenario!r} would replace; name "
            "another folder, or remove this one",
            source=Path(folder),
        )


def write_result(folder: Path, scenario: Scenario, data: xr.Dataset, summary: Summary) -> None:
    """Write the files of a result; earlier files, and the files made from them, are replaced.

    Args:
        folder: Folder of the result.
        scenario, data, summary: Parts of the result.

    Raises:
        ResultError: If the folder cannot be written; its earlier content is then unchanged.
        KeyboardInterrupt: After Ctrl-C during the write; the result is written nevertheless.
    """
    from spacerobot.scenario.load import to_yaml

    if folder.exists() and not folder.is_dir():
        raise ResultError("is a file, not a folder", source=folder)
    with uninterrupted(), _writing(folder), _stage(folder) as stage:
        (stage / SCENARIO).write_text(to_yaml(scenario), encoding="utf-8")
        encoding = {str(name): {"zlib": True, "complevel": 1} for name in data.data_vars}
        data.to_netcdf(stage / DATA, engine="netcdf4", encoding=encoding)
        text = json.dumps(summary, indent=2, allow_nan=False)
        (stage / SUMMARY).write_text(text + "\n", encoding="utf-8")
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder):
            (folder / SUMMARY).unlink(missing_ok=True)
            remove_derived(folder)
            for name in FILES:
                (stage / name).replace(folder / name)


def check_files(folder: Path) -> None:
    """Check that a folder has the files of a result, without reading them.

    Raises:
        ResultError: If files are missing; the message has their names.
    """
    if not folder.is_dir():
        raise ResultError("no such folder", source=folder)
    with locked(folder, shared=True):
        missing = [name for name in FILES if not (folder / name).is_file()]
    if missing:
        raise ResultError(f"not a complete result: no {', '.join(missing)}", source=folder)


def read_result(folder: Path) -> tuple[Scenario, xr.Dataset, Summary]:
    """Read scenario, data and summary from a result's folder.

    Raises:
        ResultError: If the folder has no complete result, or one with another version's layout.
    """
    check_files(folder)
    import xarray as xr

    from spacerobot.result.completeness import missing_data, missing_summary
    from spacerobot.scenario.document import read_document
    from spacerobot.scenario.load import validate

    with locked(folder, shared=True):
        summary = _parse(folder / SUMMARY, lambda path: json.loads(path.read_text(encoding="utf-8")))
        layout = summary.get("format") if isinstance(summary, dict) else None
        if layout != FORMAT:
            raise ResultError(
                f"written by another version: layout {layout!r}, this one reads {FORMAT}; run its scenario "
                "again",
                source=folder / SUMMARY,
            )
        data = _parse(folder / DATA, lambda path: xr.load_dataset(path, engine="netcdf4"))
        try:
            scenario = validate(read_document(folder / SCENARIO), source=folder / SCENARIO)
        except ScenarioError as fault:
            raise ResultError(str(fault)) from None
        name, lacking = DATA, missing_data(data, scenario)
        if lacking is None:
            name, lacking = SUMMARY, missing_summary(summary, data)
        if lacking is not None:
            raise ResultError(f"damaged: {lacking}; run its scenario again", source=folder / name)
        return scenario, data, summary


def _parse(path: Path, reader: Callable[[Path], Any]) -> Any:
    try:
        return reader(path)
    except (OSError, ValueError, RuntimeError, KeyError, AttributeError, TypeError, IndexError) as fault:
        raise ResultError(f"cannot be read: {fault}", source=path) from None


@contextlib.contextmanager
def _writing(folder: Path) -> Any:
    """Convert errors of the file system in the block to a ``ResultError``."""
    try:
        yield
    except OSError as fault:
        raise ResultError(f"cannot be written: {fault.strerror or fault}", source=folder) from None
    except RuntimeError as fault:  # error of the netCDF library, without a reason
        raise ResultError(
            f"cannot be written, perhaps for want of space on the disk: {fault}", source=folder
        ) from None


@contextlib.contextmanager
def _stage(folder: Path) -> Any:
    """Temporary folder on the same file system, removed after the block."""
    home = folder if folder.is_dir() else folder.parent
    new_folders = [path for path in (home, *home.parents) if not path.exists()]
    home.mkdir(parents=True, exist_ok=True)
    try:
        with staged(home) as stage:
            yield stage
    finally:
        for path in new_folders:
            with contextlib.suppress(OSError):
                path.rmdir()  # fails unless the folder is empty
