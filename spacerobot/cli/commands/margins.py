"""``spacerobot margins``: stability margins of every loop at instants of a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal

import typer

import spacerobot as sr
from spacerobot.cli.command import SIMULATE, Command
from spacerobot.cli.options import Changes, Out, ScenarioName, arguments_as_options, load
from spacerobot.cli.output import is_narrow, print_next, progress, show
from spacerobot.common.errors import ScenarioError
from spacerobot.common.tables import Content, Table

At = Annotated[
    list[str] | None,
    typer.Option(
        "--at",
        metavar="INSTANT",
        help="Time in s, or an event such as `captured` (just before and after). Repeatable; default 0.",
    ),
]
Along = Annotated[
    int,
    typer.Option(
        "--along", min=0, metavar="N", help="N instants from the start to the end, instead of --at."
    ),
]
Worst = Annotated[
    list[str] | None,
    typer.Option(
        "--worst-case",
        metavar="PATH=LOW..HIGH",
        help="Smallest margin over a number's range; a path's end matches as in `tune --vary`. Repeatable.",
    ),
]
Margin = Annotated[
    Literal["disk", "gain_up", "gain_down", "phase", "delay"] | None,
    typer.Option(
        "--margin",
        metavar="NAME",
        help="disk, gain_up, gain_down, phase or delay, of --worst-case; disk if not given.",
    ),
]
Loops = Annotated[
    str | None,
    typer.Option(
        "--loops",
        metavar="PATTERN",
        help="Loops of --worst-case and --together, such as 'torque/*'; all if not given.",
    ),
]
Together = Annotated[
    bool,
    typer.Option("--together", help="Disk margin for simultaneous changes of all --loops."),
]


@Command.of("margins", place=3, group=SIMULATE)
def command(
    scenario: ScenarioName,
    at: At = None,
    along: Along = 0,
    changes: Changes = None,
    out: Out = None,
    worst_case: Worst = None,
    margin: Margin = None,
    loops: Loops = None,
    together: Together = False,
) -> None:
    """Linearise the closed loop; print its poles, and gain, phase, delay and disk margins of every loop.

    Loops are broken at one joint torque, measurement or wheel each, while the others stay closed.

    Examples:

        spacerobot margins docking --at 2.5 --at captured --out out/margins

        spacerobot margins docking --along 40 --out out/margins

        spacerobot margins docking --at captured --worst-case target.links.body.mass=50..200
            --loops 'torque/*'
    """
    kind = "--worst-case" if worst_case else "--together" if together else ""
    for option, value, is_used, needed in (
        ("--margin", margin, bool(worst_case), "needs --worst-case"),
        ("--loops", loops, bool(kind), "needs --worst-case or --together"),
        ("--along", along, not (kind or at), f"does not go with {kind or '--at'}"),
        ("--out", out, not kind, f"does not go with {kind}, whose outcome is only printed"),
        ("--together", together, not worst_case, "does not go with --worst-case"),
    ):
        if value and not is_used:
            raise typer.BadParameter(needed, param_hint=option)
    scene = load(scenario, changes)
    instants = [_instant(text) for text in at or ["0"]]
    patterns = loops or "*"
    with progress("building the closed loop") as tell, arguments_as_options("along", "at", "loops"):
        result: sr.WorstMargins | sr.SimultaneousMargins | sr.MarginAnalysis
        if worst_case:
            try:
                scene = sr.vary(scene, worst_case)
            except ScenarioError as error:  # `tune` names the same texts --vary
                where = (error.where or "").replace("--vary", "--worst-case")
                raise ScenarioError(error.message, source=error.source, where=where) from None
            result = sr.worst_margins(scene, instants, margin=margin or "disk", loops=patterns, progress=tell)
        elif together:
            result = sr.simultaneous_margins(scene, instants, loops=patterns, progress=tell)
        else:
            result = sr.margins(scene, instants, along=along, progress=tell)
            if out is not None:
                tell("drawing")
                sr.figures(result, out / "figures", formats=("pdf", "png", "svg"))
                result.save(out)
    show(_narrow(result.content()) if is_narrow() else result)
    if out is not None and isinstance(result, sr.MarginAnalysis):
        words = f"margins.nc and figures in {out}; `spacerobot report {out}` makes a page of them"
        print_next(words)


def _narrow(content: Sequence[Content]) -> list[Content]:
    """Content without the crossover frequencies, and with each note once, at the end."""
    tables: list[Content] = []
    notes = dict.fromkeys(part for part in content if isinstance(part, str))
    for part in content:
        if isinstance(part, Table) and part.headings and part.headings[-1] == "crossover [Hz]":
            rows = [row[:-1] for row in part.rows]
            tables.append(replace(part, headings=part.headings[:-1], rows=rows))
        elif not isinstance(part, str):
            tables.append(part)
    return [*tables, *notes]


def _instant(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
