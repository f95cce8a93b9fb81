"""Journals: all evaluations of a search, so that an interrupted search resumes with the same result.

A search is a deterministic function of its settings and of the values that it receives. Its journal holds
these values in order of request. A restarted search requests the same points, receives the stored values
without a rollout, and so reaches its previous state, whatever library keeps that state.

A record is written whole or is ignored: each carries its length and checksum.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ResultError

_HEAD = struct.Struct("<QI")
_TITLE = b"spacerobot journal 1 "


class Journal:
    """Evaluations of one search, in memory and in a file.

    Args:
        path: The file; created if missing, and overwritten if it has another fingerprint. None writes no
            file.
        fingerprint: Hash of everything on which the values depend: problem, method and settings.

    Raises:
        ResultError: If the file cannot be written.
    """

    def __init__(self, path: Path | None, fingerprint: str = "") -> None:
        self._records: list[dict[str, Array]] = []
        self._ends: list[int] = []
        self._next = 0
        self._file: BinaryIO | None = None
        if path is None:
            return
        title = _TITLE + fingerprint.encode() + b"\n"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            old = path.read_bytes() if path.exists() else b""
            same = old.startswith(title)
            self._file = path.open("r+b" if same else "wb")
            if not same:
                self._file.write(title)
            self._records, self._ends = _read(old, len(title)) if same else ([], [])
            self._begin = len(title)
            self._cut()
        except OSError as fault:
            raise ResultError(f"cannot be written: {fault.strerror or fault}", source=path) from None

    def __len__(self) -> int:
        return len(self._records)

    def replay(self, kind: str, point: Array) -> Mapping[str, Array] | None:
        """Next record if it is of this kind and point; else None, and it and all later ones are dropped."""
        if self._next >= len(self._records):
            return None
        record = self._records[self._next]
        if str(record["kind"]) == kind and np.array_equal(record["point"], point):
            self._next += 1
            return record
        del self._records[self._next :], self._ends[self._next :]
        self._cut()
        return None

    def append(self, kind: str, point: Array, values: Mapping[str, Array]) -> None:
        """Add a record after the last one."""
        record = {"kind": np.array(kind), "point": np.array(point), **values}
        self._records.append(record)
        self._next = len(self._records)
        if self._file is not None:
            buffer = io.BytesIO()
            np.savez(buffer, allow_pickle=False, **record)
            payload = buffer.getvalue()
            self._file.write(_HEAD.pack(len(payload), zlib.crc32(payload)) + payload)
            self._file.flush()
            self._ends.append(self._file.tell())

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _cut(self) -> None:
        """Truncate the file after its last complete record."""
        if self._file is not None:
            end = self._ends[-1] if self._ends else self._begin
            self._file.truncate(end)
            self._file.seek(end)
            self._file.flush()


def _read(content: bytes, begin: int) -> tuple[list[dict[str, Array]], list[int]]:
    """Whole records of a file, and where each ends."""
    records: list[dict[str, Array]] = []
    ends: list[int] = []
    at = begin
    while at + _HEAD.size <= len(content):
        length, checksum = _HEAD.unpack_from(content, at)
        payload = content[at + _HEAD.size : at + _HEAD.size + length]
        if len(payload) < length or zlib.crc32(payload) != checksum:
            break
        with np.load(io.BytesIO(payload), allow_pickle=False) as stored:
            records.append({name: stored[name] for name in stored.files})
        at += _HEAD.size + length
        ends.append(at)
    return records, ends
