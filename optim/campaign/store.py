"""A campaign's folder: chunks as they come, each written whole or not at all; one netCDF of them.

``campaign.json`` says what the numbers belong to. ``chunks/BEGIN-END.npz`` holds samples BEGIN to END - 1: so
which samples are there can be read off the names, and each is there once. ``campaign.nc`` is made of the
chunks, at the end and after an interruption; once it is complete, the chunks are gone.
"""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from optim.campaign.evaluator import Table
from optim.campaign.metrics import Column
from spacerobot.errors import ResultError
from spacerobot.files import write_bytes, write_text
from spacerobot.scenario.paths import leaves

FORMAT = 1
HEAD, DATA, CHUNKS, LOCK = "campaign.json", "campaign.nc", "chunks", ".lock"
ROWS = 1024  # samples that the file keeps, and packs, together
Interval = tuple[int, int]


class Store:
    """Folder of one campaign, held by one process at a time; see :func:`open_store`."""

    def __init__(self, folder: Path, count: int) -> None:
        self.folder, self.count = folder, count
        self._present: list[Interval] = self._found()

    @property
    def done(self) -> int:
        """Samples that are there."""
        return sum(end - begin for begin, end in self._present)

    @property
    def missing(self) -> list[Interval]:
        """Samples that are not, as intervals in order."""
        found, at = [], 0
        for begin, end in [*sorted(self._present), (self.count, self.count)]:
            if begin > at:
                found.append((at, begin))
            at = max(at, end)
        return found

    def add(self, begin: int, table: Table) -> None:
        """Write a chunk.

        Raises
        ------
        ResultError
            If it cannot be written, or holds a sample that is there already.
        """
        end = begin + len(table)
        if any(a < end and begin < b for a, b in self._present):
            raise ResultError(f"samples {begin} to {end - 1} are there already", source=self.folder)
        buffer = io.BytesIO()
        np.savez(
            buffer,
            allow_pickle=False,
            draws=table.draws,
            metrics=table.metrics,
            diverged_at_s=table.diverged_at_s,
        )
        write_bytes(self._chunk((begin, end)), buffer.getvalue())
        self._present.append((begin, end))

    def merge(
        self, parameters: Sequence[str], gains: Sequence[str], columns: Sequence[Column], about: str
    ) -> Path:
        """Make ``campaign.nc`` of what is there, chunk by chunk, and drop the chunks if nothing is missing.

        Parameters
        ----------
        parameters, gains, columns
            Names along the axes.
        about
            What ran, for people.
        """
        path, complete = self.folder / DATA, not self.missing
        if complete and not any(self._chunk(interval).exists() for interval in self._present):
            return path
        stage = Path(tempfile.mkdtemp(prefix=".merge-", dir=self.folder))
        try:
            with netCDF4.Dataset(stage / DATA, "w") as file:
                _define(file, parameters, gains, columns)
                file.setncatts({"format": FORMAT, "complete": int(complete), "about": about})
                for interval in sorted(self._present):
                    _append(file, interval[0], _read(self._chunk(interval)), columns)
            (stage / DATA).replace(path)
        except (OSError, RuntimeError) as fault:
            raise ResultError(f"cannot be written: {fault}", source=path) from None
        finally:
            shutil.rmtree(stage, ignore_errors=True)
        if complete:
            shutil.rmtree(self.folder / CHUNKS, ignore_errors=True)
        return path

    def _chunk(self, interval: Interval) -> Path:
        return self.folder / CHUNKS / f"{interval[0]:09d}-{interval[1]:09d}.npz"

    def _found(self) -> list[Interval]:
        """What is there; a chunk that a full disk or a power cut has spoilt is dropped."""
        if _is_complete(self.folder / DATA, self.count):
            return [(0, self.count)]
        found: list[Interval] = []
        for path in sorted((self.folder / CHUNKS).glob("?????????-?????????.npz")):
            begin, end = (int(part) for part in path.stem.split("-"))
            try:
                whole = len(_read(path)) == end - begin
            except ResultError:
                whole = False
            if whole:
                found.append((begin, end))
            else:
                path.unlink()
        return found


@contextlib.contextmanager
def open_store(folder: Path, identity: Mapping[str, Any], count: int) -> Iterator[Store]:
    """The store of a campaign, made if it is not there, held until left.

    Parameters
    ----------
    folder
        Where it lies.
    identity
        What decides the numbers; see ``Evaluator.identity``.
    count
        Samples in all.

    Raises
    ------
    ResultError
        If the folder holds something else or another campaign, is in use, or cannot be written.
    """
    with _held(folder):
        head = folder / HEAD
        if head.exists():
            _check_same(head, identity)
        else:
            write_text(head, json.dumps({"format": FORMAT, **identity}, indent=1) + "\n")
        yield Store(folder, count)


