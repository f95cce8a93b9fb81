"""``spacerobot export``: write a result, a plan or a scenario for another tool."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any

import typer

import spacerobot as sr
from spacerobot.cli.command import EXCHANGE, Command
from spacerobot.cli.options import Changes, changes_named, parse_changes
from spacerobot.cli.output import console, progress, show
from spacerobot.common.registry import COMMANDS

Words = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[FORMAT] SOURCE [PATH]",
        help="Folder of a result or plan, or a scenario; the file to write, whose suffix names the format, "
        "or FORMAT and --out. Options of the format may follow.",
    ),
]
Target = Annotated[Path | None, typer.Option("--out", metavar="PATH", help="File or folder to write.")]
Listing = Annotated[bool, typer.Option("--list", help="List formats and their options.")]


def command(
    words: Words = None, out: Target = None, changes: Changes = None, listing: Listing = False
) -> None:
    """Write a result, a plan or a scenario for another tool: `--list` shows the formats.

    Examples:

        spacerobot export out/paper paper.csv

        spacerobot export mat out/paper --out paper.mat

        spacerobot export --list
    """
    if listing:
        show(sr.list_formats())
        return
    _reject_missing(words or [], out)
    positional, options = _parse(words or [])
    name, source, path = _interpret(positional, out)
    from spacerobot.cli.plugins import load_plugins_of
    from spacerobot.exports.export import format_of, parse_options

    kind = format_of(path, name)
    parse_options(kind, options)  # before the call: an option may have the name of another argument
    if Path(source).is_dir():
        load_plugins_of([Path(source)])
    with progress("exporting"), changes_named(source, changes):
        written = sr.export(source, path, kind.name, changes=parse_changes(changes), **options)
    console().print(f"{kind.name} in {written}", markup=False, soft_wrap=True)


COMMANDS.add(
    Command(
        "export",
        lambda app: app.command(
            "export", rich_help_panel=EXCHANGE, context_settings={"ignore_unknown_options": True}
        )(command),
        place=1,
        group=EXCHANGE,
    ),
    __name__,
)


def _interpret(positional: Sequence[str], out: Path | None) -> tuple[str | None, str, Path]:
    """Format, source and output path from the positional words."""
    from spacerobot.common.errors import SpaceRobotError

    if out is not None and len(positional) in (1, 2):
        *name, source = positional
        return (name[0] if name else None), source, out
    if out is None and len(positional) == 2:
        return None, positional[0], Path(positional[1])
    text = " ".join(positional) or "nothing"
    raise SpaceRobotError(
        f"found {text!r}{'' if out is None else f' and --out {out}'}, allowed: SOURCE PATH, "
        "SOURCE --out PATH or FORMAT SOURCE --out PATH",
        where="spacerobot export",
    )


def _reject_missing(words: Sequence[str], out: Path | None) -> None:
    """Check that the source is a folder or a scenario, before the libraries of the formats are loaded."""
    from spacerobot.common.errors import SpaceRobotError
    from spacerobot.common.registry import EXPORT_FORMATS
    from spacerobot.scenario.catalogue import find_scenario

    if not words:
        raise SpaceRobotError(
            "no source; give a result's folder or a scenario, and a file, as in "
            "`spacerobot export out/paper paper.csv`; `spacerobot export --list` shows the formats",
            where="spacerobot export",
        )
    leading = list(takewhile(lambda word: not word.startswith("--"), words))
    if len(leading) in (1, 2):
        source = leading[0 if out is None else -1]
        if out is None and len(leading) == 2 and source in EXPORT_FORMATS.names():
            raise SpaceRobotError(
                f"found the format {source!r} without --out; "
                f"allowed: spacerobot export {source} {leading[1]} --out PATH",
                where="spacerobot export",
            )
        if not Path(source).is_dir():
            find_scenario(source)


def _parse(words: Sequence[str]) -> tuple[list[str], dict[str, Any]]:
    """Separate positional words from options of formats: ``--name VALUE``, ``--name=VALUE``, ``--flag``."""
    from spacerobot.common.registry import EXPORT_FORMATS
    from spacerobot.scenario.document import parse_yaml

    positional, options, waiting = list[str](), dict[str, Any](), iter(words)
    fields = {
        name: field
        for kind in EXPORT_FORMATS.entries().values()
        for name, field in kind.options.model_fields.items()
    }
    for word in waiting:
        if not word.startswith("--") or word == "--":
            positional.append(word)
            continue
        text, has_value, value = word.removeprefix("--").partition("=")
        name = text.replace("-", "_")
        if not has_value and (name not in fields or fields[name].annotation is bool):
            options[name] = True
            continue
        value = value if has_value else next(waiting, "")
        options[name] = (
            value if name in fields and fields[name].annotation is str else parse_yaml(value, source=word)
        )
    return positional, options
