"""Robot arms on floating bases that dock with, capture, carry and release a floating object.

    import spacerobot as sr

    scene = sr.load_scene("docking")
    result = sr.simulate(scene)
    sr.animate(result, "docking.html")

The names below are loaded when they are first used, so that importing the package takes no time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from spacerobot.lazy_names import lazy_names
from spacerobot.version import __version__ as __version__

if TYPE_CHECKING:
    from optim.evaluation import BatchResult as BatchResult
    from optim.evaluation import GradientResult as GradientResult
    from optim.evaluation import batch as batch
    from optim.evaluation import gradient as gradient
    from optim.identification import IdentificationResult as IdentificationResult
    from optim.identification import SensorNoise as SensorNoise
    from optim.identification import identify as identify
    from optim.methods.settings import Effort as Effort
    from optim.problem.tuning_problem import build_problem as build_problem
    from optim.reliability.estimator import SamplingEffort as SamplingEffort
    from optim.reliability.falsification import Falsification as Falsification
    from optim.reliability.falsification import falsify as falsify
    from optim.reliability.probability import FailureProbability as FailureProbability
    from optim.reliability.probability import failure_probability as failure_probability
    from optim.robust.worst_margins import WorstMargins as WorstMargins
    from optim.robust.worst_margins import worst_margins as worst_margins
    from optim.tuning import TuningResult as TuningResult
    from optim.tuning import tune as tune
    from spacerobot.abort_drift import PassiveSafety as PassiveSafety
    from spacerobot.abort_drift import passive_safety as passive_safety
    from spacerobot.api.functions import animate as animate
    from spacerobot.api.functions import campaign as campaign
    from spacerobot.api.functions import compare as compare
    from spacerobot.api.functions import figures as figures
    from spacerobot.api.functions import plan as plan
    from spacerobot.api.functions import report as report
    from spacerobot.api.functions import simulate as simulate
    from spacerobot.api.results import CampaignResult as CampaignResult
    from spacerobot.api.results import ComparisonResult as ComparisonResult
    from spacerobot.api.results import PlanResult as PlanResult
    from spacerobot.api.results import load as load
    from spacerobot.closedloop import ClosedLoop as ClosedLoop
    from spacerobot.closedloop import build_closed_loop as build_closed_loop
    from spacerobot.elements import load_plugin as load_plugin
    from spacerobot.elements import register as register
    from spacerobot.errors import SpaceRobotError as SpaceRobotError
    from spacerobot.linear import LinearSystem as LinearSystem
    from spacerobot.linear import MarginAnalysis as MarginAnalysis
    from spacerobot.linear import linearise as linearise
    from spacerobot.linear import margins as margins
    from spacerobot.quantities import Quantity as Quantity
    from spacerobot.quantities import register_quantity as register_quantity
    from spacerobot.result import Result as Result
    from spacerobot.rollout import Rollout as Rollout
    from spacerobot.rollout import build_rollout as build_rollout
    from spacerobot.scene import Scene as Scene
    from spacerobot.scene import load_scene as load_scene
    from viz.studio.server import studio as studio

_HOME = {
    "BatchResult": "optim.evaluation",
    "CampaignResult": "spacerobot.api.results",
    "ClosedLoop": "spacerobot.closedloop",
    "ComparisonResult": "spacerobot.api.results",
    "Effort": "optim.methods.settings",
    "FailureProbability": "optim.reliability.probability",
    "Falsification": "optim.reliability.falsification",
    "GradientResult": "optim.evaluation",
    "IdentificationResult": "optim.identification",
    "LinearSystem": "spacerobot.linear",
    "MarginAnalysis": "spacerobot.linear",
    "PassiveSafety": "spacerobot.abort_drift",
    "PlanResult": "spacerobot.api.results",
    "Quantity": "spacerobot.quantities",
    "Result": "spacerobot.result",
    "Rollout": "spacerobot.rollout",
    "SamplingEffort": "optim.reliability.estimator",
    "Scene": "spacerobot.scene",
    "TuningResult": "optim.tuning",
    "WorstMargins": "optim.robust.worst_margins",
    "SensorNoise": "optim.identification",
    "SpaceRobotError": "spacerobot.errors",
    "animate": "spacerobot.api.functions",
    "batch": "optim.evaluation",
    "build_closed_loop": "spacerobot.closedloop",
    "build_problem": "optim.problem.tuning_problem",
    "build_rollout": "spacerobot.rollout",
    "campaign": "spacerobot.api.functions",
    "compare": "spacerobot.api.functions",
    "failure_probability": "optim.reliability.probability",
    "falsify": "optim.reliability.falsification",
    "figures": "spacerobot.api.functions",
    "gradient": "optim.evaluation",
    "identify": "optim.identification",
    "linearise": "spacerobot.linear",
    "load": "spacerobot.api.results",
    "load_plugin": "spacerobot.elements",
    "load_scene": "spacerobot.scene",
    "margins": "spacerobot.linear",
    "passive_safety": "spacerobot.abort_drift",
    "plan": "spacerobot.api.functions",
    "register": "spacerobot.elements",
    "register_quantity": "spacerobot.quantities",
    "report": "spacerobot.api.functions",
    "simulate": "spacerobot.api.functions",
    "studio": "viz.studio.server",
    "tune": "optim.tuning",
    "worst_margins": "optim.robust.worst_margins",
}
"""Where each name of the front door lives."""

__all__ = ["__version__", *_HOME]  # noqa: PLE0604 (names that are loaded when used)
__getattr__, __dir__ = lazy_names(__name__, _HOME)
