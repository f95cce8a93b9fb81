"""Loading of the plugins that results, plans and campaigns were made with, after permission.

A folder has the names and hashes of its plugins. Since a plugin is Python code, it must not run without
permission, for the folder may come from somebody else. Plugins are permitted by ``--plugin``, by the user's
list of trusted hashes, or by an answer in the terminal.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from spacerobot.api.saved_kinds import saved_kind
from spacerobot.common.errors import ResultError

TRUSTED = Path("spacerobot") / "trusted_plugins"
"""File in the user's folder of configuration: a line for each plugin, as ``sha256sum FILE`` writes it."""
KEPT_IN = ("summary.json", "plan.json", "campaign.json")
"""Files of results, plans and campaigns that keep the plugins which they were made with."""


def check_folders(folders: Iterable[Path]) -> None:
    """Check that folders hold results, before a command imports the libraries that read them.

    Raises:
        ResultError: If a folder is missing, or holds no result.
    """
    for folder in folders:
        if not folder.is_dir():
            raise ResultError(
                "is a file, not a folder" if folder.exists() else "no such folder", source=folder
            )
        saved_kind(folder)


def load_plugins_of(folders: Sequence[Path]) -> None:
    """Run the plugins with which the results, plans and campaigns in folders were made.

    Raises:
        ResultError: If a plugin is missing, changed or not permitted; the message states how to permit it.
    """
    for folder, record in _records(folders):
        from spacerobot.elements import load_plugin
        from spacerobot.elements.core.registry import plugin_records

        loaded = plugin_records()
        if any(one["sha256"] == record["sha256"] or _name(one) == _name(record) for one in loaded):
            continue
        path = _file_of(folder, record)
        if not _is_allowed(folder, path, record["sha256"]):
            raise ResultError(
                f"made with the plugin {path}, which is code that would be run; allow it by --plugin {path}, "
                f"or for good by `sha256sum {path} >> {trusted_list()}`",
                source=folder,
            )
        load_plugin(path)


def trusted_list() -> Path:
    """File with the hashes of the user's trusted plugins, which may not exist."""
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(home) / TRUSTED


def _records(folders: Iterable[Path]) -> Iterator[tuple[Path, dict[str, str]]]:
    """Iterate over the folders of results inside folders, and their records of plugins.

    Damaged summaries are skipped; they are reported when the result is read.
    """
    for folder in folders:
        depths = ("", "*/", "*/*/")
        for path in sorted({path for at in depths for name in KEPT_IN for path in folder.glob(at + name)}):
            try:
                summary: Any = json.loads(path.read_text(encoding="utf-8"))
            except (OSError, ValueError, RecursionError):
                continue
            records = summary.get("plugins") if isinstance(summary, dict) else None
            for record in records if isinstance(records, list) else ():
                if isinstance(record, dict) and all(
                    isinstance(record.get(k), str) for k in ("file", "sha256")
                ):
                    yield path.parent, record


def _name(record: dict[str, str]) -> str:
    return Path(record["file"]).name


def _file_of(folder: Path, record: dict[str, str]) -> Path:
    """File of a plugin with the recorded hash: at its recorded path, in or next to the folder, or in the cwd.

    Raises:
        ResultError: If there is no such file.
    """
    places = [
        Path(record["file"]),
        folder / _name(record),
        folder.parent / _name(record),
        Path(_name(record)),
    ]
    files = [place for place in places if place.is_file()]
    for place in files:
        if hashlib.sha256(place.read_bytes()).hexdigest() == record["sha256"]:
            return place
    state = f"{files[0]} has changed since" if files else f"which is not at {record['file']} any more"
    raise ResultError(
        f"made with the plugin {_name(record)} (sha256 {record['sha256'][:12]}...); {state}; "
        "name the file by --plugin FILE",
        source=folder,
    )


def _is_allowed(folder: Path, path: Path, sha256: str) -> bool:
    """Whether the list of trusted plugins has a hash, or the user permits the plugin in the terminal."""
    import typer

    try:
        lines = trusted_list().read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        lines = []
    if sha256 in {line.split()[0].removeprefix("\\") for line in lines if line.split()}:
        return True
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    return typer.confirm(f"{folder} was made with the plugin {path}. Run that file?", err=True)
