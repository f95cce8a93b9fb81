"""``spacerobot plan``: plan the motion that a scenario asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import typer

from spacerobot.cli.options import Changes, Out, ScenarioName, parse_changes
from spacerobot.cli.output import console, pairs, progress, table, warn

if TYPE_CHECKING:
    from optim.planning.make import Planned

Backend = Annotated[
    Literal["auto", "compiled", "interpreted"],
    typer.Option("--backend", help="How the problem's functions are evaluated; auto compiles where it can."),
]
HELP = """Plan the motion that a scenario's `plan` section asks for, and judge it.

The plan is replayed by the simulator before it is kept: plan.nc, plan.json and followed.yaml, the scenario
that follows it. Exit code 4 where no plan was found that holds.

Examples:

    spacerobot plan docking_planned --out out/plan

    spacerobot plan mine.yaml --set plan.duration=12 --out out/plan

    spacerobot run out/plan/followed.yaml --out out/flown
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("plan", help=HELP)(command)


def command(
    scenario: ScenarioName,
    out: Out = None,
    changes: Changes = None,
    backend: Backend = "auto",
) -> None:
    """Plan, print what was found, and write it if a folder is given."""
    from optim.planning.make import make_plan
    from optim.planning.plan_file import FOLLOWED, PLAN, SUMMARY, check_plan_folder, write
    from spacerobot.scene import load_scene

    scene = load_scene(scenario, parse_changes(changes))
    for warning in scene.warnings:
        warn(warning)
    if out is not None:
        check_plan_folder(out)
    with progress("formulating the problem") as tell:
        planned = make_plan(scene, backend=backend, progress=tell)
        if out is not None:
            tell("writing the plan")
            write(planned, out)
    _show(planned)
    if out is not None:
        console().print(f"\n{PLAN}, {SUMMARY} and {FOLLOWED} in {out}", markup=False, soft_wrap=True)


def _show(planned: Planned) -> None:
    """Print the plan's numbers, its verdict, and what each run of the solver took."""
    motion, verdict = planned.motion, planned.verdict
    order = 2 * motion.lobatto.points - 2
    rows = [
        ("duration", f"{motion.duration_s:.6g} s"),
        ("mesh", f"{motion.intervals} intervals of order {order}, {len(motion.unknowns)} unknowns"),
        ("cost", f"{planned.cost:.6g}"),
        *((f"  {name.replace('_', ' ')}", f"{value:.6g}") for name, value in planned.terms.items()),
        ("first-order residual", f"{verdict.residual:.1e}"),
        ("replay error", f"{verdict.replay_error_m:.1e} m (allowed {verdict.tolerance_m:g} m)"),
        ("greatest violation", _violation(planned)),
    ]
    console().print(pairs(f"plan of {planned.scene.scenario.name}", rows))
    cells = [
        [
            f"{one.start + 1}",
            f"{one.intervals}",
            f"{one.cost:.6g}",
            f"{one.solved.iterations}",
            f"{one.solved.seconds:.3g}",
            one.solved.status.replace("_", " ").lower(),
        ]
        for one in planned.solves
    ]
    heads = ["start", "intervals", "cost", "iterations", "time [s]", "status"]
    console().print(table("runs of IPOPT", heads, cells))


def _violation(planned: Planned) -> str:
    """The greatest violation between the points, in words."""
    if not planned.verdict.violations:
        return "none"
    worst = planned.verdict.violations[0]
    return f"{worst.amount:.1e} {worst.unit}, {worst.name} (allowed {worst.allowed:.1e})"
