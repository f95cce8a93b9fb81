"""``spacerobot scenarios``: shipped scenarios and URDFs."""

from __future__ import annotations

from spacerobot.cli.command import Command
from spacerobot.cli.output import console, prose, table


@Command.of("scenarios", place=14)
def command() -> None:
    """List the shipped scenarios and URDFs.

    Example:

        spacerobot scenarios
    """
    from spacerobot.description.find import shipped_names, shipped_urdf_folder
    from spacerobot.scenario.catalogue import shipped
    from spacerobot.scenario.document import read_document

    rows = [
        (name, " ".join(str(read_document(path).get("description", "")).split()))
        for name, path in shipped().items()
    ]
    console().print(table("scenarios", ["name", "description"], rows))
    console().print()
    prose(f"URDFs in {shipped_urdf_folder()}: {', '.join(shipped_names())}")
