"""All figures of a result, by name, and their files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from spacerobot.errors import ResultError, near_names
from spacerobot.files import StrPath, write_bytes
from spacerobot.result import Result, note_derived
from viz.figures.approach import approach
from viz.figures.base_actuation import acting_bases, base_control, relative_orbit
from viz.figures.bodies import base_motion, grip_forces, object_motion
from viz.figures.contacts import contact_forces
from viz.figures.docking import docking
from viz.figures.joints import joints
from viz.figures.ledger import ledger
from viz.figures.storyboard import storyboard
from viz.figures.style import Drawing, drawn_for, to_bytes
from viz.figures.tips import orientation_errors, tip_errors, tip_paths
from viz.figures.wheels import momentum_budget, wheels

FORMATS = ("pdf", "svg", "png")
"""Kinds of files a figure can be written as."""


@dataclass(frozen=True)
class FigureKind:
    """A kind of figure.

    Attributes
    ----------
    name
        Of its files.
    title
        What it shows, for people.
    draw
        Draws it from one result, or from several if it compares.
    compares
        Whether it takes several results.
    applies
        Whether a result has what it shows.
    printed
        Figure of the paper that shows the same of the paper's robots, if any.
    """

    name: str
    title: str
    draw: Callable[..., Drawing]
    compares: bool = False
    applies: Callable[[Result], bool] = lambda _: True
    printed: str = ""


def _leads_tips(result: Result) -> bool:
    return bool(result.led_tips)


def _controls_orientation(result: Result) -> bool:
    tips = (tip for robot in result.scenario.robots.values() for tip in robot.tips.values())
    return any(tip.orientation_pid is not None for tip in tips)


def _may_touch(result: Result) -> bool:
    return "contact" in result.data.dims


def _has_wheels(result: Result) -> bool:
    return "wheel" in result.data.dims


def _is_caught(result: Result) -> bool:
    return any(grasp.begins == "open" for grasp in result.scenario.grasps.values())


def _has_target(result: Result) -> bool:
    return result.scenario.target is not None


KINDS = (
    FigureKind("tip_paths", "Reference and actual tip paths", tip_paths, True, _leads_tips, "Fig. 5"),
    FigureKind(
        "object_motion", "Object rotation and translation", object_motion, True, _has_target, "Fig. 6"
    ),
    FigureKind("tip_errors", "Tip errors", tip_errors, True, _leads_tips, "Fig. 7 and 10"),
    FigureKind(
        "orientation_errors", "Orientation errors of tips", orientation_errors, True, _controls_orientation
    ),
    FigureKind("docking", "The motion, frame by frame", docking, printed="Fig. 8"),
    FigureKind("storyboard", "The instants that tell the motion: phases, captures, releases", storyboard),
    FigureKind(
        "approach",
        "The approach: lateral error and speeds over the distance to go",
        approach,
        applies=_is_caught,
    ),
    FigureKind("base_motion", "Motion of the bases", base_motion),
    FigureKind(
        "joints", "Joint angles and actuator torques", joints, applies=lambda r: bool(r.data.sizes["joint"])
    ),
    FigureKind("grip_forces", "Grip forces", grip_forces, applies=lambda r: bool(r.data.sizes["grasp"])),
    FigureKind("contact_forces", "Contact forces and gaps", contact_forces, applies=_may_touch),
    FigureKind(
        "base_control",
        "Attitude errors of bases, and what their actuators do",
        base_control,
        applies=lambda r: bool(acting_bases(r)),
    ),
    FigureKind(
        "relative_orbit",
        "Motion relative to the reference orbit",
        relative_orbit,
        applies=lambda r: "hill_position" in r.data,
    ),
    FigureKind("wheels", "Reaction wheels: speeds and torques", wheels, applies=_has_wheels),
    FigureKind(
        "momentum_budget",
        "Where the momentum is: robots, wheels, object, outside",
        momentum_budget,
        applies=lambda r: _has_wheels(r) or "impulse_angular" in r.data,
    ),
    FigureKind("ledger", "The ledger: momentum and energy", ledger),
)
"""Every kind of figure that a single result can show, in the order a reader wants them."""


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
    known = [kind.name for kind in KINDS]
    for name in names or ():
        if name not in known:
            raise ResultError(f"no figure {name!r}; {near_names(name, known)}")
    for kind in KINDS:
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
    folder = Path(folder)
    for form in formats:
        if form not in FORMATS:
            raise ResultError(f"no format {form!r}; {near_names(form, FORMATS)}")
    written = []
    with drawn_for(width):
        for name, _, drawing in draw_all(result, *others, names=names):
            for form in formats:
                path = folder / f"{name}.{form}"
                write_bytes(path, to_bytes(drawing, form))
                written.append(path)
    note_derived([result, *others], written)
    return written
