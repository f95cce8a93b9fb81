"""One look for all figures: safe for colour-blind readers and readable in grey."""

from __future__ import annotations

import functools
import io
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from spacerobot.common.errors import ResultError, near_names
from spacerobot.common.files import write_bytes
from spacerobot.result import Result
from viz.figure_formats import check_formats

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#7F7F7F")
"""Okabe and Ito's palette, in an order that alternates dark and light."""

DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 1.5, 1.5, 1.5)))
"""Line styles: what colour says, they say too."""

PAPER_FILL, PAPER_LINE = "#E8E4D8", "#8C7F5A"
"""The paper's own values, behind ours."""

WIDTHS_MM = {"single": 89.0, "double": 183.0}
"""Widths of figures in one column, and in two, of a journal's page."""

TALLEST_IN = 120 / 25.4
"""Height of the largest figure in one column, in."""

_LOWER = 0.57  # the share of a panel's height below which a single column's panels stand in more columns
_LEAST_IN = 0.8  # and the height of a panel, in, if no arrangement leaves that
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

_SMALL: Any = {
    "font.size": 7,
    "axes.titlesize": 7,
    "axes.labelsize": 7,
    "axes.titlepad": 3,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "lines.linewidth": 1.0,
}
"""Settings of a figure in one column: the smallest letters that journals take."""

P = ParamSpec("P")
T = TypeVar("T")


class Drawing(Figure):
    """A matplotlib figure that needs no display and shows itself in notebooks."""

    def _repr_png_(self) -> bytes:  # GitHub and every front end show PNG
        return to_bytes(self, "png")


