"""``spacerobot plan``: trajectory optimisation of a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import spacerobot as sr
from spacerobot.cli.command import PLAN, Command
from spacerobot.cli.commands.animate import serve
from spacerobot.cli.options import Changes, Machines, Out, Port, ScenarioName, View, load, reported_at
from spacerobot.cli.output import print_next, progress, show, warn
from spacerobot.cli.tuning_options import parts
from spacerobot.common.errors import ScenarioError
from spacerobot.common.interrupts import advise

if TYPE_CHECKING:
    from spacerobot.api.options import PlanOptions

Backend = Annotated[
    Literal["auto", "compiled", "interpreted"],
    typer.Option(
        "--backend",
        metavar="NAME",
        help="auto, compiled or interpreted: how functions are evaluated; auto compiles if a compiler is "
        "available.",
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
        help="Sensitivities of the optimal cost to numbers of the scenario, separated by commas.",
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


@Command.of("plan", place=1, group=PLAN)
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
    numbers that `plan.design` names are chosen too: design.json, its figure, and the plan of the optimal
    design. Interrupted runs resume: repeat the same command.

    Examples:

        spacerobot plan docking --out out/plan

        spacerobot plan mine.yaml --set plan.duration=12 --out out/plan

        spacerobot plan mine.yaml --set plan.costs.time=0.1 --from out/plan --out out/faster

        spacerobot run out/plan/followed.yaml --out out/flown

        spacerobot plan mine.yaml --pareto time,base_rotation --points 9 --dask local:2 --out out/front
    """
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
    if warm_start is not None and not (warm_start.is_file() or (warm_start / "plan.nc").is_file()):
        raise ScenarioError(
            f"no plan at {warm_start}; allowed: the folder of a plan (spacerobot plan --out), or its plan.nc",
            where="--from",
        )
    scene = load(scenario, changes, "plan")
    terms, paths = parts(pareto), parts(sensitivities) or []
    if terms is not None:
        from optim.planning.studies.front_terms import check_terms

        check_terms(scene, terms)
    from optim.problem.scenario_numbers import numbers_at

    with reported_at("--sensitivities"):
        numbers_at(scene, paths)
    for warning in scene.warnings:
        warn(warning)
    if out is not None:  # where completed searches are kept
        advise("the same command resumes the search")
    with progress("formulating the problem") as tell:
        options: PlanOptions = {"backend": backend, "progress": tell, "dask": dask}
        result: sr.PlanResult | sr.ParetoFrontResult | sr.DesignStudyResult
        if design:
            result = sr.design_study(scene, out, points=points, **options)
            files = "design.json, figures/design.png and the plan of the optimal design"
        elif terms is not None:
            result = sr.pareto_front(scene, terms, out, points=points, **options)
            files = "front.json, figures/front.png and a plan for each point"
        else:
            result = sr.plan(scene, out, warm_start=warm_start, sensitivities=paths, **options)
            files = "plan.nc, plan.json, followed.yaml and figures"
        if out is not None:
            tell("drawing")
            sr.figures(result, out / "figures")
    advise("")
    show(result)
    if out is not None:
        following = "" if pareto else f"`spacerobot run {out}/followed.yaml` simulates the plan; "
        print_next(f"\n{files} in {out}; {following}`spacerobot report {out}` makes a page")
    if view and out is not None:
        serve([out], port)
