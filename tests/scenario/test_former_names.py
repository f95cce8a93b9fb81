"""A key of an earlier version is refused with the key that replaced it."""

from __future__ import annotations

import pytest

from spacerobot.common.errors import FORMER_NAMES, ScenarioError
from spacerobot.scenario.load import to_document, validate
from spacerobot.scenario.paths import assign
from spacerobot.scene import load_scene

PLACES = {
    "at_most": ("docking", "phases.approach"),
    "then": ("docking", "phases.approach"),
    "otherwise": ("docking", "phases.approach"),
    "least": ("examples/receding.yaml", "robots.*.controllers.lead"),
    "rival_budget": ("docking", "tuning"),
    "readings": ("paper", "tuning"),
    "most_intervals": ("docking", "plan"),
    "last": ("docking", "plan.approach_cones.left"),
    "cones": ("docking", "plan"),
    "sights": ("docking", "plan"),
    "shape": ("bounce", "pads.fist"),
}


def test_every_former_name_has_a_place_here():
    assert set(PLACES) == set(FORMER_NAMES)


@pytest.mark.parametrize("former", FORMER_NAMES)
def test_a_former_name_is_refused_with_its_new_one(former):
    source, place = PLACES[former]
    document = assign(to_document(load_scene(source).scenario), f"{place}.{former}", 3)
    with pytest.raises(ScenarioError, match=f"unknown key '{former}'; use '{FORMER_NAMES[former]}'"):
        validate(document)
