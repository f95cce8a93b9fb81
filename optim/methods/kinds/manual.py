"""The manual procedure of the paper's section 4.3."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar

from optim.methods.manual import manual
from optim.methods.tuning_method import MethodRequest, TuningMethod
from optim.problem.tuning_problem import TuningProblem
from optim.search.search import SearchRun
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.registry import registered


@registered
class ManualProcedure(TuningMethod):
    """The manual procedure of the paper's section 4.3; it does not keep to the bounds."""

    name: ClassVar[str] = "manual"
    title: ClassVar[str] = "manual procedure"
    place: ClassVar[float] = 1
    solves_any_problem: ClassVar[bool] = False
    is_ranked: ClassVar[bool] = False
    shows_trials: ClassVar[bool] = True

    def searches(self, request: MethodRequest) -> Sequence[Callable[[], SearchRun]]:
        """One run of the procedure."""
        problem = request.problem
        if not isinstance(problem, TuningProblem):
            raise SpaceRobotError("the manual procedure tunes a scenario's gains, nothing else")
        return [lambda: manual(request.begin(self.name, 0, 0, ""), problem)]