def styled(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator that runs a drawing function under the common style, without changing the caller's."""

    @functools.wraps(function)
    def inside(*args: P.args, **kwargs: P.kwargs) -> T:
        with mpl.rc_context(STYLE | (_SMALL if is_narrow() else {})):
            return function(*args, **kwargs)

    return inside


@styled
def to_bytes(figure: Figure, form: str) -> bytes:
    """Bytes of a figure's file in the format ``form``, without a date, so that they are reproducible."""
    lay_out(figure)
    buffer = io.BytesIO()
    undated: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with _plain_fonts():
        figure.savefig(buffer, format=form, metadata=undated.get(form))
    return buffer.getvalue()


@styled
def lay_out(figure: Figure) -> None:
    """Set the final positions of panels and texts, as in the written files."""
    layout = figure.get_layout_engine()
    if layout is None:
        return
    # break titles and names of axes into lines that are no longer than their panels, twice: broken names of
    # axes leave titles less room
    for _ in range(2 if is_narrow() else 0):
        layout.execute(figure)
        for panel in figure.axes:
            box = panel.get_window_extent()
            titles = (panel.title, panel._left_title)  # type: ignore[attr-defined]
            for text, room in (*((title, box.width) for title in titles), (panel.yaxis.label, box.height)):
                extent, words = text.get_window_extent(), " ".join(text.get_text().split())
                longest = max(extent.width, extent.height) / room
                if words and longest > 1:
                    line = max(map(len, text.get_text().split("\n"))) / longest
                    text.set_text(textwrap.fill(words, max(8, int(line)), break_long_words=False))
    # once, and not whenever it is written: that takes longer than to draw
    layout.execute(figure)
    figure.set_layout_engine(None)


def write_drawings(
    drawings: Iterable[tuple[str, Figure]], folder: Path, formats: Sequence[str] = ("pdf", "png")
) -> list[Path]:
    """Write figures to a folder, each under its name, and return the files.

    Raises:
        ResultError: If a format is not known, or a file cannot be written.
    """
    check_formats(formats)
    written = []
    for name, drawing in drawings:
        for form in formats:
            written.append(folder / f"{name}.{form}")
            write_bytes(written[-1], to_bytes(drawing, form))
    return written


@contextmanager
def _plain_fonts() -> Iterator[None]:
    """Context in which embedded fonts omit the tables of text shaping.

    PDF readers do not use these tables, and to subset them takes most of the time.
    """
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
    """Context in which figures have one of the widths of :data:`WIDTHS_MM`.

    Figures for one column are at most 120 mm high.

    Raises:
        ResultError: If there is no such width.
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
    """A figure with panels (rows, columns).

    In a single-column figure panels are stacked if they stay high enough; otherwise the fewest columns that
    keep them high enough are used.

    Args:
        rows, columns: Numbers of rows and columns.
        height_in: Height of one row [in].
        sharex, sharey: Whether all panels share their axes; ``"col"`` for the panels of a column.
    """
    lines, across, height = rows, columns, height_in * rows + 0.5
    if is_narrow():
        # as few columns as leave panels high enough: in its own order where that has few, the other way
        # round, or one after the other
        count = rows * columns
        grids = [(columns, rows), (rows, columns), (count, 1), (-(-count // 2), 2), (-(-count // 3), 3)]
        few = sorted((grid for grid in grids if grid[1] <= 2), key=lambda grid: grid[1])
        fitting = [
            grid
            for least in (_LOWER * height_in, _LEAST_IN)
            for grid in few
            if min(height_in, (TALLEST_IN - 0.5) / grid[0]) >= least
        ]
        lines, across = (fitting or grids[-1:])[0]
        height = min(height_in * lines + 0.5, TALLEST_IN)
    figure = Drawing(figsize=(width_in(), height), layout="constrained")
    shared: dict[str, Any] = {"sharex": sharex, "sharey": sharey is True}
    axes = figure.subplots(lines, across, squeeze=False, **shared)
    if (lines, across) == (columns, rows) != (rows, columns):
        axes = axes.T
    for panel in axes.flat[rows * columns :]:
        panel.remove()
    axes = axes.flat[: rows * columns].reshape(rows, columns)
    for column in axes.T if sharey == "col" else ():
        for panel in column[1:]:
            panel.sharey(column[0])
    return figure, axes


def panel_grid(
    count: int, columns: int, *, height_in: float = 1.9, sharex: bool = False, sharey: bool = False
) -> tuple[Drawing, np.ndarray[Any, Any]]:
    """A figure with a panel for each of several things, in reading order; the rest of the last row is blank.

    Args:
        count, columns: Number of panels, and of columns at most.
        height_in, sharex, sharey: See :func:`panels`.
    """
    columns = max(1, min(columns, count))
    rows = max(1, -(-count // columns))
    figure, axes = panels(rows, columns, height_in=height_in, sharex=sharex, sharey=sharey)
    for panel in axes.flat[count:]:
        panel.set_axis_off()
    return figure, axes


def below_last(axes: np.ndarray[Any, Any]) -> None:
    """Keep labels and tick labels of horizontal axes only under the last panel of each column.

    Args:
        axes: Panels (rows, columns); those without axes are blank.
    """
    for column in axes.T:
        *others, last = [panel for panel in column if panel.axison] or [None]
        for panel in others:
            panel.set_xlabel("")
            panel.tick_params(labelbottom=False)
        if last not in (None, column[-1]):
            last.tick_params(labelbottom=True)  # hidden so far, as the axis is shared with the blank panel


def line(index: int) -> dict[str, Any]:
    """Colour and dashes of the line number ``index``."""
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": DASHES[index % len(DASHES)]}


def legend_above(figure: Figure, *axes: Axes, columns: int = 4) -> None:
    """Add one legend above all panels, with each label of the given panels once."""
    named: dict[str, Any] = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    if named:
        columns = _legend_columns(list(named), columns, width_in())
        figure.legend(list(named.values()), list(named), loc="outside upper center", ncols=columns)


def legend_over(axes: Axes, *, columns: int = 2) -> None:
    """Legend between a panel and its title, where it covers no line."""
    handles, names = axes.get_legend_handles_labels()
    place = axes.get_subplotspec()
    room = width_in() / (place.get_gridspec().ncols if place is not None else 1)
    columns = _legend_columns(names, columns, 0.85 * room)
    legend: dict[str, Any] = {
        "loc": "lower left",
        "bbox_to_anchor": (-0.02, 0.98),
        "fontsize": 7,
        "columnspacing": 0.8 if is_narrow() else 1.2,
        "handlelength": 1.4 if is_narrow() else 2.6,
    }
    # its width takes none of a narrow panel's, its height is in the title's distance
    axes.legend(ncols=columns, borderaxespad=0.2, **legend).set_in_layout(not is_narrow())
    axes.set_title(axes.get_title("left"), pad=6 + 10.5 * -(-len(handles) // columns))


def legend_beside(figure: Figure, axes: np.ndarray[Any, Any]) -> None:
    """Legend of each row at the right of its last panel; in a single column one for all above them."""
    if is_narrow():
        legend_above(figure, *axes.flat)
        return
    for panel in axes[:, -1]:
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)


def _legend_columns(names: Sequence[str], columns: int, room_in: float) -> int:
    """Columns of a legend: in one column as many as there is room for."""
    if is_narrow():
        # a handle and its margins, and each letter of 7 pt
        columns = min(columns, int(room_in / (0.42 + 0.06 * max(map(len, names), default=0))))
    return max(1, min(columns, len(names)))


def until(axes: Axes, result: Result) -> None:
    """Mark where a diverged rollout ended."""
    if result.completed:
        return
    end = float(result.data.time.values[-1])
    axes.axvline(end, color="#B00020", linewidth=0.9, linestyle=":")
    place: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "va": "top", "ha": "right"}
    axes.annotate(f" diverged after {end:.3g} s", (end, 0.98), color="#B00020", fontsize=7, **place)


def shown_axes(result: Result) -> list[str]:
    """World axes in which anything can happen."""
    return ["x", "y"] if "body_angle" in result.data else ["x", "y", "z"]
