"""Report section about a comparison of tuning methods: the conclusion, then the results and cost of each."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from optim.comparison import tables
from spacerobot.common.errors import ResultError
from spacerobot.common.tables import escape
from spacerobot.result import Result
from spacerobot.result.store import DATA
from viz.figures.comparison import PROFILES
from viz.report.report import SECTIONS, ReportSection, page, report
from viz.report.sections import picture

COMPARISON = "comparison.json"
DRAWINGS = {
    "running_times": "Expected running time to each target, with its 90 % interval",
    "convergence": "All runs of each method, from best to worst (band), and their median (line); "
    "the other methods' medians in grey; the targets dotted",
    "sensitivities": "Change of the objective across each gain's range",
    "robustness": "Objective on plants that differ from the tuned one",
}
NAME, TITLE = "comparison", "Tuning methods, compared"
PROFILE_TITLE = (
    "Data profiles: share of all problems, targets and runs that each method solved within a budget, "
    "with 90 % intervals over problems and runs"
)


def comparison_section(folder: Path) -> ReportSection:
    """Section of a report about the comparison in a folder.

    Args:
        folder: Folder that ``spacerobot compare`` wrote.

    Raises:
        ResultError: If it holds no comparison that can be shown.
    """
    text = _text(folder)
    return ReportSection(NAME, TITLE, lambda _: text)


def _text(folder: Path) -> str:
    with _whole(folder):
        data = _read(folder)
        text = f"<p class='outcome'><strong>{escape(data['conclusion'])}</strong></p>"
        text += _drawing(folder / "figures" / f"{PROFILES}.svg", PROFILES, PROFILE_TITLE)
        text += tables.summary_table(data).html()
        for benchmark in data["problems"]:
            name, precisions = benchmark["name"], data["precisions"]
            content = tables.tables_of(benchmark, precisions)
            content.insert(1, tables.success_table(benchmark, precisions))
            drawings = [
                _drawing(folder / name / "figures" / f"{kind}.svg", f"{name}-{kind}", title)
                for kind, title in DRAWINGS.items()
            ]
            unfolded = " open" if len(data["problems"]) == 1 else ""
            text += (
                f"<details class='problem'{unfolded}><summary>{escape(tables.heading(benchmark))}</summary>"
            )
            text += f"<p>{escape(tables.prices(benchmark))}</p>"
            items = "".join(f"<li>{escape(caveat)}</li>" for caveat in tables.caveats(benchmark))
            text += f"<ul class='warnings'>{items}</ul>" if items else ""
            text += content[0].html()
            text += "".join(
                [*drawings[:2], *(one.html() for one in content[1:]), *drawings[2:], "</details>"]
            )
        return text


@contextlib.contextmanager
def _whole(folder: Path) -> Iterator[None]:
    """Context that reports missing or malformed data of a comparison in one line."""
    try:
        yield
    except (OSError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as fault:
        missing = f"no {fault}" if isinstance(fault, KeyError) else str(fault)
        message = f"damaged: {missing}; run `spacerobot compare` with the same --out again"
        raise ResultError(message, source=folder / COMPARISON) from None


def comparison_report(folder: Path) -> str:
    """HTML of a report about a comparison; the first problem's untuned and best designs follow, if judged.

    Raises:
        ResultError: If the folder holds no comparison that can be shown.
    """
    section = comparison_section(folder)
    with _whole(folder):
        data = _read(folder)
        benchmark = data["problems"][0]
        ranked = {name: method for name, method in benchmark["methods"].items() if method["ranked"]}
        best = min(ranked or benchmark["methods"], key=lambda name: _objective(benchmark["methods"][name]))
        places = [folder / benchmark["name"] / name for name in ("baseline", best)]
        title = f"Tuning methods compared: {data['name']}"
    if not all((place / DATA).is_file() for place in places):
        return page(title, [(section, _text(folder))])
    results: list[Result] = [Result.load(place) for place in places]
    designs = f": {benchmark['name']}, untuned and {best}"
    rest = [
        part if part.name == "origins" else replace(part, title=f"{part.title}{designs}") for part in SECTIONS
    ]
    return report(*results, title=title, sections=[section, *rest])


def designs_of(folder: Path) -> tuple[str, dict[str, Result]]:
    """Title, and the results of the first problem that was judged, the untuned design first, the best next.

    Raises:
        ResultError: If the folder holds no comparison that can be shown, or none of its designs was judged.
    """
    with _whole(folder):
        data = _read(folder)
        benchmark = data["problems"][0]
        ranked = sorted(benchmark["methods"], key=lambda name: _objective(benchmark["methods"][name]))
        title = f"Tuning methods compared: {data['name']}, {benchmark['name']}"
        places = {name: folder / benchmark["name"] / name for name in ("baseline", *ranked)}
    results = {name: Result.load(place) for name, place in places.items() if (place / DATA).is_file()}
    if not results:
        raise ResultError(
            "no design of this comparison was evaluated, so there is no motion to play", source=folder
        )
    return title, results


def _objective(method: Mapping[str, Any]) -> float:
    best = method["objective"]["best"]
    return float("inf") if best is None else float(best)


def _read(folder: Path) -> Any:
    return json.loads((folder / COMPARISON).read_text(encoding="utf-8"))


def _drawing(file: Path, name: str, title: str) -> str:
    return picture(name, title, file.read_bytes()) if file.is_file() else ""
