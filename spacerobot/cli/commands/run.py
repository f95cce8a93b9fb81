"""``spacerobot run``: simulate a scenario."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import typer

import spacerobot as sr
from spacerobot.cli.command import SIMULATE, Command
from spacerobot.cli.options import Changes, Out, Port, ScenarioName, load
from spacerobot.cli.output import console, print_next, progress, show, warn
from spacerobot.common.interrupts import keep

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from spacerobot.result import Result
    from spacerobot.scene import Scene
    from spacerobot.simulation import Backend as BackendName

Engine = Annotated[
    Literal["casadi", "pinocchio"] | None,
    typer.Option("--engine", metavar="NAME", help="casadi or pinocchio (slow, a check)."),
]
Backend = Annotated[
    Literal["auto", "compiled", "interpreted"],
    typer.Option(
        "--backend",
        metavar="NAME",
        help="auto, compiled or interpreted: how the casadi engine evaluates its functions; auto chooses by "
        "the length of the simulation.",
    ),
]
View = Annotated[
    bool,
    typer.Option("--view", help="Show the scene in the browser during the simulation, then play the result."),
]
Controller = Annotated[
    str | None,
    typer.Option(
        "--controller",
        metavar="LIBRARY",
        help="Exported code as controller: a library that you built, tcp:HOST:PORT or serial:DEVICE[@BAUD].",
    ),
]


@Command.of("run", place=1, group=SIMULATE)
def command(
    scenario: ScenarioName,
    out: Out = None,
    changes: Changes = None,
    engine: Engine = None,
    backend: Backend = "auto",
    controller: Controller = None,
    view: View = False,
    port: Port = 7000,
) -> None:
    """Simulate a scenario and print its headline numbers.

    Examples:

        spacerobot run paper --out out/paper

        spacerobot run my.yaml --set simulation.duration=20 --set 'robots.*.tips.*.amnesia=null'
    """
    scene = load(scenario, [*(changes or []), *([f"simulation.engine={engine}"] if engine else [])])
    for warning in scene.warnings:
        warn(warning)
    if view:
        from viz.page.live import view_run

        with view_run(scene, port=port) as viewer:
            console().print(f"shown at {viewer.url} (Ctrl-C ends it)", markup=False, soft_wrap=True)
            result = run_scene(scene, out, backend, watch=viewer.tell, controller=controller)
            viewer.show(result)
            _conclude(scene, result)
            keep()
            viewer.wait()
    else:
        result = run_scene(scene, out, backend, controller=controller)
        _conclude(scene, result)
    fail_if_diverged(result)


def _conclude(scene: Scene, result: Result) -> None:
    from spacerobot.result.trust import warning as trust_warning

    show(result)
    printed = [*scene.warnings, trust_warning(result.summary["status"])]  # the latter at the end
    for warning in result.summary["warnings"]:
        if warning not in printed:
            warn(warning)
    if result.folder is not None:
        print_next(f"\nresult in {result.folder}; `spacerobot report {result.folder}` makes a page of it")
    else:
        print_next("\nnot saved; `--out DIR` saves the result, for `spacerobot report DIR`")


def run_scene(
    scene: Scene,
    out: Path | None,
    backend: BackendName = "auto",
    watch: Callable[[str], None] | None = None,
    controller: str | None = None,
) -> Result:
    """Simulate a scene with a spinner and save the result if a folder is given.

    Args:
        scene: The scene.
        out: Folder of the result.
        backend: As for :func:`spacerobot.simulate`.
        watch: Callback with the texts of the spinner.
        controller: As for :func:`spacerobot.simulate`.
    """
    from spacerobot.result import check_folder
    from spacerobot.result.store import check_same_scenario

    if out is not None:
        check_folder(out)
        check_same_scenario(out, scene.scenario.name)
    with progress("building the closed loop") as spin:

        def tell(words: str) -> None:
            """Show the text of a step that begins."""
            spin(words)
            if watch is not None:
                watch(words)

        result = sr.simulate(scene, backend=backend, progress=tell, controller=controller)
    return result.save(out) if out is not None else result


def fail_if_diverged(result: Result) -> None:
    """Raise an error for a diverged simulation, and print a warning if the ledger of a complete one is open.

    Raises:
        DivergedError: If the simulation diverged; the exit code is 3.
    """
    result.require_completed()
    warn_if_open(result)


def warn_if_open(result: Result) -> None:
    """Print a warning if the ledger of a result is open."""
    from spacerobot.result.trust import warning

    warning_text = warning(result.summary["status"])
    if warning_text is not None:
        warn(f"{result.scenario.name}: {warning_text}")
