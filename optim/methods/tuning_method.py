"""Base class of tuning methods."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from optim.methods.settings import Effort
from optim.problem.problem import OptimisationProblem
from optim.search.journal import Journal
from optim.search.search import Search, SearchRun
from optim.search.session import SearchSession
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.registry import TUNING_METHODS, Registry, required


@dataclass(frozen=True)
class SearchFactory:
    """Factory of searches of one problem, each with its own journal."""

    problem: OptimisationProblem
    session: SearchSession

    def __call__(self, name: str, index: int, seed: int, settings: str) -> Search:
        """A search by its name, number, seed and whatever else its values depend on."""
        text = f"{self.problem.fingerprint} {name} {index} {seed} {settings}"
        folder = self.session.place
        path = None if folder is None else folder / f"{name}-{index}.journal"
        journal = Journal(path, hashlib.sha256(text.encode()).hexdigest())
        return Search(self.problem, name, index, seed, journal, self.session.progress)


@dataclass(frozen=True)
class MethodRequest:
    """A problem for a method, and the method's budget.

    Attributes:
        problem: The problem.
        begin: Factory of the problem's searches.
        effort: Budget of the method.
        first: Start in the unit cube (k,) of a method that starts from another one's best point.
    """

    problem: OptimisationProblem
    begin: SearchFactory
    effort: Effort
    first: Array | None = None


class TuningMethod:
    """A method of tuning.

    A method derives from this class, states its name, and is decorated with ``spacerobot.register``.

    Attributes:
        name, title, place: In options and files, for people, and its place in lists.
        uses_gradients: Whether it needs derivatives, which a Python function of a result has not.
        solves_any_problem: Whether it solves any problem by itself.
        is_ranked: Whether a comparison ranks it: one that does not keep to the bounds solves another problem.
        starts_from: Method from whose best it starts.
        shows_trials: Whether the log of its run is a table for people.
    """

    registry: ClassVar[Registry] = TUNING_METHODS
    name: ClassVar[str]
    title: ClassVar[str] = ""
    place: ClassVar[float] = 100.0
    uses_gradients: ClassVar[bool] = False
    solves_any_problem: ClassVar[bool] = True
    is_ranked: ClassVar[bool] = True
    starts_from: ClassVar[str | None] = None
    shows_trials: ClassVar[bool] = False

    @required()
    def searches(self, request: MethodRequest) -> Sequence[Callable[[], SearchRun]]:
        """Independent runs, each a function without arguments; they may run at the same time.

        Raises:
            SpaceRobotError: If it cannot solve the problem, or its start is missing.
        """
        raise NotImplementedError


def check_robust_method(method: str) -> None:
    """Check that a method tunes robustly: that it solves any problem by itself.

    Raises:
        SpaceRobotError: If it does not, or there is no such method.
    """
    if not TUNING_METHODS.find(method).solves_any_problem:
        names = [name for name, each in TUNING_METHODS.entries().items() if each.solves_any_problem]
        raise SpaceRobotError(f"found {method!r}, which cannot tune robustly; allowed: {', '.join(names)}")
