"""Tables of a comparison, from the data of ``comparison.json``, for terminals, documents and pages.

All numbers of a problem are in the units that the title of its table gives.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from optim.comparison.conclusion import lowest_of, percent
from spacerobot.common.tables import Content, Table

Data = Mapping[str, Any]
NEVER = "-"


def summary_table(data: Data) -> Table:
    """Expected running times of all problems to 1 % and 0.1 %, the lowest of each problem marked."""
    precisions = data["precisions"]
    columns = [i for i, p in enumerate(precisions) if p <= 0.01] or [0]
    names = list(dict.fromkeys(n for c in data["problems"] for n, m in c["methods"].items() if m["ranked"]))
    rows = []
    for benchmark in data["problems"]:
        for i in columns:
            best = lowest_of(benchmark, i)
            cells = []
            for name in names:
                times = benchmark["methods"].get(name, {}).get("running_times")
                cells.append((short(times[i]["expected"]) if times else "") + "*" * (name == best))
            rows.append((benchmark["name"], percent(precisions[i]), *cells))
    title = "Expected running time [rollouts] to a gap to the best known value; * lowest, - not reached"
    return Table(title, ("problem", "to", *names), tuple(rows), keys=2)


def running_time_table(benchmark: Data, precisions: list[float], *, narrow: bool = False) -> Table:
    """Table of each ranked method's expected running time and number of successful runs, for each precision.

    Args:
        benchmark: Data of one problem.
        precisions: Precisions of the targets.
        narrow: Whether the intervals of the running times are left out.
    """
    heads = [head for p in precisions for head in (f"to {percent(p)}", "met")]
    rows = []
    for name, method in benchmark["methods"].items():
        if not method["running_times"]:
            continue
        cells = [name]
        for i, time in enumerate(method["running_times"]):
            mark = "*" if lowest_of(benchmark, i) == name else ""
            expected = short(time["expected"])
            if not narrow and time["expected"] is not None:
                expected += f" ({_rough(time['low'])}..{_rough(time['high'])})"
            cells += [expected + mark, f"{time['met']}/{time['runs']}"]
        rows.append(tuple(cells))
    title = f"Expected running time [rollouts]{'' if narrow else ' (90 % interval)'}; * lowest"
    return Table(title, ("method", *heads), tuple(rows))


def success_table(benchmark: Data, precisions: list[float]) -> Table:
    """Success rate of each ranked method with its binomial interval."""
    rows = []
    for name, method in benchmark["methods"].items():
        if method["running_times"]:
            cells = [name]
            for time in method["running_times"]:
                rate = f"{time['met']}/{time['runs']} = {time['met'] / time['runs']:.2f}"
                cells.append(f"{rate} ({time['rate_low']:.2f}..{time['rate_high']:.2f})")
            rows.append(tuple(cells))
    return Table(
        "Success rate (90 % interval)", ("method", *(f"to {percent(p)}" for p in precisions)), tuple(rows)
    )


def found_table(benchmark: Data) -> Table:
    """Best objective of each method, cost of all its runs, and how the best run ended."""
    number = number_of(benchmark)
    untuned = "start" if benchmark["baseline"] is None else "untuned"
    baseline = benchmark["baseline"]
    reference: float | None = (
        benchmark["start_objective"] if baseline is None else baseline["nominal_objective"]
    )
    rows = [(untuned, number(reference), *[""] * 4)]
    for name, method in benchmark["methods"].items():
        best, used = method["best"], method["spent"]
        marks = "" if best["feasible"] else " (infeasible)"
        marks += (" (ledger open)" if best.get("open") else "") + (" (too deep)" if best.get("deep") else "")
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
    unit = benchmark["unit"]["name"]
    heads = ("method", f"best [{unit}]", "median", "cost", "time [s]", "status")
    return Table(
        "Results of all runs; cost in rollouts; time without and (with) compilation", heads, tuple(rows)
    )


def gains_table(benchmark: Data) -> Table:
    """Gains of each method's best; those at a bound are marked."""
    rows = tuple(
        (name, *(f"{v:.4g}" + "*" * (gain in best["active_bounds"]) for gain, v in best["gains"].items()))
        for name, best in ((name, method["best"]) for name, method in benchmark["methods"].items())
    )
    return Table("Gains of the best run; * at a bound", ("method", *benchmark["variables"]), rows)


def designs_table(benchmark: Data) -> Table | None:
    """Peak loads of the best designs, and their objective on other plants; None if not evaluated."""
    if benchmark["baseline"] is None:
        return None
    number, unit = number_of(benchmark), benchmark["unit"]["name"]
    designs = {"untuned": benchmark["baseline"]}
    designs |= {name: method["best"] for name, method in benchmark["methods"].items()}
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
    return Table("Best designs: peak values, and the objective on other plants", heads, tuple(rows))


