"""Sections of a report: small functions from results to HTML, or to nothing where they do not apply."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spacerobot.common.tables import Table, escape
from spacerobot.result import Result
from spacerobot.result.events import event_table
from spacerobot.result.table import engine_text, status_text
from spacerobot.scenario.load import to_document, to_yaml
from spacerobot.simulation.paper import (
    AXES,
    FIGURE_7_MM,
    FIGURE_10_MM,
    PID_ONLY_MM,
    error_bands_mm,
    is_of_the_paper,
)
from viz.figures import draw_all, figure_kinds, to_bytes
from viz.figures.labels import differences, labels_of
from viz.figures.storyboard import has_instants
from viz.page.animation import notices
from viz.page.notebook import frame
from viz.page.page import animation_page
from viz.recording.record import frames
from viz.report.verdict import verdict

MOST_DIFFERENCES = 12
"""Maximum number of differing values that are shown without unfolding."""
MOST_COMPARED = 4
"""Maximum number of results in one drawing; of more only the first is drawn, and tables list all."""


@dataclass(frozen=True)
class Subject:
    """Subject of a report.

    Attributes:
        results: The results, the main one first.
        labels: Short name of each result.
    """

    results: tuple[Result, ...]
    labels: tuple[str, ...]

    @property
    def drawn(self) -> tuple[Result, ...]:
        """Results to be drawn: all, or only the first if there are too many."""
        return self.results if len(self.results) <= MOST_COMPARED else self.results[:1]


def subject_of(results: Sequence[Result]) -> Subject:
    """Subject of a report about these results."""
    return Subject(tuple(results), tuple(labels_of(results)))


def warnings(subject: Subject) -> str | None:
    """Warnings that concern the whole report."""
    items = []
    for result, label in zip(subject.results, subject.labels, strict=True):
        items += [f"{label}: {line}" for line in notices(result, result.scene())]
    return _list(items, "warnings") if items else None


def in_short(subject: Subject) -> str | None:
    """Verdict on each result, and its motion: a still picture that plays on demand."""
    lines = [
        f"<p class='outcome'>{f'<strong>{escape(label)}</strong>: ' if len(subject.labels) > 1 else ''}"
        f"{escape(verdict(result))}</p>"
        for result, label in zip(subject.results, subject.labels, strict=True)
    ]
    results = subject.results[:2] if len(subject.results) == 2 else subject.results[:1]
    return "".join(lines) + playable(animation_page(*results), [still_png(each) for each in results], 720)


def what_was_run(subject: Subject) -> str | None:
    """The scenarios, and where they differ."""
    parts = []
    for name, description in dict.fromkeys(
        (r.scenario.name, r.scenario.description) for r in subject.results
    ):
        text = f": {escape(description)}" if description else ""
        parts.append(f"<p><strong>{escape(name)}</strong>{text}</p>")
    rows = [
        [label, status_text(r.summary["status"]), engine_text(r.summary)]
        for r, label in zip(subject.results, subject.labels, strict=True)
    ]
    parts.append(table(["result", "status", "engine"], rows))
    differing = differences([to_document(result.scenario) for result in subject.results])
    if differing:
        parts.append("<h3>Where the scenarios differ</h3>")
        rows_differing = table(["path", *subject.labels], [[path, *values] for path, values in differing])
        folded = f"<details><summary>{len(differing)} values</summary>{rows_differing}</details>"
        parts.append(folded if len(differing) > MOST_DIFFERENCES else rows_differing)
    return "".join(parts)


def numbers(subject: Subject) -> str | None:
    """Headline numbers, a column for each result."""
    columns = [dict(result.headline()) for result in subject.results]
    names = dict.fromkeys(name for column in columns for name in column if name not in ("status", "engine"))
    rows = [[name, *(column.get(name, "") for column in columns)] for name in names]
    return table(["", *subject.labels], rows)


def events(subject: Subject) -> str | None:
    """Events, a table for each result that has any."""
    tables_by_result = [
        (label, event_table(result.summary["events"]).html())
        for result, label in zip(subject.results, subject.labels, strict=True)
        if result.summary.get("events")
    ]
    if len(tables_by_result) == 1 and len(subject.results) == 1:
        return tables_by_result[0][1]
    return "".join(f"<h3>{escape(label)}</h3>{rows}" for label, rows in tables_by_result) or None


def against_the_paper(subject: Subject) -> str | None:
    """Tip errors compared with the values printed in the paper, for the paper's robots."""
    ours = [
        (result, label)
        for result, label in zip(subject.results, subject.labels, strict=True)
        if is_of_the_paper(result) and result.completed
    ]
    if not ours:
        return None
    headings = ["tip error [mm]", *(f"{tip} {axis}" for tip, axis in AXES)]
    rows = [
        ["the paper, PID and amnesia (Fig. 7)", *map(_span, FIGURE_7_MM)],
        ["the paper, GA-tuned (Fig. 10)", *map(_span, FIGURE_10_MM)],
    ]
    for result, label in ours:
        row = [f"simulated: {label}"]
        # Fig. 7 shows the amnesia controller at work
        tips = [tip for robot in result.scenario.robots.values() for tip in robot.tips.values()]
        has_amnesia = all(tip.amnesia is not None for tip in tips)
        for (low, high), (least, greatest) in zip(error_bands_mm(result.summary), FIGURE_7_MM, strict=True):
            inside = least <= low and high <= greatest
            verdict = "✓ within Fig. 7" if inside else "✗ wider than Fig. 7"
            row.append(f"{_span((low, high))} {verdict if has_amnesia else ''}".strip())
        rows.append(row)
    note = (
        "<p>Errors are reference minus position, minimum .. maximum over the run. For PID alone the paper "
        f"gives {PID_ONLY_MM:g} mm (section 5) without tip and axis. Results without the amnesia controller "
        "are therefore not compared with Fig. 7. The numbers of the paper are those printed in its "
        "text.</p>"
    )
    return table(headings, rows) + note


