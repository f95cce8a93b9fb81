"""``spacerobot margins``: stability margins of every loop at instants of a simulation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.options import Changes, Out, ScenarioName, parse_changes
from spacerobot.cli.output import console, pairs, progress, table

if TYPE_CHECKING:
    from spacerobot.linear import LinearSystem, LoopMargins

At = Annotated[
    list[str] | None,
    typer.Option(
        "--at",
        metavar="INSTANT",
        help="Time in s, or an event such as `captured`: just before and just after it. Repeatable; else 0.",
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
        help="Least margin while this number varies; a path's end matches as for `tune --vary`. Repeatable.",
    ),
]
Margin = Annotated[
    str,
    typer.Option(
        "--margin", metavar="NAME", help="disk, gain_up, gain_down, phase or delay, of --worst-case."
    ),
]
Loops = Annotated[
    str, typer.Option("--loops", metavar="PATTERN", help="Loops of --worst-case and --together: 'torque/*'.")
]
Together = Annotated[
    bool,
    typer.Option("--together", help="Disk margin of the --loops when all change at once."),
]
HEADINGS = ("loop", "gain [dB]", "phase [deg]", "delay [s]", "disk", "crossover [Hz]")
MOST_LOOPS = 12
"""Loops with the least disk margins that are printed."""
MOST_MODES = 6
"""Least damped modes that are printed."""


@Command.of("margins", place=4.5)
def command(
    scenario: ScenarioName,
    at: At = None,
    along: Along = 0,
    changes: Changes = None,
    out: Out = None,
    worst_case: Worst = None,
    margin: Margin = "disk",
    loops: Loops = "*",
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
    from spacerobot.scene import load_scene

    scene = load_scene(scenario, parse_changes(changes))
    from spacerobot.linear import margins

    instants = [_instant(text) for text in at or ["0"]]
    if worst_case:
        from optim.problem.varied_parameters import vary
        from optim.robust.worst_margins import worst_margins

        with progress("building the closed loop") as tell:
            cases = worst_margins(
                vary(scene, worst_case), at=instants, margin=margin, loops=loops, progress=tell
            )
        console().print(pairs(f"least {cases.margin} margins [{cases.unit}]", cases.rows()))
        return
    if together:
        from spacerobot.linear import linearise
        from spacerobot.linear.simultaneous import simultaneous_disk_margin

        with progress("building the closed loop") as tell:
            bounds = [
                (one.label, "disk margin {:.4f} to {:.4f}".format(*simultaneous_disk_margin(one, loops)))
                for one in linearise(scene, instants, progress=tell)
            ]
        console().print(pairs(f"{loops}, all at once", bounds))
        return
    with progress("building the closed loop") as tell:
        found = margins(scene, instants, along=along, progress=tell)
        if out is not None:
            from viz.figures.margins import write_margins

            tell("drawing")
            write_margins(found, scene.scenario.name, out)
            data = found.to_xarray()
            data.to_netcdf(out / "margins.nc")
    first = found.loops[0]
    if along:
        least = found.to_xarray()
        rows = []
        lowest = least.disk.fillna(math.inf).min("instant")
        for k in lowest.argsort().values[:MOST_LOOPS]:
            worst = int(least.disk[:, k].fillna(math.inf).values.argmin())
            rows.append([least.instant.values[worst], *row_of(found.loops[worst][k])])
        console().print(table(f"least disk margins of {along} instants", ("at", *HEADINGS), rows, keys=2))
    else:
        for linear, own in zip(found.linearisations, found.loops, strict=True):
            ranked = sorted(own, key=lambda one: math.inf if math.isnan(one.disk) else one.disk)
            shown = [row_of(one) for one in ranked[:MOST_LOOPS]]
            console().print(table(f"{linear.label}: {about(linear)}", HEADINGS, shown))
            console().print(table(None, ("mode", "frequency [Hz]", "damping ratio"), modes_of(linear)))
    if len(first) > MOST_LOOPS:
        more = "all in margins.nc" if out is not None else "--out DIR writes all"
        console().print(f"the {MOST_LOOPS} of {len(first)} loops with the least disk margins; {more}")
    if out is not None:
        console().print(f"margins.nc and figures in {out}", markup=False, soft_wrap=True)


def row_of(one: LoopMargins) -> list[str]:
    """Cells of a loop."""
    if math.isnan(one.disk):
        return [one.name, "varies in time", "", "", "", ""]
    gain = f"{one.gain_down:+.1f} to {one.gain_up:+.1f}"
    numbers = (f"{one.phase:.1f}", f"{one.delay:.3g}", f"{one.disk:.3f}", f"{one.crossover:.3g}")
    return [one.name, gain, *(text.replace("nan", "none") for text in numbers)]


def about(linear: LinearSystem) -> str:
    """Stability of a linearised closed loop, and its size, in words."""
    kind = f"sampled, period {linear.period_s:g} s" if linear.period_s else "continuous"
    stable = "no growing mode"
    if linear.growing:
        fastest = max(mode.pole.real for mode in linear.growing)
        stable = f"{len(linear.growing)} growing modes, the fastest {fastest:.3g} 1/s"
    return f"{kind}, {len(linear.states)} states, {linear.zero_poles} poles at zero, {stable}"


def modes_of(linear: LinearSystem) -> list[list[str]]:
    """Rows of the least damped modes."""
    chosen = sorted(linear.modes, key=lambda mode: mode.damping)[:MOST_MODES]
    return [
        [f"{mode.pole.real:+.4g} {mode.pole.imag:+.4g}i", f"{mode.frequency_hz:.4g}", f"{mode.damping:.4f}"]
        for mode in chosen
    ]


def _instant(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
