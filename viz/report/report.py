"""One self-contained page about one or several results."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath, write_text
from spacerobot.common.tables import escape
from spacerobot.result import Result, note_derived
from spacerobot.result.store import SUMMARY
from viz.figures.collect import check_comparable
from viz.page.page import fill, policy
from viz.report import sections as parts
from viz.report.tuning_section import tuned


@dataclass(frozen=True)
class ReportSection:
    """A part of a report.

    Attributes:
        name: Name of its anchor.
        title: Its heading.
        body: Function that returns its HTML, or None where it does not apply. Texts from files must be
            escaped, as :func:`spacerobot.common.tables.escape` does.
    """

    name: str
    title: str
    body: Callable[[parts.Subject], str | None]


SECTIONS = (
    ReportSection("warnings", "Look at this first", parts.warnings),
    ReportSection("verdict", "In short", parts.in_short),
    ReportSection("numbers", "Headline numbers", parts.numbers),
    ReportSection("tuning", "Tuning", tuned),
    ReportSection("events", "Events", parts.events),
    ReportSection("run", "What was run", parts.what_was_run),
    ReportSection("paper", "Against the paper", parts.against_the_paper),
    ReportSection("figures", "Figures", parts.figures),
    ReportSection("ledger", "Ledger", parts.ledger),
    ReportSection("assumptions", "Assumptions", parts.assumptions),
    ReportSection("origins", "Versions and scenarios", parts.origins),
)
"""Sections of every report, in order."""


def report(*results: Result, title: str | None = None, sections: Sequence[ReportSection] = SECTIONS) -> str:
    """HTML of a report; it needs no network and prints well.

    Args:
        results: Results to be reported, the main one first.
        title: Heading; the name of the scenario, and the names of several results, if None.
        sections: Sections of the report; other packages may add theirs.

    Raises:
        ResultError: If the results cannot be compared.
    """
    check_comparable(results)
    subject = parts.subject_of(results)
    bodies = [(section, section.body(subject)) for section in sections]
    written_sections = [(section, body) for section, body in bodies if body is not None]
    folder = results[0].folder if len(results) == 1 else None
    return page(title or _heading(subject), written_sections, source=folder.resolve().name if folder else "")


def _heading(subject: parts.Subject) -> str:
    """Name of the scenario that all results have in common, and the labels of several results."""
    labels = " · ".join(subject.labels[:4]) + (" · ..." if len(subject.labels) > 4 else "")
    names = {result.scenario.name for result in subject.results}
    is_named = len(names) > 1 or subject.labels[0].startswith(min(names))
    return labels if is_named else f"{min(names)}: {labels}"


def page(heading: str, sections: Sequence[tuple[ReportSection, str]], *, source: str = "") -> str:
    """HTML of a page of sections with a heading, its figures numbered; it needs no network and prints well.

    Args:
        heading: Plain text.
        sections: Each with its HTML.
        source: Name of the folder or file that the page reports, plain text; empty for none.
    """
    links = "".join(f'<a href="#{s.name}">{escape(s.title)}</a>' for s, _ in sections)
    text = "".join(
        f'<section id="{s.name}"><h2>{escape(s.title)}</h2>{body}</section>' for s, body in sections
    )
    count = itertools.count(1)
    text = re.sub("<figcaption>", lambda match: f"{match[0]}Figure {next(count)}. ", text)
    web = files("viz") / "web"
    return fill(
        (web / "report.html").read_text(encoding="utf-8"),
        {
            "policy": policy(),
            "title": escape(f"{heading} ({source})" if source else heading),
            "heading": escape(heading),
            "source": f" of {escape(source)}" if source else "",
            "style": (web / "report.css").read_text(encoding="utf-8"),
            "links": links,
            "sections": text,
        },
    )


def write_report(result: Result, path: StrPath, *others: Result, title: str | None = None) -> None:
    """Write the page of :func:`report` about a result, or about several compared.

    Raises:
        ResultError: If the file cannot be written or the results cannot be compared.
    """
    write_text(path, report(result, *others, title=title))
    note_derived([each.folder for each in (result, *others)], [path])


def find_results(folders: Sequence[StrPath]) -> list[Result]:
    """Results in folders: each is one, or holds several.

    Raises:
        ResultError: If a folder holds none, or one cannot be read.
    """
    results = []
    for folder in map(Path, folders):
        inside = sorted(path.parent for path in folder.glob(f"*/{SUMMARY}")) if folder.is_dir() else []
        if (folder / SUMMARY).exists() or not inside:
            inside = [folder]
        results += [Result.load(path) for path in inside]
    if not results:
        raise ResultError("no results named")
    return results
