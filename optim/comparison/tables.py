"""A comparison, as it stands in ``comparison.json``, as tables for terminals, documents and pages.

All numbers of one contest are in the units that its title names, the same everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from optim.comparison.conclusion import lowest_of, percent

Data = Mapping[str, Any]
NEVER = "-"


@dataclass(frozen=True)
class TextTable:
    """Rows of text.

    Attributes
    ----------
    title
        What it shows.
    headings
        One for each column.
    rows
        As many cells each.
    """

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def summary_table(data: Data) -> TextTable:
    """Expected running times of all contests to 1 % and 0.1 %, the lowest of each contest marked."""
    precisions = data["precisions"]
    shown = [i for i, p in enumerate(precisions) if p <= 0.01] or [0]
    names = list(dict.fromkeys(n for c in data["contests"] for n, m in c["methods"].items() if m["ranked"]))
    rows = []
    for contest in data["contests"]:
        for i in shown:
            best = lowest_of(contest, i)
            cells = [_expected(contest["methods"].get(name), i) + "*" * (name == best) for name in names]
            rows.append((contest["name"], percent(precisions[i]), *cells))
    title = "Expected running time [rollouts] to a gap to the best known value; * lowest, - not reached"
    return TextTable(title, ("problem", "to", *names), tuple(rows))


def running_time_table(contest: Data, precisions: list[float], *, narrow: bool = False) -> TextTable:
    """Expected running time of each ranked method, its interval unless narrow, and how many runs met it."""
    heads = [head for p in precisions for head in (f"to {percent(p)}", "met")]
    rows = []
    for name, method in contest["methods"].items():
        if not method["running_times"]:
            continue
        cells = [name]
        for i, time in enumerate(method["running_times"]):
            mark = "*" if lowest_of(contest, i) == name else ""
            expected = short(time["expected"]) if narrow else _with_interval(time)
            cells += [expected + mark, f"{time['met']}/{time['runs']}"]
        rows.append(tuple(cells))
    title = f"Expected running time [rollouts]{'' if narrow else ' (90 % interval)'}; * lowest"
    return TextTable(title, ("method", *heads), tuple(rows))


def success_table(contest: Data, precisions: list[float]) -> TextTable:
    """Success rate of each ranked method with its binomial interval."""
    rows = tuple(
        (name, *(_rate(time) for time in method["running_times"]))
        for name, method in contest["methods"].items()
        if method["running_times"]
    )
    return TextTable(
        "Success rate (90 % interval)", ("method", *(f"to {percent(p)}" for p in precisions)), rows
    )


def found_table(contest: Data) -> TextTable:
    """What each method found, what all its runs spent, and how the best one ended."""
    number = number_of(contest)
    rows = [(_untuned(contest), number(_untuned_objective(contest)), *[""] * 4)]
    for name, method in contest["methods"].items():
        best, used = method["best"], method["spent"]
        marks = ("" if best["feasible"] else " (infeasible)") + (" (ledger open)" if best.get("open") else "")
        rows.append(
            (
                name,
                number(best["objective"]) + marks,
                number(method["objective"]["median"]),
                short(used["equivalent_rollouts"]),
                f"{used['wall_s']:.1f} ({used['wall_with_compilation_s']:.1f})",
                best["status"],
            )
        )
    unit = contest["unit"]["name"]
    heads = ("method", f"best [{unit}]", "median", "spent", "time [s]", "ended")
    return TextTable(
        "Found by all runs; spent in rollouts; time without and (with) compiling", heads, tuple(rows)
    )


def gains_table(contest: Data) -> TextTable:
    """Gains of each method's best; those at a bound are marked."""
    rows = tuple(
        (name, *(_gain(best, gain) for gain in best["gains"]))
        for name, best in ((name, method["best"]) for name, method in contest["methods"].items())
    )
    return TextTable("Gains of the best run; * at a bound", ("method", *contest["variables"]), rows)


def designs_table(contest: Data) -> TextTable | None:
    """Loads of the best designs, and their objective on other plants; None if they were not judged."""
    if contest["baseline"] is None:
        return None
    number, unit = number_of(contest), contest["unit"]["name"]
    designs = {"untuned": contest["baseline"]}
    designs |= {name: method["best"] for name, method in contest["methods"].items()}
    rows = []
    for name, design in designs.items():
        other, peaks = design["other_plants"], design["peaks"]
        lost = f", {other['diverged']} diverged" if other["diverged"] else ""
        rows.append(
            (
                name,
                _plain(peaks.get("tip_error_peak"), 1e3),
                _plain(peaks.get("joint_torque_peak")),
                _plain(peaks.get("grip_force_peak")),
                number(other["objective"]["median"]),
                number(other["objective"]["worst"]) + lost,
            )
        )
    heads = ("design", "error [mm]", "torque [N m]", "grip [N]", f"other plants [{unit}]", "worst")
    return TextTable(
        "The best designs: largest values, and the objective on other plants", heads, tuple(rows)
    )


