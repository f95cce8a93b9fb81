"""All figures of a result, by name, and their files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath
from spacerobot.common.registry import FIGURES
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

    Args:
        results: One result, or several to compare. Figures that compare show all of them; other figures are
            drawn for each, with the suffix ``_2``, ``_3``, ... from the second result on.
        names: Names of the kinds to draw; None draws all.

    Raises:
        ResultError: If some results are planar and others spatial.
        SpaceRobotError: If there is no figure of a name.
    """
    for name in names or ():
        FIGURES.check(name)
    check_comparable(results)
    common = with_common_tips(results)
    kinds = figure_kinds()
    for kind in kinds:
        if names is not None and kind.name not in names:
            continue
        if kind.compares:
            if common and all(kind.applies(result) for result in common):
                yield kind.name, kind, kind.draw(*common)
            continue
        for k, result in enumerate(results):
            if kind.applies(result):
                yield kind.name if k == 0 else f"{kind.name}_{k + 1}", kind, kind.draw(result)


def check_comparable(results: Sequence[Result]) -> None:
    """Refuse planar results together with spatial ones, which have other axes.

    Raises:
        ResultError: If there are both.
    """
    first = results[0]
    for other in results[1:]:
        kinds = ["planar" if "body_angle" in each.data else "spatial" for each in (first, other)]
        if kinds[0] != kinds[1]:
            raise ResultError(
                f"is {kinds[1]} and cannot be compared with {first.folder or first.scenario.name}, "
                f"which is {kinds[0]}",
                source=other.folder,
            )


def with_common_tips(results: Sequence[Result]) -> tuple[Result, ...]:
    """Results with the data of the tips that all of them have, in the first one's order; none without any."""
    tips = [list(result.data.tip.values) for result in results]
    if all(tips_of_one == tips[0] for tips_of_one in tips):
        return tuple(results)
    common = [tip for tip in tips[0] if all(tip in tips_of_one for tips_of_one in tips)]
    return tuple(replace(r, data=r.data.sel(tip=common)) for r in results) if common else ()


def save_figures(
    result: Result,
    folder: StrPath,
    *others: Result,
    formats: Sequence[str] = ("pdf", "png"),
    names: Sequence[str] | None = None,
    width: str = "double",
) -> list[Path]:
    """Write all figures of a result, or of several compared, as wide as one column of a journal or two.

    Returns:
        list of paths: The files.

    Raises:
        ResultError: If a format, figure or width is not known, the results cannot be compared, or a file
            cannot be written.
    """
    with drawn_for(width):
        drawings = ((name, drawing) for name, _, drawing in draw_all(result, *others, names=names))
        written = write_drawings(drawings, Path(folder), formats)
    note_derived([each.folder for each in (result, *others)], written)
    return written
