"""A campaign's folder: atomically written chunks, and a netCDF file merged from them.

``campaign.json`` identifies the campaign. ``chunks/BEGIN-END.npz`` holds samples BEGIN to END - 1, so that
the file names show which samples exist; each is stored once. ``campaign.nc`` is merged from the chunks at the
end and after an interruption; once it is complete, the chunks are deleted.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from optim.campaign.rollouts.evaluator import CampaignEvaluator, SampleTable
from optim.campaign.store.netcdf import DATA, FORMAT, is_complete, write_tables
from spacerobot.common.errors import ResultError
from spacerobot.common.files import write_bytes, write_text
from spacerobot.common.interrupts import uninterrupted
from spacerobot.common.section import leaves
from spacerobot.elements.core.registry import plugin_records

Interval = tuple[int, int]
"""Interval of samples: the first, and the one after the last."""
HEAD, CHUNKS, LOCK = "campaign.json", "chunks", ".lock"
SERIES = "series."  # before the names of series in a chunk


class CampaignStore:
    """Folder of one campaign, held by one process at a time; see :func:`open_store`.

    Attributes:
        done: Samples that are there.
    """

    def __init__(self, folder: Path, count: int) -> None:
        self.folder, self.count = folder, count
        self._there, self.done = np.zeros(count, dtype=bool), 0
        self._chunks: list[Interval] = []
        # list the existing chunks; one damaged by a full disk or a power cut is deleted
        if is_complete(self.folder / DATA, self.count):
            self._note(0, self.count)
        else:
            for path in sorted((self.folder / CHUNKS).glob("?????????-?????????.npz")):
                begin, end = (int(part) for part in path.stem.split("-"))
                try:
                    complete = len(_read(path)) == end - begin > 0 and end <= self.count
                except ResultError:
                    complete = False
                if complete and self._note(begin, end):
                    self._chunks.append((begin, end))
                else:
                    path.unlink()

    def _note(self, begin: int, end: int) -> bool:
        """Note samples; False, and nothing happens, if one of them is there already."""
        if self._there[begin:end].any():
            return False
        self._there[begin:end] = True
        self.done += end - begin
        return True

    @property
    def missing(self) -> list[Interval]:
        """Missing samples, as intervals in order."""
        edges = np.flatnonzero(np.diff(self._there, prepend=True, append=True))
        return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]

    def add(self, begin: int, table: SampleTable) -> None:
        """Write a chunk.

        Raises:
            ResultError: If it cannot be written, or holds a sample that is there already.
        """
        end, buffer = begin + len(table), io.BytesIO()
        np.savez(
            buffer,
            allow_pickle=False,
            draws=table.draws,
            metrics=table.metrics,
            diverged_at_s=table.diverged_at_s,
            gaps=table.gaps,
            **{SERIES + name: values for name, values in table.series.items()},
        )
        with uninterrupted():  # else what is noted and what is on the disk might differ
            if not self._note(begin, end):
                raise ResultError(f"samples {begin} to {end - 1} are there already", source=self.folder)
            write_bytes(self._chunk((begin, end)), buffer.getvalue())
            self._chunks.append((begin, end))

    def merge(self, evaluator: CampaignEvaluator, about: str) -> None:
        """Merge the chunks into ``campaign.nc``, and delete them if no sample is missing.

        Raises:
            ResultError: If it cannot be written, or a chunk cannot be read.
        """
        path, complete = self.folder / DATA, not self.missing
        if complete and not self._chunks:
            return
        stage = Path(tempfile.mkdtemp(prefix=".merge-", dir=self.folder))
        tables = ((begin, _read(self._chunk((begin, end)))) for begin, end in sorted(self._chunks))
        try:
            with uninterrupted():  # Ctrl-C would leave the file's library locked
                write_tables(stage / DATA, evaluator, tables, about=about, complete=complete)
                # wait until a file is on the disk: the chunks that it replaces are about to go
                with (stage / DATA).open("rb+") as file:
                    os.fsync(file.fileno())
                (stage / DATA).replace(path)
        except (OSError, RuntimeError) as fault:
            remedy = f"what was rolled out stays in {CHUNKS}; free disk space and start again"
            raise ResultError(f"cannot be written: {fault}; {remedy}", source=path) from None
        finally:
            shutil.rmtree(stage, ignore_errors=True)
        if complete:
            shutil.rmtree(self.folder / CHUNKS, ignore_errors=True)

    def _chunk(self, interval: Interval) -> Path:
        return self.folder / CHUNKS / f"{interval[0]:09d}-{interval[1]:09d}.npz"


@contextlib.contextmanager
def open_store(
    folder: Path, identity: Mapping[str, Any], count: int, notes: Mapping[str, Any] | None = None
) -> Iterator[CampaignStore]:
    """Context that opens, or creates, the store of a campaign, and locks it for this process.

    Args:
        folder: Folder of the store.
        identity: Settings that determine the numbers; see ``Evaluator.identity``.
        count: Total number of samples.
        notes: Evaluated limits and metrics, and the command. They may change from call to call, and are then
            rewritten; left unchanged if None.

    Raises:
        ResultError: If the folder holds something else or another campaign, is in use, or cannot be written.
    """
    with _held(folder):
        head = folder / HEAD
        stored_head: dict[str, Any] = {}
        if head.exists():
            stored_head = load_head(folder)
            # refuse a folder of another campaign; the message names the first difference
            differs = difference(stored_head, identity)
            if differs is not None:
                what = differs or "made by another version of the library"
                message = f"holds another campaign: {what}; name another folder, or remove this one"
                raise ResultError(message, source=folder)
        new_head = {
            "format": FORMAT,
            **identity,
            "notes": stored_head.get("notes", {}) if notes is None else notes,
        }
        if plugins := plugin_records() or stored_head.get("plugins"):
            new_head["plugins"] = plugins
        text = json.dumps(new_head, indent=1) + "\n"
        if stored_head != json.loads(text):
            write_text(head, text)
        yield CampaignStore(folder, count)


def load_head(folder: Path) -> dict[str, Any]:
    """Contents of ``campaign.json``.

    Raises:
        ResultError: If it cannot be read, or another version wrote it.
    """
    path = folder / HEAD
    try:
        head = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as fault:
        raise ResultError(f"cannot be read: {fault}", source=path) from None
    layout = head.get("format") if isinstance(head, dict) else None
    if layout != FORMAT:
        raise ResultError(
            f"written by another version: layout {layout}, this one reads {FORMAT}; run the campaign again "
            "in another folder",
            source=path,
        )
    return dict(head)


def difference(head: Mapping[str, Any], identity: Mapping[str, Any]) -> str | None:
    """Text of the first difference between a folder's campaign and another one.

    None if their fingerprints agree; empty if they differ but not in scenario, gains or URDF.

    Args:
        head: Contents of ``campaign.json``, as :func:`load_head` returns them.
        identity: Settings that determine the numbers of the other campaign.
    """
    if head.get("fingerprint") == identity["fingerprint"]:
        return None
    parts = ("scenario", "gains", "urdf")
    old, new = (dict(leaves({part: document.get(part) for part in parts})) for document in (head, identity))
    differs = [path for path in dict.fromkeys([*old, *new]) if old.get(path) != new.get(path)]
    if not differs:
        return ""
    path = differs[0]
    more = f" (and {len(differs) - 1} more)" if len(differs) > 1 else ""
    return f"{path.removeprefix('scenario.')} was {old.get(path)!r}, is {new.get(path)!r}{more}"


def check_place(folder: Path) -> None:
    """Refuse a path that is a file, or a folder that holds something else, before any work is done.

    Raises:
        ResultError: If the folder holds something else; the message states the reason.
    """
    if folder.exists() and not folder.is_dir():
        raise ResultError("is a file, not a folder", source=folder)
    try:
        foreign = (
            folder.is_dir() and any(folder.iterdir()) and not any((folder / n).exists() for n in (HEAD, LOCK))
        )
    except OSError as fault:
        raise ResultError(f"cannot be read: {fault.strerror or fault}", source=folder) from None
    if foreign:
        raise ResultError("holds files that are no campaign; name an empty or a new folder", source=folder)
    if (folder / HEAD).exists():
        load_head(folder)


@contextlib.contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Keep other processes out; the lock ends with this process however it ends."""
    check_place(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / LOCK).open("w")
    except OSError as fault:
        raise ResultError(f"cannot be written: {fault.strerror or fault}", source=folder) from None
    with lock:
        try:
            import fcntl
        except ImportError:  # no locks on files outside Unix
            yield
            return
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            hint = "wait for it, or stop it: Ctrl-C keeps what is there"
            raise ResultError(f"is being written by another process; {hint}", source=folder) from None
        for left in folder.glob(".merge-*"):
            shutil.rmtree(left, ignore_errors=True)
        yield


def _read(path: Path) -> SampleTable:
    try:
        with np.load(path, allow_pickle=False) as stored:
            series = {
                name.removeprefix(SERIES): stored[name] for name in stored.files if name.startswith(SERIES)
            }
            times = stored["diverged_at_s"]
            gaps = stored["gaps"] if "gaps" in stored else np.empty((*times.shape, 0))  # of an older version
            return SampleTable(stored["draws"], stored["metrics"], times, gaps, series)
    except Exception as fault:  # whatever a spoilt archive makes zipfile, zlib or numpy say
        raise ResultError(f"cannot be read: {fault}", source=path) from None
