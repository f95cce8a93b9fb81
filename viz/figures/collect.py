"""All figures of a result, by name, and their files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from spacerobot.errors import ResultError, near_names
from spacerobot.files import StrPath
from spacerobot.registry import FIGURES
from spacerobot.result import Result, note_derived
from viz.figures.kind import FigureKind
from viz.figures.style import Drawing, drawn_for, write_drawings


def figure_kinds() -> tuple[FigureKind, ...]:
    """Every kind of figure that a single result can show, in the order a reader wants them."""
    return tuple(FIGURES.entries().values())


def draw_all(
    *results: Result, names: Sequence[str] | None = None
) -> Iterator[tuple[str, FigureKind, Drawing]]:
    """File name, kind and drawing of every figure.

    Parameters
    ----------
    results
        One, or several to compare. Figures that compare show all of them; the others are drawn of each, from
        the second on with ``_2`` and so on behind their names.
    names
        Names of the kinds wanted; all if not given.

    Raises
    ------
    ResultError
        If there is no figure of a wanted name, or the results have different tips.
    """
    check_comparable(results)
    known = figure_kinds()
    for name in names or ():
        if all(kind.name != name for kind in known):
            raise ResultError(f"no figure {name!r}; {near_names(name, [kind.name for kind in known])}")
    for kind in known:
        if names is not None and kind.name not in names:
            continue
        if kind.compares:
            if all(kind.applies(result) for result in results):
                yield kind.name, kind, kind.draw(*results)
            continue
        for k, result in enumerate(results):
            if kind.applies(result):
                yield kind.name if k == 0 else f"{kind.name}_{k + 1}", kind, kind.draw(result)


def check_comparable(results: Sequence[Result]) -> None:
    """Refuse results that cannot be drawn over each other.

    Raises
    ------
    ResultError
        If their tips or axes differ.
    """
    first = results[0]
    for other in results[1:]:
        same_tips = list(first.data.tip.values) == list(other.data.tip.values)
        same_kind = ("body_angle" in first.data) == ("body_angle" in other.data)
        if not (same_tips and same_kind):
            raise ResultError(
                f"cannot be compared with {first.folder or first.scenario.name}: other tips or dimensions",
                source=other.folder,
            )


def save_figures(
    result: Result,
    folder: StrPath,
    *others: Result,
    formats: Sequence[str] = ("pdf", "png"),
    names: Sequence[str] | None = None,
    width: str = "double",
) -> list[Path]:
    """Write all figures of a result, or of several compared, as wide as one column of a journal or two.

    Returns
    -------
    list of paths
        The files.

    Raises
    ------
    ResultError
        If a format, figure or width is not known, the results cannot be compared, or a file cannot be
        written.
    """
    with drawn_for(width):
        drawings = ((name, drawing) for name, _, drawing in draw_all(result, *others, names=names))
        written = write_drawings(drawings, Path(folder), formats)
    note_derived([each.folder for each in (result, *others)], written)
    return written
