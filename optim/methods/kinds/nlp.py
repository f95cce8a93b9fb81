"""Nonlinear programming from several starts."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import ClassVar

from optim.methods.nlp import solve_from_many
from optim.methods.tuning_method import MethodRequest, TuningMethod
from optim.search.search import SearchRun
from spacerobot.common.registry import registered


@registered
class NonlinearProgramming(TuningMethod):
    """Nonlinear programming from several starts."""

    name: ClassVar[str] = "nlp"
    title: ClassVar[str] = "NLP: gradient-based"
    place: ClassVar[float] = 8
    uses_gradients: ClassVar[bool] = True

    def searches(self, request: MethodRequest) -> Sequence[Callable[[], SearchRun]]:
        """A multi-start run, or several with different seeds."""
        effort = request.effort

        def run(index: int) -> SearchRun:
            seed = effort.seed + index
            search = request.begin(self.name, index, seed, effort.nlp.fingerprint(effort.starts))
            return solve_from_many(search, effort.nlp, effort.starts)

        return [functools.partial(run, i) for i in range(effort.repeats)]