def sensitivity_table(contest: Data) -> TextTable | None:
    """Relative change of the objective, to first order, if a gain crossed its range; None if unknown."""
    if contest["sensitivity"] is None:
        return None
    rows = tuple(
        (f"at {where}", *("" if value is None else f"{value:+.2g}" for value in across))
        for where, across in contest["sensitivity"]["over_range"].items()
    )
    title = "Relative change of the objective, to first order, if the gain crossed its range"
    return TextTable(title, ("point", *contest["variables"]), rows)


def tables_of(contest: Data, precisions: list[float], *, narrow: bool = False) -> list[TextTable]:
    """All tables of a contest, most important first; without intervals if the terminal is narrow."""
    made = [
        running_time_table(contest, precisions, narrow=narrow),
        found_table(contest),
        gains_table(contest),
    ]
    return made + [
        table for table in (designs_table(contest), sensitivity_table(contest)) if table is not None
    ]


def doubts(contest: Data) -> list[str]:
    """One sentence for each best design whose ledger is open."""
    told = []
    for name, method in contest["methods"].items():
        if method["best"].get("open"):
            what = "; ".join(method["best"]["open"])
            told.append(f"{contest['name']}: the ledger of {name}'s best is open ({what}): do not trust it")
    return told


def heading(contest: Data) -> str:
    """One line on what is compared: objective, unit, best known value."""
    kind = contest["objective"]["kind"] if contest["objective"] else "objective"
    value, unit = number_of(contest)(contest["best_known"]), contest["unit"]["name"]
    return f"{contest['name']}: {kind} [{unit}], best known {value}"


def prices(contest: Data) -> str:
    """The currency of a contest in one sentence."""
    found = contest["currency"]
    return (
        f"One rollout is {found['operations'] / 1e6:.3g} million operations of the generated code; with a "
        f"gradient it counts {found['gradient']:.2f}, with a slope along one direction {found['slope']:.2f}, "
        f"with samples of its outputs {found['sample']:.2f}."
    )


def markdown(data: Data) -> str:
    """A comparison as a document: the verdict, then tables."""
    parts = [f"**{data['verdict']}**", as_markdown(summary_table(data))]
    for contest in data["contests"]:
        parts += [f"## {heading(contest)}", prices(contest), *doubts(contest)]
        tables = tables_of(contest, data["precisions"])
        tables.insert(1, success_table(contest, data["precisions"]))
        parts += [f"{table.title}:\n\n{as_markdown(table)}" for table in tables]
    return "\n\n".join(parts) + "\n"


def as_markdown(table: TextTable) -> str:
    """A table of a document."""
    rows = [table.headings, ("---",) * len(table.headings), *table.rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)


def number_of(contest: Data) -> Callable[[float | None], str]:
    """How a contest's objective is written, in its unit."""
    factor = contest["unit"]["factor"]
    return lambda value: "diverged" if value is None else f"{factor * value:.4g}"


def short(value: float | None) -> str:
    """A cost in three digits: ``315``, ``12.3k``."""
    if value is None:
        return NEVER
    return f"{value:.0f}" if value < 999.5 else f"{value / 1e3:.3g}k" if value < 999.5e3 else f"{value:.3g}"


def _rough(value: float | None) -> str:
    """A bound of an interval in two digits."""
    return NEVER if value is None else short(float(f"{value:.2g}"))


def _expected(method: Data | None, target: int) -> str:
    if method is None or not method["running_times"]:
        return ""
    return short(method["running_times"][target]["expected"])


def _with_interval(time: Data) -> str:
    if time["expected"] is None:
        return NEVER
    return f"{short(time['expected'])} ({_rough(time['low'])}..{_rough(time['high'])})"


def _rate(time: Data) -> str:
    rate = time["met"] / time["runs"]
    return f"{time['met']}/{time['runs']} = {rate:.2f} ({time['rate_low']:.2f}..{time['rate_high']:.2f})"


def _untuned(contest: Data) -> str:
    return "start" if contest["baseline"] is None else "untuned"


def _untuned_objective(contest: Data) -> float | None:
    baseline = contest["baseline"]
    found: float | None = contest["start_objective"] if baseline is None else baseline["nominal_objective"]
    return found


def _gain(best: Data, name: str) -> str:
    return f"{best['gains'][name]:.4g}" + "*" * (name in best["active_bounds"])


def _plain(value: float | None, factor: float = 1.0) -> str:
    return NEVER if value is None else f"{factor * value:.3g}"
