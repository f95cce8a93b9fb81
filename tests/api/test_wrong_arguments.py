"""Wrong arguments of the Python interface: one sentence with the place, the value and the allowed values."""

import numpy as np
import pytest

import spacerobot as sr
from spacerobot.common.errors import ResultError, ScenarioError
from spacerobot.linear.instants import as_instants
from tests.oracles.small_scenes import PLANAR, small_scene

MASS = "target.links.body.mass"
KP = "robots.one.tips.tip.pid.kp"


@pytest.fixture(scope="module")
def scene():
    return small_scene(PLANAR)


@pytest.mark.parametrize("changes", ["simulation.duration=2", {3: 2}, [3], None])
def test_changes_that_are_no_values_by_path_are_refused(changes):
    with pytest.raises(ScenarioError, match=r"changes: found .*, allowed: values by path"):
        sr.load_scene("paper", changes)


@pytest.mark.parametrize("wrong", [None, 3, {"robots": {}}])
def test_what_is_no_scene_is_refused_with_its_type(wrong):
    with pytest.raises(ScenarioError, match=f"scene: found {type(wrong).__name__}, allowed: a scene of"):
        sr.simulate(wrong)
    with pytest.raises(ScenarioError, match=f"scenario: found {type(wrong).__name__}, allowed: its name"):
        sr.load_scene(wrong)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "values: found no parameter, allowed: a list"),
        ({MASS: [1, 2], KP: [1]}, "values: found lists of 1 and 2 numbers"),
        ({MASS: ["a"]}, rf"{MASS}: found \['a'\], allowed: a list of numbers"),
        ({MASS: [2, -1]}, f"{MASS}: found -1, allowed: at least 0"),
    ],
)
def test_wrong_values_of_a_batch_are_refused(scene, values, message):
    with pytest.raises(ScenarioError, match=message):
        sr.batch(scene, "tip_error_rms", values)


@pytest.mark.parametrize(
    ("quantity", "parameters", "at", "message"),
    [
        (None, [KP], None, "quantities: found None, allowed: names"),
        ([], [KP], None, r"quantities: found \[\], allowed: names"),
        ("tip_error_rms", [], None, "parameters: found none, allowed: dotted paths"),
        ("tip_error_rms", [KP], [1.0], "at: found list, allowed: values by dotted path"),
    ],
)
def test_wrong_arguments_of_a_gradient_are_refused(scene, quantity, parameters, at, message):
    with pytest.raises(sr.SpaceRobotError, match=message):
        sr.gradient(scene, quantity, parameters, at=at)


@pytest.mark.parametrize("draw", [sr.figures, sr.animate, sr.report])
@pytest.mark.parametrize("wrong", [None, 3, [3]])
def test_what_is_no_result_cannot_be_drawn(draw, wrong, tmp_path):
    with pytest.raises(ResultError, match=r"results: found (NoneType|int), allowed: results, plans"):
        draw(wrong, tmp_path / "page.html")


def test_a_result_is_not_written_over_a_file(scene, tmp_path):
    result = sr.simulate(scene)
    (tmp_path / "file").write_text("")
    with pytest.raises(ResultError, match="file: is a file, not a folder"):
        result.save(tmp_path / "file")


def test_a_single_instant_needs_no_list(scene):
    single, listed = sr.linearise(scene, 0.1), sr.linearise(scene, [0.1])
    assert as_instants(np.int64(3)) == [3]
    assert [one.label for one in single] == [one.label for one in listed] == ["0.1 s"]
    with pytest.raises(ScenarioError, match="at: no event 'captured'"):
        sr.margins(scene, "captured")


def test_a_draft_needs_a_request():
    with pytest.raises(ScenarioError, match="request: found str, allowed: a DraftRequest"):
        sr.draft("planar_arm.urdf")
