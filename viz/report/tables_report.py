"""Report about what presents itself by tables: margins, batches, failure probabilities, gradients."""

from __future__ import annotations

from collections.abc import Iterator

from optim.evaluation import BatchResult
from spacerobot.common.tables import content_html, escape
from spacerobot.common.tabular import Tabular
from spacerobot.linear import SavedMargins
from viz.figures import to_bytes
from viz.figures.style import Drawing, line, panels, styled
from viz.report.report import ReportSection, page
from viz.report.sections import picture
from viz.report.verdict import margins_verdict

DIAGRAMS = {
    "bode": "Gain and phase of the loops with the least disk margins, each broken at its point",
    "nichols": "Gain over phase of the same loops; the least disk margin is that of the grey disk",
    "margins_along": "Disk and phase margins along the simulation",
}
"""Captions of the diagrams of margins."""
MOST_INSTANTS = 12
"""Instants, at most, about each of which a page of margins begins with a sentence."""


def tables_report(result: Tabular, title: str, source: str = "") -> str:
    """HTML of a page with the tables of a result, its warnings and its figures.

    Args:
        result: Margins, a batch, a failure probability, a gradient, ...
        title: Heading, plain text.
        source: Name of the folder or file of the result, plain text; empty for none.
    """
    # a sentence for each instant, but not for the many along a simulation, which a figure shows
    verdicts = [*result.verdict()]
    if isinstance(result, SavedMargins) and result.data.sizes["instant"] <= MOST_INSTANTS:
        verdicts = margins_verdict(result)
    notices = "".join(f"<li>{escape(text)}</li>" for text in result.notices())
    texts = {
        "warnings": ("Look at this first", f"<ul class='warnings'>{notices}</ul>" if notices else ""),
        "short": ("In short", "".join(f"<p class='outcome'>{escape(text)}</p>" for text in verdicts)),
        "numbers": ("Numbers", content_html(result.content())),
        "figures": ("Figures", "".join(picture(*drawing) for drawing in _drawings(result))),
    }
    sections = [
        (ReportSection(name, heading, lambda _: None), text)
        for name, (heading, text) in texts.items()
        if text
    ]
    return page(title, sections, source=source)


def _drawings(result: Tabular) -> Iterator[tuple[str, str, bytes]]:
    """Name, caption and SVG of each figure."""
    if isinstance(result, SavedMargins):
        for file in sorted((result.folder / "figures").glob("*.svg")):
            name, _, number = file.stem.rpartition("_")
            instants = result.data.instant.values
            is_numbered = number.isdecimal() and 0 < int(number) <= len(instants)
            caption = DIAGRAMS.get(name if is_numbered else file.stem)
            if caption:
                at = f", {instants[int(number) - 1]}" if is_numbered else ""
                yield file.stem, caption + at, file.read_bytes()
    elif isinstance(result, BatchResult):
        for quantity in map(str, result.data.data_vars):
            path, *rest = map(str, result.data[quantity].dims)
            if rest == [f"{quantity}_of"] and path != "sample":
                drawing = quantity_over(result, quantity, path)
                yield quantity, f"{quantity} over {path}", to_bytes(drawing, "svg")


@styled
def quantity_over(batch: BatchResult, name: str, path: str) -> Drawing:
    """Quantity of simulations over the one parameter that varies.

    Args:
        batch: The simulations.
        name: The quantity.
        path: Dotted path of the parameter.
    """
    figure, axes = panels(1, 1, height_in=2.8)
    values = batch.data[name].sortby(path)
    for k, label in enumerate(values[f"{name}_of"].values):
        axes[0, 0].plot(
            values[path].values, values.sel({f"{name}_of": label}).values, **line(k), marker=".", label=label
        )
    axes[0, 0].set(xlabel=path, ylabel=f"{name} [{values.attrs['units']}]")
    axes[0, 0].legend()
    return figure
