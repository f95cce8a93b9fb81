"""Interface between searches and the workers that roll out for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

from spacerobot.common.arrays import Array

LANES = 8  # rollouts that the widest vectors do at once: fewer rows are not worth a piece of their own

Arrays = Mapping[str, Array]
Operation = Callable[[Any, Array], Arrays]
"""Function of (problem, rows (N, n)) that gives arrays whose first axis is N, each row for itself.

It works on one thread. Others may get it, and the rows, by another process: a function of a module, or a
``functools.partial`` of one.
"""
Ended = TypeVar("Ended", bound="SearchSummary")


class SearchSummary(Protocol):
    """A search that has ended, as far as workers must know."""

    @property
    def status(self) -> str:
        """``interrupted`` if it was stopped."""


class Recipe(Protocol):
    """Plain data from which another process builds an object."""

    @property
    def key(self) -> str:
        """Hash of the recipe."""

    def build(self) -> Any:
        """Build the object."""


class Portable(Protocol):
    """Object that can be built again in another process."""

    @property
    def recipe(self) -> Recipe:
        """Recipe that builds it."""


class Workers(Protocol):
    """Threads of this process, or processes of this and other machines."""

    @property
    def threads(self) -> int | None:
        """Threads that this process itself may use; each usable core if None."""

    def map(self, problem: Portable, operation: Operation, rows: Array, *, grain: int = LANES) -> Arrays:
        """Results of an operation on rows, computed in pieces by the workers.

        Args:
            problem: Problem that is evaluated.
            operation: Function of the problem and rows.
            rows: Rows (N, n).
            grain: Minimum number of rows of a piece.

        Raises:
            KeyboardInterrupt: If it was interrupted.
        """

    def together(self, searches: Sequence[Callable[[], Ended]]) -> list[Ended]:
        """Run searches, each a function without arguments, and return their results in order.

        After Ctrl-C, searches that have begun end as interrupted, and the others are left out.
        """
