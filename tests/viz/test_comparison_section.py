"""A comparison of tuning methods on the report's page."""

import json

import pytest

from spacerobot.errors import ResultError
from spacerobot.result import save
from spacerobot.scene import load_scene
from spacerobot.simulate import simulate
from viz.comparison_section import comparison_report, comparison_section


def design(objective, **more):
    plants = {"objective": {"median": 0.005, "worst": 0.009}}
    return {
        "peaks": {"joint_torque_peak": 3.25},
        "other_plants": plants,
        "nominal_objective": objective,
    } | more


def method(best, gains, active):
    return {
        "objective": {"best": best, "median": 2 * best},
        "best": design(best, gains=gains, active_bounds=active),
        "spent": {"equivalent_rollouts": 123.4},
    }


@pytest.fixture
def folder(tmp_path):
    result = simulate(load_scene("paper", {"simulation.duration": 0.2}))
    for name in ("baseline", "nlp"):
        save(result, tmp_path / "base-five" / name)
    contest = {
        "name": "base-five",
        "objective": {"kind": "minimax"},
        "gradient_cost_rollouts": 31.0,
        "baseline": design(0.5),
        "methods": {"ga": method(0.3, {"kp": 7.0}, ["kp"]), "nlp": method(0.25, {"<b>": 8.0}, [])},
    }
    (tmp_path / "comparison.json").write_text(json.dumps({"contests": [contest]}))
    figures = tmp_path / "base-five" / "figures"
    figures.mkdir()
    (figures / "robustness.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    return tmp_path


def test_it_tells_what_each_method_found_and_shows_the_best(folder):
    page = comparison_report(folder)
    for text in ("untuned and nlp", "0.3", "0.25", "123", "0.005 (0.009)", "3.25", "kp 7*", "31 rollouts"):
        assert text in page
    assert "Objective on plants never tuned for" in page
    assert "Best objective so far" not in page


def test_names_from_files_are_escaped(folder):
    text = comparison_section(folder).body(None)
    assert "<b>" not in text
    assert "&lt;b&gt; 8" in text


@pytest.mark.parametrize("content", ["", "{}", '{"contests": [{}]}', '{"contests": 3}'])
def test_a_broken_comparison_is_one_clear_line(folder, content):
    (folder / "comparison.json").write_text(content)
    with pytest.raises(ResultError, match="holds no comparison that can be shown"):
        comparison_report(folder)
