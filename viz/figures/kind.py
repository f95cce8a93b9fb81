"""A kind of figure, and the decorator that registers it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from spacerobot.common.registry import FIGURES
from spacerobot.result import Result

if TYPE_CHECKING:
    from viz.figures.style import Drawing

Draw = TypeVar("Draw", bound=Callable[..., Any])


@dataclass(frozen=True)
class FigureKind:
    """A kind of figure.

    Attributes:
        name: Name of its files.
        title: Title of the figure.
        draw: Function that draws it from one result, or from several if it compares.
        compares: Whether it takes several results.
        applies: Function that returns whether a result has the data.
        printed: Corresponding figure of the paper for the paper's robots, if there is one.
        place: Position among all figures.
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
        title: Title of the figure.
        **options: ``compares``, ``applies``, ``printed`` and ``place`` of :class:`FigureKind`.

    Raises:
        SpaceRobotError: If another figure has its name.
    """

    def add(draw: Draw) -> Draw:
        FIGURES.add(FigureKind(draw.__name__, title, draw, **options), draw.__module__)
        return draw

    return add
