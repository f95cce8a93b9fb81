"""``spacerobot schema``: JSON schema of scenario files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from spacerobot.cli.command import Command


@Command.of("schema", place=18)
def command(
    file: Annotated[Path | None, typer.Argument(help="File to write; standard output if not given.")] = None,
) -> None:
    """Export the JSON schema of scenario files, for completion and checking in editors.

    Example:

        spacerobot schema scenario.schema.json
    """
    import json

    from spacerobot.scenario.load import json_schema

    text = json.dumps(json_schema(), indent=2)
    if file is None:
        typer.echo(text)
    else:
        from spacerobot.files import write_text

        write_text(file, text + "\n")
        typer.echo(f"schema in {file}")
