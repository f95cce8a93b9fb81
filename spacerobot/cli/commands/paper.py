"""``spacerobot paper``: every variant of the paper, compared with its figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from spacerobot.cli.command import Command
from spacerobot.cli.commands.run import warn_if_open
from spacerobot.cli.options import Out
from spacerobot.cli.output import console, progress, table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from spacerobot.paper import Variant
    from spacerobot.result import Result


LEGEND = (
    "Tip errors are reference minus position, least .. greatest over 10 s, in mm. base: the PID feeds back "
    "the velocity seen from the robot's own base; inertial: the true velocity. The paper does not say which, "
    "and states R = 0.1 m in Table 1 but 0.15 m in the text. held: both bases are held where they begin. See "
    "docs/validation/paper.md and docs/validation/planning.md."
)


@Command.of("paper", place=7)
def command(out: Out = None) -> None:
    """Run PID only and PID + amnesia, with both feedback variants and both radii; compare with the paper.

    Example:

        spacerobot paper --out out/paper
    """
    from spacerobot.paper import VARIANTS, run_variants
    from spacerobot.result import check_folder
    from spacerobot.simulation import simulate

    if out is not None:
        for variant in VARIANTS:
            check_folder(out / variant.name)
    results = []
    with progress("building the closed loop") as tell:
        for variant, result in run_variants(simulate):
            tell(f"{variant.name} done")
            results.append((variant, result.save(out / variant.name) if out is not None else result))
    console().print(comparison(results))
    console().print(f"\n{LEGEND}", markup=False)
    for _, result in results:
        warn_if_open(result)
    if out is not None:
        console().print(f"\nresults in {out}", markup=False, soft_wrap=True)


def comparison(results: Sequence[tuple[Variant, Result]]) -> object:
    """Table of the paper's figures and ours."""
    from spacerobot.paper import FIGURE_7_MM, FIGURE_10_MM, error_bands_mm, note

    headings = ["variant", "robot 1 x", "robot 1 y", "robot 2 x", "robot 2 y", "object turns", "note"]
    rows = [
        ["paper: PID only", "5", "", "", "", "visibly", "section 5; tip and axis not said"],
        ["paper: PID + amnesia", *map(_span, FIGURE_7_MM), "near zero", "Fig. 7"],
        ["paper: the same, GA-tuned", *map(_span, FIGURE_10_MM), "", "Fig. 10"],
    ]
    for variant, result in results:
        target = result.summary["target"]
        turned = "" if target is None else f"{target['max_rotation_deg']:.2g} deg"
        spans = map(_span, error_bands_mm(result.summary))
        rows.append([variant.name, *spans, turned, note(variant, result.summary)])
    return table("the paper and this toolkit [mm]", headings, rows)


def _span(band: tuple[float, float]) -> str:
    return f"{_short(band[0])} .. {_short(band[1])}"


def _short(value: float) -> str:
    return f"{value:.2f}" if abs(value) >= 0.095 else f"{value:.1g}"
