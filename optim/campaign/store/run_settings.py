"""Settings of a campaign's folder that do not decide its numbers: its call, and what is requested."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from optim.campaign.rollouts.evaluator import CampaignEvaluator

Changes = Sequence[tuple[str, Any]]
ASKED = ("limits", "percentiles", "confidence")
"""Fields of the campaign section that may change without a rollout."""


@dataclass(frozen=True)
class ScenarioSource:
    """Scenario as named on the command line.

    Attributes
    ----------
    scenario
        File, or name of a shipped scenario.
    changes
        Changes of the scenario, by dotted path.
    """

    scenario: str
    changes: Changes = ()


def notes_of(evaluator: CampaignEvaluator, named: ScenarioSource | None) -> dict[str, Any]:
    """Notes for the folder of a campaign, as plain data.

    Parameters
    ----------
    evaluator
        Evaluator of the campaign.
    named
        Scenario on the command line; its file if None.
    """
    scene = evaluator.scene
    named = named or ScenarioSource(scene.scenario.name if scene.source is None else str(scene.source))
    about = "; ".join(dict.fromkeys(member.rollout.summary for member in evaluator.members))
    asked = evaluator.campaign.model_dump(mode="json", include=set(ASKED))
    changes = [list(change) for change in named.changes]
    notes = {"scenario": named.scenario, "changes": changes, "asked": asked, "about": about}
    return dict(json.loads(json.dumps(notes)))


def named_in(notes: Mapping[str, Any]) -> ScenarioSource:
    """Read from a folder's notes how the command line named the scenario."""
    return ScenarioSource(
        str(notes["scenario"]), tuple((str(path), value) for path, value in notes["changes"])
    )