def load_campaign(folder: Path) -> xr.Dataset:
    """Numbers of a campaign: its parameters and metrics by sample and set of gains.

    Raises
    ------
    ResultError
        If there is no campaign, or it cannot be read.
    """
    path = folder / DATA
    if not path.is_file():
        raise ResultError(f"holds no campaign: no {DATA}", source=folder)
    try:
        return xr.load_dataset(path, engine="netcdf4")
    except (OSError, ValueError, RuntimeError) as fault:
        raise ResultError(f"cannot be read: {fault}", source=path) from None


def load_head(folder: Path) -> dict[str, Any]:
    """What ``campaign.json`` says.

    Raises
    ------
    ResultError
        If it cannot be read, or another version wrote it.
    """
    path = folder / HEAD
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as fault:
        raise ResultError(f"cannot be read: {fault}", source=path) from None
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise ResultError("written by another version; name another folder", source=path)
    return found


def _check_same(head: Path, identity: Mapping[str, Any]) -> None:
    """Refuse a folder that holds another campaign, with the first thing that differs."""
    found = load_head(head.parent)
    if found.get("fingerprint") == identity["fingerprint"]:
        return
    parts = ("scenario", "gains", "urdf")
    old, new = (dict(leaves({part: given.get(part) for part in parts})) for given in (found, identity))
    differs = [path for path in dict.fromkeys([*old, *new]) if old.get(path) != new.get(path)]
    what = "made by another version of the library"
    if differs:
        path = differs[0]
        more = f" (and {len(differs) - 1} more)" if len(differs) > 1 else ""
        short = path.removeprefix("scenario.")
        what = f"{short} was {old.get(path)!r}, is {new.get(path)!r}{more}"
    message = f"holds another campaign: {what}; name another folder, or remove this one"
    raise ResultError(message, source=head.parent)


@contextlib.contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Keep other processes out; the lock ends with this process however it ends."""
    if folder.exists() and not folder.is_dir():
        raise ResultError("is a file, not a folder", source=folder)
    if folder.is_dir() and any(folder.iterdir()) and not any((folder / n).exists() for n in (HEAD, LOCK)):
        raise ResultError("holds files that are no campaign; name an empty or a new folder", source=folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / LOCK).open("w")
    except OSError as fault:
        raise ResultError(f"cannot be written: {fault.strerror or fault}", source=folder) from None
    with lock:
        try:
            import fcntl
        except ImportError:  # not a Unix: two processes are then the user's own affair
            yield
            return
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ResultError("is being written by another process", source=folder) from None
        for left in folder.glob(".merge-*"):
            shutil.rmtree(left, ignore_errors=True)
        yield


def _read(path: Path) -> Table:
    try:
        with np.load(path, allow_pickle=False) as stored:
            return Table(stored["draws"], stored["metrics"], stored["diverged_at_s"])
    except Exception as fault:  # whatever a spoilt archive makes zipfile, zlib or numpy say
        raise ResultError(f"cannot be read: {fault}", source=path) from None


def _is_complete(path: Path, count: int) -> bool:
    if not path.is_file():
        return False
    try:
        with netCDF4.Dataset(path) as file:
            return bool(file.getncattr("complete")) and len(file.dimensions["sample"]) == count
    except (OSError, RuntimeError, AttributeError, KeyError):
        return False


def _define(file: Any, parameters: Sequence[str], gains: Sequence[str], columns: Sequence[Column]) -> None:
    """Dimensions and variables; ``sample`` has no limit."""
    file.createDimension("sample", None)
    axes = {"parameter": list(parameters), "gains": list(gains)}
    for column in columns:
        axes.setdefault(f"{column.metric}_of", []).append(column.where)
    for axis, names in axes.items():
        file.createDimension(axis, len(names))
        file.createVariable(axis, str, (axis,))[:] = np.array(names, dtype=object)
    file.createVariable("sample", "i8", ("sample",), chunksizes=(ROWS,))

    def table(name: str, *others: str) -> Any:
        sizes = (ROWS, *(len(file.dimensions[axis]) for axis in others))
        return file.createVariable(name, "f8", ("sample", *others), zlib=True, complevel=1, chunksizes=sizes)

    table("draw", "parameter")
    table("diverged_at", "gains").units = "s"
    for metric, unit in {column.metric: column.unit for column in columns}.items():
        table(metric, "gains", f"{metric}_of").units = unit


def _append(file: Any, begin: int, table: Table, columns: Sequence[Column]) -> None:
    at = len(file.dimensions["sample"])
    rows = slice(at, at + len(table))
    file["sample"][rows] = np.arange(begin, begin + len(table))
    file["draw"][rows] = table.draws
    file["diverged_at"][rows] = table.diverged_at_s
    for metric in dict.fromkeys(column.metric for column in columns):
        places = [i for i, column in enumerate(columns) if column.metric == metric]
        file[metric][rows] = table.metrics[:, :, places]
