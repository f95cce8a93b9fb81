"""One sample of a campaign by itself: the command that runs it again, and its result."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from optim.campaign.evaluator import Evaluator
from optim.campaign.notes import Changes
from optim.protocol import Array
from spacerobot.result import Result
from spacerobot.scene import build_scene
from spacerobot.simulate import simulate


def command_of(evaluator: Evaluator, draw: Array, gains: str, scenario: str, given: Changes = ()) -> str:
    """Command that runs one sample again.

    Parameters
    ----------
    evaluator
        Of the campaign.
    draw
        Values of the uncertain parameters (k,).
    gains
        Which set of gains.
    scenario
        How the command line names the scenario.
    given
        What was changed in it, by dotted path; changes to the campaign section itself are left out.
    """
    space = evaluator.member(gains).space
    values = space.values(draw)[0]
    changes: dict[str, Any] = {p: v for p, v in given if p.partition(".")[0] != "campaign"}
    changes |= dict(evaluator.gains[gains])
    for pattern in dict.fromkeys(space.patterns):
        own = {
            p: float(v) for p, v, q in zip(space.paths, values, space.patterns, strict=True) if q == pattern
        }
        most = Counter(own.values()).most_common(1)[0][0]
        changes[pattern] = most
        changes |= {path: value for path, value in own.items() if value != most}
    changes["simulation.step"] = evaluator.campaign.step
    parts = [f"--set {shlex.quote(f'{path}={json.dumps(value)}')}" for path, value in changes.items()]
    return " ".join(["spacerobot run", shlex.quote(scenario), *parts])


def simulate_sample(evaluator: Evaluator, draw: Sequence[float], gains: str) -> Result:
    """Result of one sample, as its command gives it, named after the set of gains.

    Parameters
    ----------
    evaluator
        Of the campaign.
    draw
        Values of the uncertain parameters (k,).
    gains
        Which set of gains.
    """
    member = evaluator.member(gains)
    values = member.space.values(np.asarray(draw, dtype=float))[0]
    changes: dict[str, Any] = dict(zip(member.space.paths, map(float, values), strict=True))
    changes["simulation.step"] = evaluator.campaign.step
    scenario = member.scene.scenario.model_copy(update={"name": gains})
    return simulate(build_scene(scenario, changes, source=member.scene.source))
