"""Result folders: written whole or not at all.

A folder holds ``scenario.yaml`` (resolved), ``summary.json`` and ``result.nc``. The files are written
beside it first and then moved into place, so that a full disk or an interruption leaves nothing half-done.
A lock on the folder keeps several processes from mixing their results, and a reader from seeing a mixture.
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
"""Version of the result's layout; a result of another one is refused."""
SCENARIO, SUMMARY, DATA = "scenario.yaml", "summary.json", "result.nc"
FILES = (SCENARIO, DATA, SUMMARY)
"""In the order they are moved into place: the summary last, so that a folder with one is complete."""
JOBS = {
    "campaign.json": "a campaign",
    "comparison.json": "a comparison",
    "sweep.json": "a sweep",
    "tuning.json": "a tuning",
    "robust.json": "a robust tuning",
    "plan.json": "a plan",
    "front.json": "a front of plans",
}
"""Files by which the folders of other jobs are known, which may hold results as well."""
WITH_RESULT = ("tuning.json", "robust.json")
"""Those of the jobs that write their best design as a result into the same folder."""
JOURNALS = "journals"
"""Folder in which jobs keep what a killed one goes on from."""


def check_folder(folder: StrPath, job: str | None = None) -> None:
    """Refuse, before any work is done, a folder that could not be written or that holds something else.

    Args:
        folder: Where files shall be written.
        job: One of :data:`JOBS` that writes there; a result alone if None.

    Raises:
        ResultError: With the reason.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise ResultError("is a file, not a folder", source=folder)
    names = [] if not folder.is_dir() else [p.name for p in folder.iterdir() if not p.name.startswith(STAGE)]
    files = set(names)
    # other jobs' folders have a summary or a scenario as well: only the data tell a result
    result = DATA in files or files <= {*FILES, DERIVED}
    other = next((name for name in JOBS if name in files and name != job), None)
    mine = result if job is None else not files or job in files
    if job is not None and other is None:  # perhaps killed before its own file was written
        mine = mine or JOURNALS in files or (result and job in WITH_RESULT)
    if not mine:
        expected = "no result" if job is None else f"not {JOBS[job]}"
        holds = "files" if other is None else JOBS[other]
        raise ResultError(f"holds {holds}, {expected}; name an empty or a new folder", source=folder)
    with _writing(folder), _stage(folder):
        pass


def write_result(folder: Path, scenario: Scenario, data: xr.Dataset, summary: Summary) -> None:
    """Write a result's files; those that are there already are replaced, and what was made of them goes.

    Args:
        folder: Where.
        scenario, data, summary: What a result consists of.

    Raises:
        ResultError: If the folder cannot be written; its earlier content is then still there.
        KeyboardInterrupt: If Ctrl-C came meanwhile; the result is then written all the same.
    """
    from spacerobot.scenario.load import to_yaml

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
    """Refuse a folder that does not have the files of a result; none of them is read.

    Raises:
        ResultError: With the names of those that are missing.
    """
    if not folder.is_dir():
        raise ResultError("no such folder", source=folder)
    with locked(folder, shared=True):
        missing = [name for name in FILES if not (folder / name).is_file()]
    if missing:
        raise ResultError(f"not a complete result: no {', '.join(missing)}", source=folder)


def read_result(folder: Path) -> tuple[Scenario, xr.Dataset, Summary]:
    """Scenario, data and summary of a result's folder.

    Raises:
        ResultError: If it is not a complete result, or one of another version's layout.
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
    """Tell any fault of the file system in one line."""
    try:
        yield
    except OSError as fault:
        raise ResultError(f"cannot be written: {fault.strerror or fault}", source=folder) from None
    except RuntimeError as fault:  # the netCDF library's own, which does not say why
        raise ResultError(
            f"cannot be written, perhaps for want of space on the disk: {fault}", source=folder
        ) from None


@contextlib.contextmanager
def _stage(folder: Path) -> Any:
    """Temporary folder on the same file system, gone afterwards."""
    home = folder if folder.is_dir() else folder.parent
    new_folders = [path for path in (home, *home.parents) if not path.exists()]
    home.mkdir(parents=True, exist_ok=True)
    try:
        with staged(home) as stage:
            yield stage
    finally:
        for path in new_folders:
            with contextlib.suppress(OSError):
                path.rmdir()  # only where nothing was put into it
