"""Tuning: variables, objectives, evolutionary methods, NLP, and an honest comparison between them.

The names below are loaded when they are first used. Campaigns are in :mod:`optim.campaign`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from spacerobot.lazy_names import lazy_names

if TYPE_CHECKING:
    from optim.comparison import Comparison as Comparison
    from optim.comparison import ProblemComparison as ProblemComparison
    from optim.comparison.compare import compare as compare
    from optim.methods.evolutionary import evolve as evolve
    from optim.methods.nlp import solve as solve
    from optim.methods.run_method import MethodOutcome as MethodOutcome
    from optim.methods.run_method import run_method as run_method
    from optim.methods.settings import Effort as Effort
    from optim.methods.settings import EvolutionSettings as EvolutionSettings
    from optim.methods.settings import NlpSettings as NlpSettings
    from optim.methods.settings import effort_of as effort_of
    from optim.methods.tuning_method import MethodRequest as MethodRequest
    from optim.methods.tuning_method import TuningMethod as TuningMethod
    from optim.problem.blackbox import ResultProblem as ResultProblem
    from optim.problem.sensitivities import Sensitivity as Sensitivity
    from optim.problem.sensitivities import sensitivity as sensitivity
    from optim.problem.tuning_problem import TuningProblem as TuningProblem
    from optim.problem.tuning_problem import build_problem as build_problem
    from optim.search.search import Search as Search
    from optim.search.search import SearchProgress as SearchProgress
    from optim.search.search import SearchRun as SearchRun
    from optim.search.session import SearchSession as SearchSession
    from optim.tuning import TuningResult as TuningResult
    from optim.tuning import tune as tune
    from spacerobot.rollout import Measure as Measure
    from spacerobot.rollout import Signals as Signals
    from spacerobot.rollout import final as final
    from spacerobot.rollout import integral as integral
    from spacerobot.rollout import peak as peak

_HOME = {
    "Comparison": "optim.comparison",
    "ProblemComparison": "optim.comparison",
    "Effort": "optim.methods.settings",
    "Measure": "spacerobot.rollout",
    "NlpSettings": "optim.methods.settings",
    "MethodOutcome": "optim.methods.run_method",
    "MethodRequest": "optim.methods.tuning_method",
    "EvolutionSettings": "optim.methods.settings",
    "SearchProgress": "optim.search.search",
    "ResultProblem": "optim.problem.blackbox",
    "SearchRun": "optim.search.search",
    "Search": "optim.search.search",
    "Sensitivity": "optim.problem.sensitivities",
    "SearchSession": "optim.search.session",
    "Signals": "spacerobot.rollout",
    "TuningMethod": "optim.methods.tuning_method",
    "TuningResult": "optim.tuning",
    "TuningProblem": "optim.problem.tuning_problem",
    "build_problem": "optim.problem.tuning_problem",
    "compare": "optim.comparison.compare",
    "effort_of": "optim.methods.settings",
    "evolve": "optim.methods.evolutionary",
    "final": "spacerobot.rollout",
    "integral": "spacerobot.rollout",
    "peak": "spacerobot.rollout",
    "run_method": "optim.methods.run_method",
    "sensitivity": "optim.problem.sensitivities",
    "solve": "optim.methods.nlp",
    "tune": "optim.tuning",
}
"""Where each name of the front door lives."""

__all__ = [*_HOME]  # noqa: PLE0604 (names that are loaded when used)
__getattr__, __dir__ = lazy_names(__name__, _HOME)