def sensitivity_table(benchmark: Data) -> Table | None:
    """Table of the first-order relative change of the objective over the range of each gain, or None."""
    if benchmark["sensitivity"] is None:
        return None
    rows = tuple(
        (f"at {where}", *("" if value is None else f"{value:+.2g}" for value in across))
        for where, across in benchmark["sensitivity"]["over_range"].items()
    )
    title = "Relative change of the objective, to first order, if the gain crossed its range"
    return Table(title, ("point", *benchmark["variables"]), rows)


def tables_of(benchmark: Data, precisions: list[float], *, narrow: bool = False) -> list[Table]:
    """All tables of a problem, most important first; without intervals if the terminal is narrow."""
    rows = [
        running_time_table(benchmark, precisions, narrow=narrow),
        found_table(benchmark),
        gains_table(benchmark),
    ]
    return rows + [
        table for table in (designs_table(benchmark), sensitivity_table(benchmark)) if table is not None
    ]


def caveats(benchmark: Data) -> list[str]:
    """Warn of each best design whose ledger is open, or whose contacts are too deep."""
    sentences = []
    for name, method in benchmark["methods"].items():
        if method["best"].get("open"):
            what = "; ".join(method["best"]["open"])
            sentences.append(
                f"{benchmark['name']}: the ledger of {name}'s best is open ({what}): do not trust it"
            )
        if method["best"].get("deep"):
            what = "; ".join(method["best"]["deep"])
            sentences.append(
                f"{benchmark['name']}: bodies pass into each other in {name}'s best ({what}): do not trust it"
            )
    return sentences


def heading(benchmark: Data) -> str:
    """Summarise the problem in one line: objective, unit, best known value."""
    kind = benchmark["objective"]["kind"] if benchmark["objective"] else "objective"
    value, unit = number_of(benchmark)(benchmark["best_known"]), benchmark["unit"]["name"]
    return f"{benchmark['name']}: {kind} [{unit}], best known {value}"


def prices(benchmark: Data) -> str:
    """The cost unit of a problem in one sentence."""
    unit = benchmark["cost_unit"]
    return (
        f"One rollout is {unit['operations'] / 1e6:.3g} million operations of the generated code; with a "
        f"gradient it counts {unit['gradient']:.2f}, with a directional derivative {unit['slope']:.2f}, "
        f"with sampled outputs {unit['sample']:.2f}."
    )


LEGEND = (
    "Targets: relative gap to the best known value over all methods and runs of the problem. Expected "
    "running time: total cost of all runs divided by the number of runs that reached the target. Costs are "
    "in rollouts, of all runs together in the column cost. nlp_ga is charged all runs of the GA that it "
    "starts from. manual knows no bounds and is not ranked. Times are of this machine, under its load."
)


def comparison_content(data: Data, *, narrow: bool = False) -> list[Content]:
    """Conclusion, all problems in one table, then each problem's tables.

    Args:
        data: Content of ``comparison.json``.
        narrow: Whether running times are shown without their intervals.
    """
    content: list[Content] = [str(data["conclusion"]), summary_table(data)]
    for benchmark in data["problems"]:
        content += [heading(benchmark), prices(benchmark)]
        content += tables_of(benchmark, data["precisions"], narrow=narrow)
    content.append(LEGEND)
    return content if data["wall_s"] is None else [*content, f"{data['wall_s']:.0f} s in all"]


def markdown(data: Data) -> str:
    """A comparison as a document: the conclusion, then tables."""
    parts = [f"**{data['conclusion']}**", summary_table(data).markdown()]
    for benchmark in data["problems"]:
        parts += [f"## {heading(benchmark)}", prices(benchmark), *caveats(benchmark)]
        tables = tables_of(benchmark, data["precisions"])
        tables.insert(1, success_table(benchmark, data["precisions"]))
        parts += [f"{table.title}:\n\n{table.markdown()}" for table in tables]
    return "\n\n".join(parts) + "\n"


def number_of(benchmark: Data) -> Callable[[float | None], str]:
    """Return the function that formats a problem's objective in its unit."""
    factor = benchmark["unit"]["factor"]
    return lambda value: "diverged" if value is None else f"{factor * value:.4g}"


def short(value: float | None) -> str:
    """A cost in three digits: ``315``, ``12.3k``."""
    if value is None:
        return NEVER
    return f"{value:.0f}" if value < 999.5 else f"{value / 1e3:.3g}k" if value < 999.5e3 else f"{value:.3g}"


def _rough(value: float | None) -> str:
    """A bound of an interval in two digits."""
    return NEVER if value is None else short(float(f"{value:.2g}"))


def _plain(value: float | None, factor: float = 1.0) -> str:
    return NEVER if value is None else f"{factor * value:.3g}"
