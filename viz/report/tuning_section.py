"""Report section about a tuning: objective, gains and their bounds, and the runs of the method."""

from __future__ import annotations

from optim.tuning import FILE, TuningResult
from spacerobot.common.tables import content_html, escape
from viz.report.sections import Subject


def tuned(subject: Subject) -> str | None:
    """Tuning of each result whose folder holds one; None where none does.

    Raises:
        ResultError: If a tuning cannot be read.
    """
    parts = []
    for result, label in zip(subject.results, subject.labels, strict=True):
        if result.folder is None or not (result.folder / FILE).is_file():
            continue
        heading = f"<h3>{escape(label)}</h3>" if len(subject.labels) > 1 else ""
        parts.append(heading + content_html(TuningResult.load(result.folder).content()))
    return "".join(parts) or None