def figures(subject: Subject) -> str | None:
    """All figures, as vectors."""
    parts = []
    if len(subject.drawn) < len(subject.results):
        parts.append(f"<p>The figures show {escape(subject.labels[0])} alone.</p>")
    # key instants replace evenly spaced ones, which would show almost the same
    even = not all(map(has_instants, subject.drawn))
    names = [kind.name for kind in figure_kinds() if even or kind.name != "docking"]
    for name, kind, drawing in draw_all(*subject.drawn, names=names):
        single = not kind.compares and len(subject.drawn) > 1
        which = int(name.removeprefix(f"{kind.name}_")) - 1 if name != kind.name else 0
        title = f"{kind.title}: {subject.labels[which]}" if single else kind.title
        if kind.printed and is_of_the_paper(subject.drawn[which]):
            title += f" (the paper's {kind.printed})"
        parts.append(picture(name, title, to_bytes(drawing, "svg")))
    return "".join(parts)


def ledger(subject: Subject) -> str | None:
    """Momentum and energy, in numbers."""
    rows: list[list[str]] = []
    for result, label in zip(subject.results, subject.labels, strict=True):
        momentum: Mapping[str, Any] = result.summary["ledger"]["momentum"]
        energy: Mapping[str, Any] = result.summary["ledger"]["energy"]
        names = ("actuator_work_j", "stored_change_j", "joint_loss_j", "grasp_loss_j", "constraint_work_j")
        numbers = [f"{energy[name]:.4g}" for name in names]
        balance = [*numbers, f"{energy['largest_residual_j']:.2g} ({energy['relative_residual']:.1g})"]
        if momentum["conserved"]:
            drifts = [
                f"{momentum[kind][f'drift_{unit}']:.2g} {text} ({momentum[kind]['relative_drift']:.1g})"
                for kind, unit, text in (("linear", "n_s", "N s"), ("angular", "n_m_s", "N m s"))
            ]
        else:
            drifts = [f"not conserved: {momentum['reason']}"] * 2
        rows.append([label, *drifts, *balance])
    headings = ["result", "linear momentum drift", "angular momentum drift", "actuators put in [J]"]
    headings += ["stored [J]", "joints took [J]", "grips took [J]", "rigid grasps put in [J]", "open [J]"]
    note = (
        "<p>Drifts are the greatest change of the total since the start and, in brackets, that relative to "
        "the largest momentum of a single body; impulse from outside is taken off. Energy: what is put in is "
        "stored, or taken by joints and grips; the greatest difference stays open.</p>"
    )
    # a column for each result, as of the headline numbers: a narrow page shows them without scrolling
    first, *columns = zip(headings, *rows, strict=True)
    return table(["", *first[1:]], columns) + note


