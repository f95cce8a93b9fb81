"""Drafted scenarios: they load, run, and their numbers suit the arm."""

import dataclasses

import numpy as np
import pytest

from spacerobot.drafting import DraftRequest, draft_scenario
from spacerobot.errors import SpaceRobotError
from spacerobot.scene import load_scene
from spacerobot.scene.overlaps import overlaps
from spacerobot.simulation import simulate

PLANAR = DraftRequest(["planar_arm.urdf"], "rectangle.urdf")


def test_a_drafted_scenario_runs_and_follows_its_reference(tmp_path):
    text, scene = draft_scenario(PLANAR, tmp_path / "mine.yaml")
    (tmp_path / "mine.yaml").write_text(text)
    assert scene.planar
    assert not scene.warnings
    loaded = load_scene(tmp_path / "mine.yaml")
    assert loaded.scenario.tuning is not None
    assert loaded.scenario.campaign is not None
    result = simulate(loaded)
    assert result.completed
    distance = np.linalg.norm(loaded.scenario.target.reference.displacement)
    assert result.summary["tip_error"]["planar_arm/tip"]["norm"]["max_m"] < 1e-3 * distance


def test_gains_of_several_arms_stand_within_their_bounds_and_grow_with_the_target(tmp_path):
    two = dataclasses.replace(PLANAR, robots=["planar_arm.urdf"] * 2)
    _, light = draft_scenario(two, tmp_path / "a.yaml")
    _, heavy = draft_scenario(dataclasses.replace(two, target="satellite_box.urdf"), tmp_path / "b.yaml")
    gains = [s.scenario.robots["planar_arm"].tips["tip"].pid.kp for s in (light, heavy)]
    assert gains[0] < gains[1]
    bounds = light.scenario.tuning.variables["kp_planar_arm"]
    assert bounds.lower < gains[0] < bounds.upper


def test_two_robots_hold_one_frame_each(tmp_path):
    order = dataclasses.replace(PLANAR, robots=["planar_arm.urdf", "planar_arm.urdf"])
    _, scene = draft_scenario(order, tmp_path / "two.yaml")
    assert [grasp.config.frame for grasp in scene.grasps] == ["mate_1", "mate_2"]
    assert scene.robots[1].base.close_grasp == "hold_2"
    assert overlaps(scene) == []


def test_the_target_lies_away_from_the_arm(tmp_path):
    for target in ("rectangle.urdf", "satellite_box.urdf"):
        _, scene = draft_scenario(dataclasses.replace(PLANAR, target=target), tmp_path / "x.yaml")
        assert overlaps(scene) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tips": ["tpi"]}, "--tip: no link 'tpi' in planar_arm.urdf; did you mean tip"),
        ({"tips": ["tip", "tip"]}, "found 2 for 1 robots"),
        ({"frames": ["mate1"]}, "--frame: no link 'mate1' in rectangle.urdf; did you mean mate_1"),
        ({"robots": ["planer_arm.urdf"]}, "did you mean planar_arm.urdf"),
        ({"robots": ["planar_arm.urdf"] * 3}, "one link of rectangle.urdf for each of the 3 robots"),
        ({"robots": ["servicer.urdf"]}, "its ends: left_tip, right_tip"),
        ({"base": "planr"}, "--base: found 'planr'; did you mean planar"),
    ],
)
def test_what_cannot_be_drafted_is_refused_by_name(tmp_path, change, words):
    with pytest.raises(SpaceRobotError) as refused:
        draft_scenario(dataclasses.replace(PLANAR, **change), tmp_path / "x.yaml")
    assert words in str(refused.value)
