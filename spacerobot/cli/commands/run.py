"""``spacerobot run``: simulate a scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import typer

from spacerobot.cli.command import Command
from spacerobot.cli.options import Changes, Out, Port, ScenarioName, parse_changes
from spacerobot.cli.output import console, pairs, progress, table, warn
from spacerobot.interrupts import keep

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from spacerobot.result import Result
    from spacerobot.scene import Scene
    from spacerobot.simulation import Backend as BackendName

Engine = Annotated[
    str | None, typer.Option("--engine", metavar="NAME", help="casadi or pinocchio (slow, a check).")
]
Backend = Annotated[
    Literal["auto", "compiled", "interpreted"],
    typer.Option(
        "--backend", help="Evaluation by the casadi engine; auto compiles if a compiler is available."
    ),
]
View = Annotated[
    bool,
    typer.Option("--view", help="Show the scene in the browser during the simulation, then play the result."),
]


@Command.of("run", place=1)
def command(
    scenario: ScenarioName,
    out: Out = None,
    changes: Changes = None,
    engine: Engine = None,
    backend: Backend = "auto",
    view: View = False,
    port: Port = 7000,
) -> None:
    """Simulate a scenario and print its headline numbers.

    Examples:

        spacerobot run paper --out out/paper

        spacerobot run my.yaml --set simulation.duration=20 --set 'robots.*.tips.*.amnesia=null'
    """
    from spacerobot.scene import load_scene

    pairs_given = parse_changes(changes)
    if engine is not None:
        pairs_given.append(("simulation.engine", engine))
    scene = load_scene(scenario, pairs_given)
    for warning in scene.warnings:
        warn(warning)
    if view:
        from viz.page.live import view_run

        with view_run(scene, port=port) as viewer:
            console().print(f"shown at {viewer.url} (Ctrl-C ends it)", markup=False, soft_wrap=True)
            result = run_scene(scene, out, backend, watch=viewer.tell)
            viewer.show(result)
            _conclude(scene, result)
            keep()
            viewer.wait()
    else:
        result = run_scene(scene, out, backend)
        _conclude(scene, result)
    fail_if_diverged(result)


def _conclude(scene: Scene, result: Result) -> None:
    from spacerobot.result.events import HEADINGS, event_rows
    from spacerobot.result.trust import warning as doubt_of

    shown = [*scene.warnings, doubt_of(result.summary["status"])]  # the latter at the end
    for warning in result.summary["warnings"]:
        if warning not in shown:
            warn(warning)
    kind = "planar" if scene.planar else "spatial"
    counts = (("robot", scene.robots), ("tip", scene.tips), ("grasp", scene.grasps))
    texts = (f"{len(things)} {name}{'' if len(things) == 1 else 's'}" for name, things in counts)
    about = ", ".join((kind, *texts))
    console().print(pairs(f"{result.scenario.name}: {about}", result.headline()))
    events = event_rows(result.summary.get("events", ()))
    if events:
        console().print(table("events", HEADINGS, events))
    if "mpc" in result.summary:
        # how often was planned, and how long it took against the period
        told = result.summary["mpc"]
        again = told["plans"] - 1
        missed = f", {told['missed']} without a plan" if told["missed"] else ""
        took = f"{told['median_solve_s']:.3g} s, the longest {told['longest_solve_s']:.3g} s"
        within = "delay" if told["delay_s"] else "period"
        planning = [
            ("period", f"{told['period_s']:g} s, applied {told['delay_s']:g} s after the measurement"),
            ("plans", f"{told['plans']}{missed}; the first in {told['first_solve_s']:.3g} s"),
            (
                "solution time of the others",
                f"median {took}; {told['in_time']} of {again} within the {within}",
            ),
        ]
        console().print(pairs("model predictive control", planning))
    if result.folder is not None:
        console().print(f"\nresult in {result.folder}", markup=False, soft_wrap=True)


def run_scene(
    scene: Scene,
    out: Path | None,
    backend: BackendName = "auto",
    watch: Callable[[str], None] | None = None,
) -> Result:
    """Simulate a scene with a spinner and save the result if a folder is given.

    ``watch`` is told the same words as the spinner.
    """
    from spacerobot.api.functions import simulate
    from spacerobot.result import check_folder

    if out is not None:
        check_folder(out)
    with progress("building the closed loop") as spin:

        def tell(words: str) -> None:
            """Show what begins."""
            spin(words)
            if watch is not None:
                watch(words)

        result = simulate(scene, backend=backend, progress=tell)
    return result.save(out) if out is not None else result


def fail_if_diverged(result: Result) -> None:
    """Report a diverged rollout and exit with code 3; warn where the ledger of another one is open.

    Raises
    ------
    DivergedError
        If it diverged.
    """
    from spacerobot.errors import DivergedError

    if result.completed:
        warn_if_open(result)
        return
    from spacerobot.result.table import cause_words
    from spacerobot.result.trust import fast_words

    status, step = result.summary["status"], result.summary["engine"]["step_s"]
    hint = f"; the step of {step:g} s may be too large (leave it out to have one chosen)" if step else ""
    words = fast_words(result.summary["fastest_joint"])
    fast = f"; {words}" if words else ""
    kept = f"; kept up to there in {result.folder}" if result.folder is not None else ""
    when = f"after {status['diverged_at_s']:.6g} s{cause_words(status)}"
    if status["state"] == "chattering":
        raise DivergedError(f"the rollout chattered {when}: too many events in too short a time{kept}")
    raise DivergedError(f"the rollout diverged {when}{hint}{fast}{kept}")


def warn_if_open(result: Result) -> None:
    """Warn of a result whose ledger is open."""
    from spacerobot.result.trust import warning

    doubt = warning(result.summary["status"])
    if doubt is not None:
        warn(f"{result.scenario.name}: {doubt}")
