"""Tuning: variables, objectives, evolutionary methods, NLP, and an honest comparison between them.

The names below are loaded when they are first used. Campaigns are in :mod:`optim.campaign`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from spacerobot.front_door import front_door

if TYPE_CHECKING:
    from optim.comparison import Comparison as Comparison
    from optim.comparison import Contest as Contest
    from optim.comparison.compare import compare as compare
    from optim.methods.by_name import Effort as Effort
    from optim.methods.by_name import Outcome as Outcome
    from optim.methods.by_name import effort_of as effort_of
    from optim.methods.by_name import run_method as run_method
    from optim.methods.evolutionary import Protocol as Protocol
    from optim.methods.evolutionary import evolve as evolve
    from optim.methods.nlp import NlpSettings as NlpSettings
    from optim.methods.nlp import solve as solve
    from optim.problem.blackbox import ResultProblem as ResultProblem
    from optim.problem.sensitivities import Sensitivity as Sensitivity
    from optim.problem.sensitivities import sensitivity as sensitivity
    from optim.problem.tuning_problem import TuningProblem as TuningProblem
    from optim.problem.tuning_problem import build_problem as build_problem
    from optim.search.search import Report as Report
    from optim.search.search import Run as Run
    from optim.search.search import Search as Search
    from optim.search.session import Session as Session
    from optim.tuning import Tuned as Tuned
    from optim.tuning import tune as tune
    from spacerobot.rollout import Measure as Measure
    from spacerobot.rollout import Signals as Signals
    from spacerobot.rollout import final as final
    from spacerobot.rollout import integral as integral
    from spacerobot.rollout import peak as peak

_HOME = {
    "Comparison": "optim.comparison",
    "Contest": "optim.comparison",
    "Effort": "optim.methods.by_name",
    "Measure": "spacerobot.rollout",
    "NlpSettings": "optim.methods.nlp",
    "Outcome": "optim.methods.by_name",
    "Protocol": "optim.methods.evolutionary",
    "Report": "optim.search.search",
    "ResultProblem": "optim.problem.blackbox",
    "Run": "optim.search.search",
    "Search": "optim.search.search",
    "Sensitivity": "optim.problem.sensitivities",
    "Session": "optim.search.session",
    "Signals": "spacerobot.rollout",
    "Tuned": "optim.tuning",
    "TuningProblem": "optim.problem.tuning_problem",
    "build_problem": "optim.problem.tuning_problem",
    "compare": "optim.comparison.compare",
    "effort_of": "optim.methods.by_name",
    "evolve": "optim.methods.evolutionary",
    "final": "spacerobot.rollout",
    "integral": "spacerobot.rollout",
    "peak": "spacerobot.rollout",
    "run_method": "optim.methods.by_name",
    "sensitivity": "optim.problem.sensitivities",
    "solve": "optim.methods.nlp",
    "tune": "optim.tuning",
}
"""Where each name of the front door lives."""

__all__ = [*_HOME]  # noqa: PLE0604 (names that are loaded when used)
__getattr__, __dir__ = front_door(__name__, _HOME)