def assumptions(subject: Subject) -> str | None:
    """Assumptions about values that the scenario leaves open, those common to all results first."""
    lists = [list(result.summary["assumptions"]) for result in subject.results]
    shared = [line for line in lists[0] if all(line in other for other in lists)]
    parts = [_list(shared, "assumptions")]
    for label, lines in zip(subject.labels, lists, strict=True):
        lines_of_result = [line for line in lines if line not in shared]
        if lines_of_result:
            parts.append(f"<h3>{escape(label)} alone</h3>{_list(lines_of_result, 'assumptions')}")
    return "".join(parts)


def origins(subject: Subject) -> str | None:
    """Versions, descriptions and resolved scenarios, from which the results can be reproduced."""
    parts = []
    for result, label in zip(subject.results, subject.labels, strict=True):
        rows = [[name, version] for name, version in result.summary["versions"].items()]
        rows += [[f"{body}, sha256 of its URDF", sha] for body, sha in result.summary["urdf_sha256"].items()]
        parts.append(f"<h3>{escape(label)}</h3>{table(['', ''], rows)}")
        yaml = escape(to_yaml(result.scenario))
        parts.append(f"<details><summary>resolved scenario</summary><pre>{yaml}</pre></details>")
    return "".join(parts)


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """HTML table of plain texts, escaped."""
    return Table(None, headings, rows).html()


def picture(name: str, title: str, svg: bytes) -> str:
    """HTML of a drawing with its title; ``name`` is its anchor, empty for none."""
    source = f"data:image/svg+xml;base64,{base64.b64encode(svg).decode('ascii')}"
    # on a narrow page the drawing fits the width, and is enlarged, and scrolls, when it is clicked
    box = f'<input type="checkbox" aria-label="Enlarge: {escape(title)}">'
    image = f'<label class="drawing">{box}<img alt="{escape(title)}" src="{source}"></label>'
    anchor = f' id="{escape(name)}"' if name else ""
    return f"<figure{anchor}><div class='wide'>{image}</div><figcaption>{escape(title)}</figcaption></figure>"


def still_png(result: Result, size_px: tuple[int, int] = (900, 540)) -> bytes:
    """Picture of a result at its first capture, or in the middle, by the built-in renderer."""
    end = float(result.data.time.values[-1])
    captures = [e["time_s"] for e in result.summary.get("events", ()) if e["kind"] == "captured"]
    pictures = frames(result, rate_hz=200.0 / max(end, 1e-9), size_px=size_px)
    index = int(np.abs(pictures.motion.time - min(captures, default=end / 2)).argmin())
    buffer = io.BytesIO()
    pictures.picture(index).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def playable(page: str, stills: Sequence[bytes], height_px: int) -> str:
    """HTML of still pictures that are replaced by an animated page when clicked.

    Printed pages show the stills.

    No script is needed: the frame of a box that is not ticked is not displayed, and a frame that is loaded
    lazily is not loaded before it is displayed.

    Args:
        page: HTML of the animated page; it plays when it is loaded.
        stills: Pictures, PNG.
        height_px: Height of the frame.
    """
    images = "".join(
        f'<img alt="the scene" src="data:image/png;base64,{base64.b64encode(one).decode("ascii")}">'
        for one in stills
    )
    return (
        '<div class="playable"><label><input type="checkbox" aria-label="Play the animation">'
        f"<span>&#9654; play</span>{images}</label>{frame(page, height_px)}</div>"
    )


def _list(items: Sequence[str], name: str) -> str:
    return f"<ul class='{name}'>" + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>"


def _span(band: tuple[float, float]) -> str:
    return f"{band[0]:.3g} .. {band[1]:.3g}"
