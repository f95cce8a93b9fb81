"""Settings in a campaign's folder that do not change its numbers: its call and its requested outputs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from optim.campaign.rollouts.evaluator import CampaignEvaluator
from spacerobot.scenario.catalogue import shipped
from spacerobot.scene import Scene

Changes = Sequence[tuple[str, Any]]
ASKED = ("limits", "percentiles", "confidence")
"""Fields of the campaign section that may change without a rollout."""


@dataclass(frozen=True)
class ScenarioSource:
    """Scenario as named on the command line.

    Attributes:
        scenario: File, or name of a shipped scenario.
        changes: Changes of the scenario, by dotted path.
    """

    scenario: str
    changes: Changes = ()


def notes_of(evaluator: CampaignEvaluator) -> dict[str, Any]:
    """Notes for the folder of a campaign, as plain data."""
    scene = evaluator.scene
    about = "; ".join(dict.fromkeys(member.rollout.summary for member in evaluator.members))
    settings = evaluator.campaign.model_dump(mode="json", include=set(ASKED))
    changes = [list(change) for change in scene.changes]
    notes = {"scenario": _name_of(scene), "changes": changes, "asked": settings, "about": about}
    return dict(json.loads(json.dumps(notes)))


def _name_of(scene: Scene) -> str:
    """Name of a shipped scenario, or file of another one."""
    if scene.source is None:
        return scene.scenario.name
    named = next((name for name, path in shipped().items() if path == scene.source), None)
    return str(scene.source) if named is None else named


def named_in(notes: Mapping[str, Any]) -> ScenarioSource:
    """Read from a folder's notes how the command line named the scenario."""
    return ScenarioSource(
        str(notes["scenario"]), tuple((str(path), value) for path, value in notes["changes"])
    )
