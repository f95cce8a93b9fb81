"""Export of a design: scenario file, result, page, recording, table, or command line."""

from __future__ import annotations

import csv
import io
import os
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spacerobot.common.errors import ResultError, ScenarioError, SpaceRobotError
from spacerobot.common.files import write_text
from spacerobot.common.section import leaves
from spacerobot.elements.core.registry import plugin_options
from spacerobot.result import Result
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.load import to_document, to_yaml, validate
from spacerobot.scene import build_scene
from spacerobot.simulation import simulate
from viz.page.page import write_animation
from viz.page.signals import quantities
from viz.recording.record import write_recording
from viz.studio.edited_text import edited, flow
from viz.studio.prepared_design import Origin, Tell

KINDS = ("scenario", "result", "page", "gif", "mp4", "csv")
"""Forms in which a design can be saved."""

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
"""Pattern of file names."""

RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
"""File names that Windows reserves."""


def keep(
    what: str,
    name: str,
    folder: Path,
    origin: Origin,
    changes: Mapping[str, Any],
    tell: Tell = lambda _: None,
) -> Path:
    """Write a design into a folder.

    Args:
        what: Kind of file, one of ``KINDS``.
        name: Name of the file without its suffix, or of the result's folder.
        folder: Folder of the file; nothing is written elsewhere.
        origin, changes: The design.
        tell: Callback for progress messages of long exports.

    Raises:
        ResultError: If the name is not allowed, or the file cannot be written.
        ScenarioError, DescriptionError, DivergedError: If the design cannot be simulated.
    """
    path = place(folder, name, {"result": "", "scenario": "yaml", "page": "html"}.get(what, what))
    scene = origin.build(changes)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise ResultError(f"cannot be made: {fault.strerror}", source=folder) from None
    if what == "scenario":
        # The file that it came from with what changed, if that reads back to the same scene.
        text, source = None, origin.scene.source
        document, start = to_document(scene.scenario), path.parent.resolve()
        if source is not None and source.is_file():
            # URDFs as a scenario in a folder names them: those that do not ship, relative to it
            files = {path: file for path, file in leaves(document) if path.endswith(".urdf") and file}
            urdfs = {
                path: Path(os.path.relpath(file, start)).as_posix()
                for path, file in files.items()
                if Path(file).is_absolute() and Path(file).anchor == start.anchor
            }
            text = edited(
                source.read_text(encoding="utf-8"), dict([*origin.changes_at_load, *changes.items()]) | urdfs
            )
        try:
            read = {"name": scene.scenario.name} | parse_yaml(text or "")
            same = (
                to_document(build_scene(validate(read), source=path, expand_xacro=True).scenario) == document
            )
        except (SpaceRobotError, TypeError):
            same = False
        plain = f"# Written by spacerobot studio, every value given.\n{to_yaml(scene.scenario)}"
        write_text(path, text if text is not None and same else plain)
        return path
    result = simulate(scene)
    if what == "result":
        result.save(path)
    elif what == "page":
        write_animation(result, path)
    elif what == "csv":
        write_text(path, table(result))
    else:
        write_recording(result, path, progress=tell)
    return path


def place(folder: Path, name: str, ending: str) -> Path:
    """Path of a new file directly inside a folder.

    Raises:
        ResultError: If the name could lead elsewhere.
    """
    stem = name.removesuffix(f".{ending}") if ending else name
    if not NAME.fullmatch(stem) or RESERVED.fullmatch(stem) or stem.endswith("."):
        raise ResultError(f"found the name {name!r}, allowed: letters, digits, _, - and . between them")
    path = folder / (f"{stem}.{ending}" if ending else stem)
    if path.is_symlink() or not path.resolve().is_relative_to(folder.resolve()):
        raise ResultError("leads out of the studio's folder", source=path)
    return path


def command_line(origin: Origin, changes: Mapping[str, Any], step_s: float | None = None) -> str:
    """Command that simulates a design; ``step_s`` is the step that the studio chose."""
    name = origin.name or (str(origin.scene.source) if origin.scene.source else origin.scene.scenario.name)
    pairs = [*origin.changes_at_load, *changes.items()]
    if step_s is not None:
        pairs.append(("simulation.step", step_s))
    words = ["spacerobot", "run", name, *plugin_options()]
    for path, value in pairs:
        words += ["--set", f"{path}={as_yaml(value)}"]
    return shlex.join(words)


def as_yaml(value: Any) -> str:
    """YAML of a value on one line."""
    plain = str(value)
    if isinstance(value, str):
        try:
            if plain == plain.strip() and parse_yaml(plain) == value:
                return plain
        except ScenarioError:
            pass
    return flow(value)


def table(result: Result) -> str:
    """All curves of a result as comma-separated values, one row per sample."""
    columns = [("time [s]", result.data.time.values)]
    for quantity in quantities(result):
        columns += [(f"{quantity.title} {s.name} [{quantity.unit}]", s.values) for s in quantity.signals]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([name for name, _ in columns])
    writer.writerows(zip(*(map(repr, values.tolist()) for _, values in columns), strict=True))
    return text.getvalue()
