"""One look for all figures: safe for colour-blind readers and readable in grey."""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from spacerobot.errors import ResultError, near_names
from spacerobot.files import write_bytes
from spacerobot.result import Result

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#7F7F7F")
"""Okabe and Ito's palette, in an order that alternates dark and light."""

DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 1.5, 1.5, 1.5)))
"""Line styles: what colour says, they say too."""

PAPER_FILL, PAPER_LINE = "#E8E4D8", "#8C7F5A"
"""The paper's own values, behind ours."""

WIDTHS_MM = {"single": 89.0, "double": 183.0}
"""Widths of figures in one column, and in two, of a journal's page."""

_LOWER = 0.75  # the share of a panel's height that is left where what stood side by side stands below
_width = ContextVar("width", default="double")

STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "legend.handlelength": 2.6,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "figure.dpi": 110,
    "savefig.dpi": 200,
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "spacerobot",
    "pdf.fonttype": 42,
    "text.parse_math": False,
}

P = ParamSpec("P")
T = TypeVar("T")


class Drawing(Figure):
    """A matplotlib figure that needs no display and shows itself in notebooks."""

    def _repr_svg_(self) -> str:
        return to_bytes(self, "svg").decode("utf-8")


def styled(function: Callable[P, T]) -> Callable[P, T]:
    """Run a function that draws, under the common style and without touching the caller's."""

    @functools.wraps(function)
    def inside(*args: P.args, **kwargs: P.kwargs) -> T:
        with mpl.rc_context(STYLE):
            return function(*args, **kwargs)

    return inside


@styled
def to_bytes(figure: Figure, form: str) -> bytes:
    """A figure as a file of the given kind, the same bytes whenever it is written."""
    layout = figure.get_layout_engine()
    if layout is not None:  # once, and not whenever it is written: that takes longer than to draw
        layout.execute(figure)
        figure.set_layout_engine(None)
    buffer = io.BytesIO()
    undated: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with _plain_fonts():
        figure.savefig(buffer, format=form, metadata=undated.get(form))
    return buffer.getvalue()


def write_both(drawing: Figure, folder: Path, name: str) -> None:
    """Write a figure as PDF and PNG to ``figures`` in a folder.

    Raises
    ------
    ResultError
        If a file cannot be written.
    """
    for form in ("pdf", "png"):
        write_bytes(folder / "figures" / f"{name}.{form}", to_bytes(drawing, form))


@contextmanager
def _plain_fonts() -> Iterator[None]:
    """Leave the tables that shape text out of fonts: no PDF reads them, and cutting them takes longest."""
    from fontTools.subset import Options  # by which Matplotlib embeds fonts, without a say in how

    before = Options.__dict__.get("_drop_tables_default")
    if before is not None:
        Options._drop_tables_default = [*before, "GDEF", "GPOS", "GSUB"]
    try:
        yield
    finally:
        if before is not None:
            Options._drop_tables_default = before


@contextmanager
def drawn_for(width: str) -> Iterator[None]:
    """Draw figures as wide as one of :data:`WIDTHS_MM`; texts keep their size, panels stand below each other.

    Raises
    ------
    ResultError
        If there is no such width.
    """
    if width not in WIDTHS_MM:
        raise ResultError(f"no width {width!r}; {near_names(width, WIDTHS_MM)}")
    token = _width.set(width)
    try:
        yield
    finally:
        _width.reset(token)


def width_in() -> float:
    """Width of figures now, in."""
    return WIDTHS_MM[_width.get()] / 25.4


def is_narrow() -> bool:
    """Whether figures are drawn for a single column."""
    return _width.get() == "single"


def panels(
    rows: int, columns: int, *, height_in: float = 1.9, sharex: bool = False, sharey: bool | str = False
) -> tuple[Drawing, np.ndarray[Any, Any]]:
    """A figure with panels (rows, columns); where it is narrow all stand below each other.

    Parameters
    ----------
    rows, columns
        How many.
    height_in
        Of one row, in.
    sharex, sharey
        Whether axes are the same in all panels, or ``"col"``: in those of a column.
    """
    lines, across = (rows * columns, 1) if is_narrow() else (rows, columns)
    height = height_in * (_LOWER if is_narrow() and columns > 1 else 1.0)
    figure = Drawing(figsize=(width_in(), height * lines + 0.5), layout="constrained")
    shared: dict[str, Any] = {"sharex": sharex, "sharey": sharey is True}
    axes = figure.subplots(lines, across, squeeze=False, **shared).reshape(rows, columns)
    for column in axes.T if sharey == "col" else ():
        for panel in column[1:]:
            panel.sharey(column[0])
    return figure, axes


def below_last(axes: np.ndarray[Any, Any]) -> None:
    """Keep what stands below horizontal axes only under the last panel of each column."""
    for panel in axes.flat:
        place = panel.get_subplotspec()
        if place is not None and not place.is_last_row():
            panel.set_xlabel("")
            panel.tick_params(labelbottom=False)


def line(index: int) -> dict[str, Any]:
    """Colour and dashes of the line number ``index``."""
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": DASHES[index % len(DASHES)]}


def legend_above(figure: Figure, *axes: Axes, columns: int = 4) -> None:
    """One legend for all panels, of what is drawn in these; each name stands in it once."""
    named: dict[str, Any] = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    if named:
        columns = min(1 if is_narrow() else columns, len(named))
        figure.legend(list(named.values()), list(named), loc="outside upper center", ncols=columns)


def legend_over(axes: Axes, *, columns: int = 2) -> None:
    """Legend between a panel and its title, where it covers no line."""
    handles, _ = axes.get_legend_handles_labels()
    columns = min(columns, max(1, len(handles)))
    legend: dict[str, Any] = {
        "loc": "lower left",
        "bbox_to_anchor": (-0.02, 0.98),
        "fontsize": 7,
        "columnspacing": 0.8 if is_narrow() else 1.2,
        "handlelength": 2.0 if is_narrow() else 2.6,
    }
    axes.legend(ncols=columns, borderaxespad=0.2, **legend)
    axes.set_title(axes.get_title("left"), pad=6 + 10.5 * -(-len(handles) // columns))


def until(axes: Axes, result: Result) -> None:
    """Mark where a diverged rollout ended."""
    if result.completed:
        return
    end = float(result.data.time.values[-1])
    axes.axvline(end, color="#B00020", linewidth=0.9, linestyle=":")
    axes.annotate(
        f" diverged after {end:.3g} s",
        (end, 0.98),
        xycoords=("data", "axes fraction"),
        color="#B00020",
        fontsize=7,
        va="top",
        ha="right",
    )


def labels_of(results: Sequence[Result]) -> list[str]:
    """Short names that tell results apart: their folders' names, else their scenarios', else numbers too."""
    names = [result.folder.resolve().name if result.folder else result.scenario.name for result in results]
    if len(set(names)) == len(names):
        return names
    return [f"{name} ({k})" for k, name in enumerate(names, start=1)]


def called(body: str) -> str:
    """Displayed name of a body: a robot's own name, the target as ``object``."""
    return "object" if body == "target" else body


def unit_scale(unit: str) -> tuple[float, str]:
    """Factor and unit in which people of the field read values: mm and degrees."""
    return {"m": (1e3, "mm"), "rad": (180 / np.pi, "deg"), "rad/s": (180 / np.pi, "deg/s")}.get(
        unit, (1.0, unit)
    )


def shown_axes(result: Result) -> list[str]:
    """World axes in which anything can happen."""
    return ["x", "y"] if "body_angle" in result.data else ["x", "y", "z"]
