"""Ranges on the command line become variables of a tuning section."""

import pytest

from optim.problem.scene_recipe import tuning_of
from optim.problem.varied_parameters import vary
from spacerobot.common.errors import ScenarioError
from spacerobot.scene import load_scene


def test_the_end_of_a_path_stands_for_all_that_end_so():
    scene = vary(load_scene("servicer"), ["pid.kp=20..2000", "ta=2..6"])
    variables = scene.scenario.tuning.variables
    assert set(variables) == {"pid_kp", "amnesia_ta", "orientation_amnesia_ta"}
    assert variables["pid_kp"].paths == tuple(
        f"robots.servicer.tips.{tip}.pid.kp" for tip in ("left_tip", "right_tip")
    )
    assert (variables["pid_kp"].scale, variables["amnesia_ta"].scale) == ("log", "linear")


def test_a_full_path_is_taken_as_it_is_and_the_section_keeps_its_objective():
    scene = vary(load_scene("paper"), ["robots.*.tips.tip.pid.kp=20..2000"])
    tuning = scene.scenario.tuning
    assert list(tuning.variables) == ["pid_kp"]
    assert tuning.sets == {}
    assert tuning.objective.kind == "minimax"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("kp", "allowed: PATH=LOWER..UPPER"),
        ("kp=a..b", "allowed: PATH=LOWER..UPPER"),
        ("kp=3..2", "lower must be below upper"),
        ("stifness=1..2", "did you mean stiffness"),
        ("robots.rpr.x=1..2", "did you mean rpr"),
    ],
)
def test_what_is_no_range_of_a_number_is_refused(text, words):
    with pytest.raises(ScenarioError, match=words):
        vary(load_scene("paper"), [text])


def test_a_scenario_without_a_section_says_how_to_get_one():
    with pytest.raises(ScenarioError, match=r"--vary kp=20\.\.2000"):
        tuning_of(load_scene("servicer"))
