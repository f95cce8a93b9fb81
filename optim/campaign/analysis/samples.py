"""Single samples of a campaign: the command that runs one again, and its result."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from optim.campaign.rollouts.evaluator import CampaignEvaluator
from optim.campaign.store.run_settings import Changes
from spacerobot.common.arrays import Array
from spacerobot.elements.core.registry import plugin_options
from spacerobot.result import Result
from spacerobot.scenario.load import to_document
from spacerobot.scenario.paths import expand, get
from spacerobot.scene import build_scene
from spacerobot.simulation import simulate


def command_of(
    evaluator: CampaignEvaluator, draw: Array, gains: str, scenario: str, scenario_changes: Changes = ()
) -> str:
    """Command that runs one sample again.

    Args:
        evaluator: Evaluator of the campaign.
        draw: Values of the uncertain parameters (k,).
        gains: Name of the set of gains.
        scenario: The scenario's name on the command line.
        scenario_changes: Changes of the scenario, by dotted path; changes to the campaign section itself are
            left out.
    """
    space = evaluator.member(gains).space
    values = space.values(draw)[0]
    changes = [(p, v) for p, v in scenario_changes if p.partition(".")[0] != "campaign"]
    changes += evaluator.gains[gains].items()
    document, left = to_document(evaluator.member(gains).scene.scenario), dict[str, float]()
    for pattern in dict.fromkeys(space.patterns):
        pattern_values = [
            float(value) for value, of in zip(values, space.patterns, strict=True) if of == pattern
        ]
        most = Counter(pattern_values).most_common(1)[0][0]
        changes.append((pattern, most))
        left |= dict.fromkeys(expand(document, pattern), most)
    parameter_values = {path: float(value) for path, value in zip(space.paths, values, strict=True)}
    changes += [(path, value) for path, value in parameter_values.items() if left[path] != value]
    changes.append(("simulation.step", evaluator.campaign.step))
    changes += _assumed(evaluator, gains).items()
    last = {path: i for i, (path, _) in enumerate(changes)}
    changes = [change for i, change in enumerate(changes) if last[change[0]] == i]
    parts = [f"--set {shlex.quote(f'{path}={json.dumps(value)}')}" for path, value in changes]
    words = ["spacerobot run", *map(shlex.quote, [scenario, *plugin_options()]), *parts]
    return " ".join(words)


def simulate_sample(evaluator: CampaignEvaluator, draw: Sequence[float], gains: str) -> Result:
    """Result of one sample, as its command gives it, named after the set of gains.

    Args:
        evaluator, draw, gains: See :func:`command_of`.
    """
    member = evaluator.member(gains)
    values = member.space.values(np.asarray(draw, dtype=float))[0]
    changes: dict[str, Any] = dict(zip(member.space.paths, map(float, values), strict=True))
    changes["simulation.step"] = evaluator.campaign.step
    changes |= _assumed(evaluator, gains)
    scenario = member.scene.scenario.model_copy(update={"name": gains})
    scene = build_scene(scenario, changes, source=member.scene.source)
    return simulate(scene)


def _assumed(evaluator: CampaignEvaluator, gains: str) -> dict[str, Any]:
    """Change by which plans in flight are made with the scenario's masses, not the drawn ones."""
    member = evaluator.member(gains)
    scenario, document = member.scene.scenario, to_document(member.scene.scenario)
    link_values = {path: get(document, path) for path in member.space.paths if ".links." in path}
    if not link_values or not evaluator.has_updates or scenario.plan is None:
        return {}
    return {"plan.model": link_values | dict(scenario.plan.model)}
