"""``spacerobot campaign``: how gains do over everything that is not known."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spacerobot.cli.options import Changes, Machines, ScenarioName, Threads, parse_changes
from spacerobot.cli.output import console, progress, table, warn

if TYPE_CHECKING:
    from collections.abc import Mapping

    from optim.campaign import Evaluator
    from optim.campaign.run import Executor, Progress

Folder = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="The campaign's store; taken up again if it is there.")
]
Gains = Annotated[
    list[str] | None,
    typer.Option(
        "--gains",
        metavar="NAME[=DIR]",
        help="A set of gains: one of the scenario's campaign section, `scenario` for the scenario's own, or "
        "NAME=DIR for those of a result (spacerobot run, tune). Repeatable.",
    ),
]
Samples = Annotated[int | None, typer.Option("--samples", min=1, metavar="N", help="Number of samples.")]
Page = Annotated[
    bool, typer.Option("--report", help="Write DIR/report.html too, with the worst sample animated.")
]
MARK = {
    "": "+",
    "diverged": "D",
    "joint_torque": "T",
    "grip_force": "G",
    "tip_error": "E",
    "target_rotation_deg": "R",
    "base_rotation_deg": "B",
}
MARKS = "+ it does; D diverged; limits: T torque, G grip, E tip error, R target's, B base's rotation"
HELP = """Roll out a scenario over its uncertain numbers: percentiles, probability of failure, what matters.

Killed, it goes on where it was when it is started again with the same --out; Ctrl-C keeps what is there.

Examples:

    spacerobot campaign paper --out out/campaign --samples 10000

    spacerobot campaign paper --out out/campaign --samples 100000 --dask tcp://scheduler:8786

    spacerobot campaign paper --out out/both --gains scenario --gains tuned=out/tuned
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("campaign", help=HELP)(command)


def command(
    scenario: ScenarioName,
    out: Folder,
    changes: Changes = None,
    gains: Gains = None,
    samples: Samples = None,
    threads: Threads = None,
    dask: Machines = None,
    page: Page = False,
) -> None:
    """Run a campaign; exit code 130 after Ctrl-C, with what was found until then."""
    from optim.campaign import run_campaign, summarise
    from optim.campaign.gains import gain_sets
    from spacerobot.scene import load_scene

    given = parse_changes(changes)
    if samples is not None:
        given.append(("campaign.samples", samples))
    scene = load_scene(scenario, given)
    chosen = gain_sets(scene, gains or [])
    with progress("reading") as tell:
        found = run_campaign(
            scene,
            out,
            gains=chosen,
            executor=_executor(threads, dask),
            progress=lambda now: tell(_words(now)),
            tell=tell,
        )
        summary = None
        if found.done:
            tell("working out what it says")
            summary = summarise(out, found.evaluator, scenario, given)
        if summary is not None and page:
            tell("simulating the worst sample and writing the report")
            _write_page(out, found.evaluator, summary)
    if summary is not None:
        show(summary)
    console().print(f"\n{found.done} of {found.total} samples in {out}", markup=False, soft_wrap=True)
    if found.interrupted:
        warn("interrupted: the same command goes on where it was")
        raise typer.Exit(130)


def show(summary: Mapping[str, Any]) -> None:
    """Print what a campaign says."""
    levels = f"{100 * summary['confidence']:g} % intervals in brackets"
    head = f"{summary['name']}: {summary['samples']} samples, {summary['design']}"
    asked = f"probability of failure, {levels}" if summary["intervals"] else "share that fails"
    console().print(table(f"{head}; {asked}", *_failures(summary)))
    for name, told in summary["gains"].items():
        console().print(table(f"{name}: percentiles, {levels}", *_percentiles(told)))
        console().print(table(f"{name}: what matters", *_matters(told, summary)))
        if told["map"] is not None:
            title = f"{name}: where it holds ({MARKS})"
            console().print(table(title, *_map(told["map"], summary["parameters"])))
        worst = told["worst"][0]
        drawn = ", ".join(f"{key} {value:.6g}" for key, value in worst["draw"].items())
        line = f"{name}: worst sample, {worst['sample']}: {drawn}"
        console().print(line, markup=False, soft_wrap=True)
        console().print(f"again: {worst['command']}\n", markup=False, soft_wrap=True)
    if summary["against"]:
        console().print(table(f"on the same samples, {levels}", *_against(summary)))


