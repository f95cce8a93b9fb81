"""Tuning: variables, objectives, evolutionary methods, NLP, and an honest comparison between them."""

from optim.comparison import Comparison, Contest, Session, compare
from optim.evolutionary import Protocol, evolve
from optim.methods import Effort, Outcome, effort_of, run_method
from optim.nlp import NlpSettings, solve
from optim.problem import TuningProblem, build_problem
from optim.search import Report, Run, Search
from optim.sensitivity import Sensitivity, sensitivity
from optim.tune import Tuned, tune
from spacerobot.rollout import Measure, Signals, final, integral, peak

__all__ = [
    "Comparison",
    "Contest",
    "Effort",
    "Measure",
    "NlpSettings",
    "Outcome",
    "Protocol",
    "Report",
    "Run",
    "Search",
    "Sensitivity",
    "Session",
    "Signals",
    "Tuned",
    "TuningProblem",
    "build_problem",
    "compare",
    "effort_of",
    "evolve",
    "final",
    "integral",
    "peak",
    "run_method",
    "sensitivity",
    "solve",
    "tune",
]
