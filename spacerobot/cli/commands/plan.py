"""``spacerobot plan``: trajectory optimisation of a scenario."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from spacerobot.cli import page_data as playing
from spacerobot.cli.command import Command
from spacerobot.cli.commands.animate import serve
from spacerobot.cli.options import Changes, Machines, Out, Port, ScenarioName, View, parse_changes
from spacerobot.cli.output import console, pairs, progress, table, warn
from spacerobot.interrupts import advise

if TYPE_CHECKING:
    from optim.planning.search.make_plan import PlanSolution
    from spacerobot.scene import Scene

Backend = Annotated[
    Literal["auto", "compiled", "interpreted"],
    typer.Option(
        "--backend",
        help="Evaluation of functions; auto compiles if a compiler is available.",
    ),
]
Pareto = Annotated[
    str | None,
    typer.Option(
        "--pareto",
        metavar="A,B",
        help="Compute the Pareto front of two cost terms, such as time,base_rotation; see --points.",
    ),
]
Sensitivities = Annotated[
    str | None,
    typer.Option(
        "--sensitivities",
        metavar="PATHS",
        help="Sensitivities of the optimal cost to numbers of the scenario; by commas.",
    ),
]
Design = Annotated[
    bool,
    typer.Option(
        "--design", help="Optimise the values of `plan.design` with the motion, and sweep each; see --points."
    ),
]
Points = Annotated[
    int, typer.Option("--points", min=2, metavar="N", help="Points of the front, or of each sweep.")
]
From = Annotated[
    Path | None,
    typer.Option(
        "--from",
        metavar="PLAN",
        help="Warm start: a plan's folder or plan.nc, of a scene of the same bodies, as the first guess.",
    ),
]


@Command.of("plan", place=13)
def command(
    scenario: ScenarioName,
    out: Out = None,
    changes: Changes = None,
    backend: Backend = "auto",
    pareto: Pareto = None,
    points: Points = 9,
    dask: Machines = None,
    sensitivities: Sensitivities = None,
    design: Design = False,
    warm_start: From = None,
    view: View = False,
    port: Port = 7000,
) -> None:
    """Solve the trajectory optimisation problem of a scenario's `plan` section, and verify the solution.

    The plan is replayed by the simulator before it is kept: plan.nc, plan.json and followed.yaml, the
    scenario that follows it. Exit code 4 if no plan passes the verification. With --pareto two cost terms
    are traded against each other: front.json, its figure, and a plan for each point. With --design the
    numbers that `plan.design` names are chosen too: design.json, its figure, and the plan of the design
    that was found. Interrupted runs resume: repeat the same command.

    Examples:

        spacerobot plan docking --out out/plan

        spacerobot plan mine.yaml --set plan.duration=12 --out out/plan

        spacerobot plan mine.yaml --set plan.costs.time=0.1 --from out/plan --out out/faster

        spacerobot run out/plan/followed.yaml --out out/flown

        spacerobot plan mine.yaml --pareto time,base_rotation --points 9 --dask local:2 --out out/front
    """
    from spacerobot.result import JOURNALS
    from spacerobot.scene import load_scene

    if view and out is None:
        raise typer.BadParameter("needs --out DIR, where the plan is written", param_hint="--view")
    if sensitivities and pareto is not None:
        raise typer.BadParameter(
            "does not go with --pareto, which makes many plans", param_hint="--sensitivities"
        )
    if view and pareto is not None:
        raise typer.BadParameter("does not go with --pareto, which makes many plans", param_hint="--view")
    if design and (pareto is not None or sensitivities):
        other = (
            "--sensitivities, which it prints itself" if sensitivities else "--pareto, which keeps the design"
        )
        raise typer.BadParameter(f"does not go with {other}", param_hint="--design")
    if warm_start is not None and (pareto is not None or design):
        raise typer.BadParameter("does not go with --pareto or --design", param_hint="--from")
    scene = load_scene(scenario, parse_changes(changes))
    for warning in scene.warnings:
        warn(warning)
    folder = None if out is None else out / JOURNALS
    if folder is not None:  # where completed searches are kept
        advise("the same command resumes the search")
    with progress("formulating the problem") as tell:
        how: dict[str, Any] = {"backend": backend, "progress": tell, "folder": folder, "dask": dask}
        if design:
            show = _design(scene, points, out, how)
        elif pareto is None:
            show = _plan(scene, out, how | {"warm_start": warm_start}, sensitivities)
        else:
            show = _front(scene, pareto, points, out, how)
    advise("")
    show()
    if view and out is not None:
        with progress("following the plan") as tell:
            played = playing.plan(out, tell)
        serve(played.data, port)


def _plan(
    scene: Scene, out: Path | None, how: dict[str, Any], sensitivities: str | None
) -> Callable[[], None]:
    """Make a plan, and write it if a folder is given; what shows it."""
    from optim.planning.output.following_scenario import PLAN, handover_warnings
    from optim.planning.output.plan_folder import FOLLOWED, SUMMARY, read, write
    from optim.planning.search.make_plan import make_plan
    from spacerobot.result import check_folder

    if out is not None:
        check_folder(out, SUMMARY)
    planned, found = make_plan(scene, **how), {}
    if sensitivities is not None:
        from optim.planning.studies.cost_sensitivities import cost_sensitivities

        found = cost_sensitivities(planned, [path.strip() for path in sensitivities.split(",")])
    if out is not None:
        from viz.figures.plan import write_plan_figures

        write(planned, out, found)
        how["progress"]("drawing")
        write_plan_figures(*read(out), out / "figures")

    def show() -> None:
        """Print it."""
        _show(planned)
        for words in handover_warnings(planned):
            warn(words)
        if found:
            rows = [[path, f"{slope:+.6g}"] for path, slope in found.items()]
            console().print(table("sensitivities of the optimal cost", ["parameter", "per unit"], rows))
        if out is not None:
            words = f"\n{PLAN}, {SUMMARY}, {FOLLOWED} and figures in {out}"
            console().print(words, markup=False, soft_wrap=True)

    return show


def _design(scene: Scene, points: int, out: Path | None, how: dict[str, Any]) -> Callable[[], None]:
    """Make a design study, likewise."""
    from optim.planning.output.plan_folder import SUMMARY, read
    from optim.planning.output.study_folder import DESIGN, to_data, write
    from optim.planning.studies.design_study import make_study
    from spacerobot.cli.design import show
    from spacerobot.result import check_folder

    if out is not None:
        check_folder(out, SUMMARY)
    study = make_study(scene, points, **how)
    if out is None:
        data = to_data(study)
    else:
        from viz.figures.design_study import study as drawn
        from viz.figures.plan import write_plan_figures
        from viz.figures.style import write_drawings

        how["progress"]("writing the design and its plan")
        data = write(study, out)
        write_drawings([("design", drawn(data))], out / "figures")
        write_plan_figures(*read(out), out / "figures")

    def shown() -> None:
        """Print it."""
        _show(study.plan)
        show(data)
        if out is not None:
            words = f"\n{DESIGN}, figures/design.png and the plan of the design that was found in {out}"
            console().print(words, markup=False, soft_wrap=True)

    return shown


def _front(
    scene: Scene, terms: str, points: int, out: Path | None, how: dict[str, Any]
) -> Callable[[], None]:
    """Make a front, likewise."""
    from optim.planning.output.front_folder import FRONT, to_data, write
    from optim.planning.studies.pareto_front import FrontRequest, make_front
    from spacerobot.cli.front import show
    from spacerobot.errors import ScenarioError
    from spacerobot.result import check_folder

    names = tuple(part.strip() for part in terms.split(","))
    if len(names) != 2:
        message = f"found {terms!r}, allowed: two terms of the cost, as time,base_rotation"
        raise ScenarioError(message, where="--pareto")
    if out is not None:
        check_folder(out, FRONT)
    front = make_front(scene, FrontRequest(names, points), **how)
    if out is None:
        data = to_data(front)
    else:
        from viz.figures.pareto_front import front as drawn
        from viz.figures.style import write_drawings

        how["progress"]("writing the plans")
        data = write(front, out)
        write_drawings([("front", drawn(data))], out / "figures")

    def shown() -> None:
        """Print it."""
        show(data)
        if out is not None:
            words = f"\n{FRONT}, figures/front.png and a plan for each point in {out}"
            console().print(words, markup=False, soft_wrap=True)

    return shown


def _show(planned: PlanSolution) -> None:
    """Print the plan, its verification, and each run of the solver."""
    from optim.planning.formulation.base_actuation import limiting_actuators
    from optim.planning.formulation.formulate import plan_section

    phased_motion, verification = planned.phased_motion, planned.verification
    order = 2 * planned.motion.lobatto.points - 2
    intervals = sum(motion.intervals for motion in phased_motion.motions)
    phases = zip(planned.names, phased_motion.motions, strict=True)
    replayed, followed = f"{verification.replay_error_m:.1e} m", f"{verification.followed_error_m:.1e} m"
    allowed = f" (allowed {verification.tolerance_m:g} m)"
    # the greatest violation between the points, in words
    if not planned.verification.violations:
        violation = "none"
    else:
        worst = planned.verification.violations[0]
        violation = f"{worst.amount:.1e} {worst.unit}, {worst.name} (allowed {worst.allowed:.1e})"
    # pairs of links that were checked, and those that needed a constraint
    apart = ", ".join(" and ".join(names) for names in planned.kept_apart)
    avoided = f"{planned.pairs} pairs of links apart" + (f", by a constraint {apart}" if apart else "")
    candidates = []
    for one in planned.candidates:
        chosen = ", ".join(f"{name} {value}" for name, value in one.chosen.items())
        candidates.append(
            (f"candidate {chosen}", one.failure if one.cost is None else f"cost {one.cost:.6g}")
        )
    rows = [
        ("duration", f"{phased_motion.duration_s:.6g} s"),
        *((f"  {name}", f"{motion.duration_s:.6g} s") for name, motion in phases if name),
        ("mesh", f"{intervals} intervals of order {order}, {len(phased_motion.unknowns)} unknowns"),
        *candidates,
        *(
            (f"base of {name}", f"within the limits of {own}")
            for name, own in limiting_actuators(
                planned.scene, plan_section(planned.scene).by_phase.values()
            ).items()
        ),
        *((("collision avoidance", avoided),) if planned.pairs else ()),
        ("cost", f"{planned.cost:.6g}"),
        *((f"  {name.replace('_', ' ')}", f"{value:.6g}") for name, value in planned.terms.items()),
        ("first-order residual", f"{verification.residual:.1e}"),
        ("second-order conditions", verification.status),
        ("replay error, open loop", replayed + (allowed if verification.open_loop else "")),
        ("  with feedback", followed + ("" if verification.open_loop else allowed)),
        ("greatest violation", violation),
    ]
    console().print(pairs(f"plan of {planned.scene.scenario.name}", rows))
    if verification.saddle:
        warn("the plan is a saddle point: nearby motions cost less; raise `plan.starts`")
    cells = [
        [
            f"{one.start + 1}",
            f"{one.intervals}",
            f"{one.cost:.6g}",
            f"{one.iterations}",
            f"{one.seconds:.3g}",
            one.status.replace("_", " ").lower(),
        ]
        for one in planned.runs
    ]
    heads = ["start", "intervals", "cost", "iterations", "time [s]", "status"]
    console().print(table("runs of IPOPT", heads, cells))
