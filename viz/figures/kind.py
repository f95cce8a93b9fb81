"""A kind of figure, and the decorator that registers it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from spacerobot.registry import FIGURES
from spacerobot.result import Result

if TYPE_CHECKING:
    from viz.figures.style import Drawing

Draw = TypeVar("Draw", bound=Callable[..., Any])


@dataclass(frozen=True)
class FigureKind:
    """A kind of figure.

    Attributes:
        name: Of its files.
        title: What it shows, for people.
        draw: Draws it from one result, or from several if it compares.
        compares: Whether it takes several results.
        applies: Whether a result has what it shows.
        printed: Figure of the paper that shows the same of the paper's robots, if any.
        place: Its place among all figures.
    """

    name: str
    title: str
    draw: Callable[..., Drawing]
    compares: bool = False
    applies: Callable[[Result], bool] = lambda _: True
    printed: str = ""
    place: float = 100.0


def figure(title: str, **options: Any) -> Callable[[Draw], Draw]:
    """Decorator that registers a function as a kind of figure under the function's name.

    Args:
        title: What it shows, for people.
        **options: ``compares``, ``applies``, ``printed`` and ``place`` of :class:`FigureKind`.

    Raises:
        SpaceRobotError: If another figure has its name.
    """

    def add(draw: Draw) -> Draw:
        FIGURES.add(FigureKind(draw.__name__, title, draw, **options), draw.__module__)
        return draw

    return add
