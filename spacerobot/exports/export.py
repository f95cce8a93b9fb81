"""Export of results, plans and scenes to files of other tools."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from spacerobot.common.errors import ResultError, SpaceRobotError, near_names
from spacerobot.common.files import StrPath, staged
from spacerobot.common.registry import EXPORT_FORMATS
from spacerobot.common.section import Section
from spacerobot.common.tables import Content, Table
from spacerobot.common.tabular import Tabular
from spacerobot.exports.export_format import ExportFormat
from spacerobot.scenario.validation_errors import explain
from spacerobot.scene.load import load_scene

if TYPE_CHECKING:
    from spacerobot.api.results import PlanResult
    from spacerobot.result import Result
    from spacerobot.scene import Scene

Changes = Mapping[str, Any] | Sequence[tuple[str, Any]]


def export(
    thing: Result | PlanResult | Scene | StrPath,
    path: StrPath,
    format: str | None = None,
    *,
    changes: Changes = (),
    **options: Any,
) -> Path:
    """Export a result, plan or scene to a file or folder of another tool.

    Args:
        thing: A result, a plan or a scene; the folder of a result or plan; the name or file of a scenario.
        path: File or folder to write. An existing file, or files of the same names in a folder, are replaced.
        format: Name of the format, from ``spacerobot export --list``; that of the suffix of ``path`` if None.
        changes: New values by dotted path, if ``thing`` is the name or file of a scenario.
        **options: Options of the format.

    Returns:
        pathlib.Path: ``path``.

    Raises:
        SpaceRobotError: If the format or an option is unknown, the format does not support ``thing``, or an
            optional package is missing.
        ResultError: If a folder contains neither a result nor a plan, or the file cannot be written.
        ScenarioError: If a scenario cannot be read.
    """
    chosen = format_of(path, format)
    parsed = parse_options(chosen, options)
    source = source_for(chosen, thing, changes)
    path = Path(path)
    if path.is_dir() and chosen.suffixes:
        raise ResultError(f"is a folder; the format {chosen.name} writes a file", source=path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with staged(path.resolve().parent) as stage:
            prepared = stage / path.name
            chosen.write(source, prepared, parsed)
            written = _move_into_place(prepared, path)
    except OSError as error:
        raise ResultError(f"cannot be written: {error.strerror or error}", source=path) from None
    from spacerobot.result import note_derived

    note_derived([getattr(source, "folder", None)], written)
    return path


@dataclass(frozen=True)
class FormatList(Tabular):
    """List of export formats.

    Attributes:
        formats: Formats by name.
    """

    formats: dict[str, ExportFormat]

    def content(self) -> Sequence[Content]:
        """Table of the formats with suffixes, sources and options."""
        return [
            Table(
                None,
                ("format", "suffixes", "from", "options", "description"),
                [
                    (
                        kind.name,
                        " ".join(kind.suffixes) or "-",
                        ", ".join(kind.takes),
                        "; ".join(
                            f"--{name.replace('_', '-')}: {field.description}"
                            for name, field in kind.options.model_fields.items()
                        )
                        or "-",
                        kind.summary,
                    )
                    for kind in self.formats.values()
                ],
            )
        ]

    def __repr__(self) -> str:
        """Names of the formats, in one line."""
        return f"<FormatList: {', '.join(self.formats)}>"


def list_formats() -> FormatList:
    """List the formats of :func:`export` with their options."""
    return FormatList(dict(EXPORT_FORMATS.entries()))


def format_of(path: StrPath, name: str | None = None) -> ExportFormat:
    """Find a format by its name, or by the suffix of a path.

    Raises:
        SpaceRobotError: If there is no such format; the message lists the formats or suffixes.
    """
    if name is not None:
        named: ExportFormat = EXPORT_FORMATS.find(name)
        return named
    suffix = Path(path).suffix.lower()
    suffixes: dict[str, ExportFormat] = {
        one: kind for kind in EXPORT_FORMATS.entries().values() for one in kind.suffixes
    }
    if suffix not in suffixes:
        has = f"suffix {suffix!r}" if suffix else "a name without a suffix"
        raise SpaceRobotError(
            f"{has} names no format; allowed: {', '.join(sorted(suffixes))}, or one of the formats "
            f"{', '.join(EXPORT_FORMATS.names())} by its name",
            source=Path(path),
        )
    return suffixes[suffix]


def parse_options(kind: ExportFormat, options: Mapping[str, Any]) -> Section:
    """Validate the options of a format.

    Raises:
        SpaceRobotError: If an option is unknown or has an invalid value.
    """
    if unknown := [name for name in options if name not in kind.options.model_fields]:
        names = kind.options.model_fields
        help_text = near_names(unknown[0], names) if names else "it has none"
        raise SpaceRobotError(f"no option {unknown[0]!r}; {help_text}", where=f"format {kind.name}")
    try:
        return kind.options.model_validate(dict(options))
    except ValidationError as error:
        where, text = explain(error.errors()[0], dict(options))
        raise SpaceRobotError(f"{where}: {text}", where=f"format {kind.name}") from None


def source_for(
    kind: ExportFormat, thing: Result | PlanResult | Scene | StrPath, changes: Changes = ()
) -> Result | PlanResult | Scene:
    """Read the result, plan or scene that a format exports.

    Args:
        kind: The format.
        thing: As for :func:`export`.
        changes: New values by dotted path, for a scenario.

    Raises:
        SpaceRobotError: If the format does not support ``thing``.
        ResultError: If a folder contains neither a result nor a plan.
        ScenarioError: If a scenario cannot be read.
    """
    # results are imported after the format and its options are known to be right
    from spacerobot.api.results import PlanResult
    from spacerobot.result import Result
    from spacerobot.scene import Scene

    source: Any = _read(thing, changes) if isinstance(thing, str | os.PathLike) else thing
    kinds = {"result": Result, "plan": PlanResult, "scene": Scene}
    name = next((name for name, cls in kinds.items() if isinstance(source, cls)), None)
    if name is None:
        raise SpaceRobotError(
            f"found a {type(source).__name__}, allowed: Result, PlanResult, Scene, or a path",
            where=f"format {kind.name}",
        )
    if name in kind.takes:
        return source  # type: ignore[no-any-return]
    if "scene" in kind.takes:
        return source.scene()  # type: ignore[no-any-return]
    takes = " or ".join(f"a {one}" for one in kind.takes)
    if not isinstance(source, Scene):
        raise SpaceRobotError(f"takes {takes}; found a {name}", where=f"format {kind.name}")
    verb, title = "run" if "result" in kind.takes else "plan", source.scenario.name
    raise SpaceRobotError(
        f"takes {takes}; found the scenario {title!r}: first spacerobot {verb} {title} --out DIR",
        where=f"format {kind.name}",
    )


def _read(path: StrPath, changes: Changes) -> Result | PlanResult | Scene:
    folder = Path(path)
    if not folder.is_dir():
        return load_scene(path, changes)
    if changes:
        raise ResultError("changes apply to a scenario, not to what was simulated", source=folder)
    from spacerobot.api.results import PlanResult
    from spacerobot.result import Result

    names = {file.name for file in folder.iterdir()}
    if "plan.json" in names:
        return PlanResult.load(folder)
    if "result.nc" in names or "summary.json" in names:
        return Result.load(folder)
    raise ResultError("holds neither a result nor a plan", source=folder)


def _move_into_place(prepared: Path, path: Path) -> list[Path]:
    """Move a file, or the files of a folder into a possibly existing folder, and return the final paths."""
    if prepared.is_file():
        prepared.chmod(0o644)
        prepared.replace(path.resolve())
        return [path]
    if path.exists() and not path.is_dir():
        raise ResultError("is a file, and the format writes a folder", source=path)
    files = [file for file in sorted(prepared.rglob("*")) if file.is_file()]
    written = [path / file.relative_to(prepared) for file in files]
    for file, target in zip(files, written, strict=True):
        target.parent.mkdir(parents=True, exist_ok=True)
        file.replace(target)
    return written