Rows = tuple[list[str], list[list[str]]]


def _failures(summary: Mapping[str, Any]) -> Rows:
    causes = list(next(iter(summary["gains"].values()))["failure"])
    rows = [
        [name, *(_estimate(told["failure"][cause], "%", 100) for cause in causes)]
        for name, told in summary["gains"].items()
    ]
    return ["gains", *(f"{cause} [%]" for cause in causes)], rows


def _percentiles(told: Mapping[str, Any]) -> Rows:
    metrics = told["metrics"]
    head = ["metric", "unit", *(f"{q['percent']:g} %" for q in metrics[0]["percentiles"]), "largest"]
    rows = []
    for row in metrics:
        told_of = [_estimate(q, row["unit"]) for q in row["percentiles"]]
        largest = _number(row["largest"], _factor(row["unit"]))
        rows.append([f"{row['metric']} {row['of']}", _unit(row), *told_of, largest])
    return head, rows


def _matters(told: Mapping[str, Any], summary: Mapping[str, Any]) -> Rows:
    matters = told["matters"]
    rows = []
    for metric, entry in matters.items():
        values = entry["total"] if entry["kind"] == "sobol" else entry["value"]
        order = sorted((n for n in values if values[n] is not None), key=lambda n: -abs(values[n]))
        clear = [n for n in order if abs(values[n]) > summary["rank_noise"]]
        text = ", ".join(f"{n} {values[n]:+.2f}" for n in clear) or "nothing stands out"
        kind = "Sobol', total" if entry["kind"] == "sobol" else "rank correlation"
        rows.append([metric, kind, text + (f" ({entry['no_indices']})" if "no_indices" in entry else "")])
    return ["metric", "measure", "by size, noise left out"], rows


def _map(told: Mapping[str, Any], parameters: list[str]) -> Rows:
    head = [f"{parameters[0]} \\ {parameters[1]}", *(f"{value:.4g}" for value in told["second"])]
    rows = [
        [f"{value:.4g}", *(MARK.get(cause, "?") for cause in causes)]
        for value, causes in zip(told["first"], told["failed"], strict=True)
    ]
    return head, rows


def _against(summary: Mapping[str, Any]) -> Rows:
    rows = []
    for row in summary["against"]:
        two = [row["first"], row["second"]]
        if "fails_alone" in row:
            rows.append([*two, "fails alone", " / ".join(str(row["fails_alone"][name]) for name in two)])
        elif row["first_is_better"] is not None:
            rows.append([*two, row["metric"], _estimate(row["first_is_better"], "%", 100)])
    return ["first", "second", "metric", "first is better [%], or fails alone"], rows


def _estimate(told: Mapping[str, Any], unit: str, factor: float | None = None) -> str:
    scale = _factor(unit) if factor is None else factor
    text = _number(told["value"], scale)
    if told["low"] is None and told["high"] is None:
        return text
    return f"{text} ({_number(told['low'], scale, '..')} to {_number(told['high'], scale, '..')})"


def _number(value: float | None, factor: float, nothing: str = "diverged") -> str:
    return nothing if value is None else f"{factor * value:.4g}"


def _factor(unit: str) -> float:
    return 1e3 if unit == "m" else 1.0


def _unit(row: Mapping[str, Any]) -> str:
    return "mm" if row["unit"] == "m" else str(row["unit"])


def _write_page(folder: Path, evaluator: Evaluator, summary: Mapping[str, Any]) -> None:
    """Report of a campaign; the worst sample shown is that of the first set of gains."""
    from optim.campaign import simulate_sample
    from spacerobot.files import write_text
    from viz.campaign_section import campaign_report

    name, told = next(iter(summary["gains"].items()))
    worst = simulate_sample(evaluator, list(told["worst"][0]["draw"].values()), name)
    write_text(folder / "report.html", campaign_report(folder, worst))


def _executor(threads: int | None, dask: str | None) -> Executor:
    from optim.campaign import Here
    from optim.campaign.cluster import Dask

    if dask is not None:
        return Dask(dask)
    return Here(threads)


def _words(now: Progress) -> str:
    done = f"{now.done} of {now.total} samples, {100 * now.done / now.total:.0f} %"
    return f"{done}, {now.rate:.0f} rollouts a second, about {now.left_s:.0f} s left"
