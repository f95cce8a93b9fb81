"""Nonlinear programming from the GA's best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar

from optim.methods.nlp import solve
from optim.methods.tuning_method import MethodRequest, TuningMethod
from optim.search.search import SearchRun
from spacerobot.common.registry import registered


@registered
class NlpFromGa(TuningMethod):
    """Nonlinear programming from the GA's best."""

    name: ClassVar[str] = "nlp_ga"
    title: ClassVar[str] = "NLP from the GA's best"
    place: ClassVar[float] = 9
    uses_gradients: ClassVar[bool] = True
    solves_any_problem: ClassVar[bool] = False
    starts_from: ClassVar[str | None] = "ga"

    def searches(self, request: MethodRequest) -> Sequence[Callable[[], SearchRun]]:
        """One descent from the request's first point, as a rule the GA's best."""
        first, effort = request.first, request.effort
        assert first is not None

        def run() -> SearchRun:
            search = request.begin(self.name, 0, effort.seed, effort.nlp.fingerprint(first.tolist()))
            return solve(search, first, effort.nlp, warm=True)

        return [run]
