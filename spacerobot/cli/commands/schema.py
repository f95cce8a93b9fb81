"""``spacerobot schema``: JSON schema of scenario files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import EXCHANGE, Command


@Command.of("schema", place=3, group=EXCHANGE)
def command(
    file: Annotated[Path | None, typer.Argument(help="File to write; standard output if not given.")] = None,
) -> None:
    """Export the JSON schema of scenario files, for completion and checking in editors.

    Example:

        spacerobot schema scenario.schema.json
    """
    import json

    text = json.dumps(sr.scenario_schema(), indent=2)
    if file is None:
        typer.echo(text)
    else:
        from spacerobot.common.files import write_text

        write_text(file, text + "\n")
        typer.echo(f"schema in {file}")
