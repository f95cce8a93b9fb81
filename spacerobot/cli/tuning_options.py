"""Options and progress messages of tuning commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from spacerobot.cli.options import reported_at
from spacerobot.cli.output import progress, warn
from spacerobot.common.interrupts import keep

if TYPE_CHECKING:
    from pathlib import Path

    from optim import MethodOutcome, SearchProgress
    from optim.search.search import Progress
    from spacerobot.scene import Scene

Variant = Annotated[
    str | None, typer.Option("--variant", metavar="NAME", help="A variant of the tuning section.")
]
Variables = Annotated[
    str | None,
    typer.Option(
        "--variables", metavar="LIST", help="A set of the tuning section, or variables separated by commas."
    ),
]
Budget = Annotated[
    int | None,
    typer.Option("--budget", min=1, metavar="N", help="Maximum number of rollouts of one run of the GA."),
]
Runs = Annotated[
    int | None, typer.Option("--runs", min=1, metavar="N", help="Runs of each evolutionary method.")
]
Starts = Annotated[int | None, typer.Option("--starts", min=1, metavar="N", help="Starts of the NLP.")]
Seed = Annotated[
    int | None, typer.Option("--seed", min=0, metavar="N", help="Seed of the random number generator.")
]


def effort_of_ga(
    budget: int | None, runs: int | None, starts: int | None, seed: int | None
) -> dict[str, int | None]:
    """Settings in place of the tuning section's; every population-based method has the budget of the GA."""
    return {"budget": budget, "baseline_budget": budget, "runs": runs, "starts": starts, "seed": seed}


def stop_if_interrupted(outcome: MethodOutcome) -> None:
    """Print a warning and exit with code 130 if Ctrl-C interrupted the search."""
    if outcome.interrupted:
        warn("interrupted: this is the best so far")
        raise typer.Exit(130)


def journals(out: Path | None, job: str) -> Path | None:
    """Folder of the journals of a job with an output folder.

    Raises:
        ResultError: If the folder has other content; see ``spacerobot.result.check_folder``.
    """
    from spacerobot.result import JOURNALS, check_folder

    if out is None:
        return None
    check_folder(out, job)
    return out / JOURNALS


def parts(text: str | None) -> list[str] | None:
    """Names in a list separated by commas; None if there is no list."""
    return None if text is None else [part.strip() for part in text.split(",") if part.strip()]


def check_names(scene: Scene, variables: str | None, variant: str | None) -> None:
    """Check --variables and --variant, before the libraries of tuning are loaded.

    Raises:
        ScenarioError: If the scene's tuning section has no such variable, set or variant.
    """
    from optim.problem.scene_recipe import check_choices

    with reported_at("--variables"):
        check_choices(scene, variables=parts(variables) or ())
    with reported_at("--variant"):
        check_choices(scene, variants=() if variant is None else (variant,))


@contextmanager
def shown() -> Iterator[tuple[Callable[[str], None], Progress]]:
    """Show a spinner with the present step and the progress of a search.

    Yields:
        Function that shows the text of a step, and callback for the progress of a search.
    """
    with progress("reading") as tell:

        def say(words: str) -> None:
            keep(False)
            tell(words)

        def report(now: SearchProgress) -> None:
            keep()
            tell(f"searching: {now}")

        yield say, report
