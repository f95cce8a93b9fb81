"""A comparison of tuning methods on the report's page."""

import json
from shutil import rmtree

import pytest

from spacerobot.errors import ResultError
from spacerobot.result import save
from spacerobot.scene import load_scene
from spacerobot.simulate import simulate
from viz.comparison_figures import write_figures
from viz.comparison_section import comparison_report, comparison_section


def time(expected):
    bounds = {"low": expected, "high": expected, "rate_low": 0.5, "rate_high": 1.0}
    return {"expected": expected, "met": 4 if expected else 0, "runs": 5, **bounds}


def design(reached, **more):
    plants = {"objective": {"median": 0.005, "worst": 0.009}, "values": [0.005, 0.009], "diverged": 0}
    peaks = {"joint_torque_peak": 3.25, "tip_error_peak": 0.0123}
    return {"peaks": peaks, "other_plants": plants, "nominal_objective": reached} | more


def method(best, gains, active):
    found = design(best, objective=best, gains=gains, active_bounds=active, feasible=True, status="settled")
    return {
        "ranked": True,
        "objective": {"best": best, "median": 2 * best},
        "best": found,
        "spent": {"equivalent_rollouts": 123.4, "wall_s": 1.5, "wall_with_compilation_s": 9.5},
        "running_times": [time(1234.0 * best), time(None)],
        "trials": [{"spent": 123.4, "history": [[10.0, 2 * best], [60.0, best]]}],
    }


@pytest.fixture
def folder(tmp_path):
    result = simulate(load_scene("paper", {"simulation.duration": 0.2}))
    for name in ("baseline", "nlp"):
        save(result, tmp_path / "base-five" / name)
    contest = {
        "name": "base-five",
        "objective": {"kind": "minimax"},
        "unit": {"factor": 1e3, "name": "mm"},
        "variables": {"kp": {}},
        "currency": {"operations": 3.2e7, "gradient": 4.69, "slope": 2.86, "sample": 1.22},
        "best_known": 0.25,
        "start_objective": 0.5,
        "baseline": design(0.5),
        "sensitivity": None,
        "methods": {"ga": method(0.3, {"kp": 7.0}, ["kp"]), "nlp": method(0.25, {"kp": 8.0}, [])},
    }
    share = {"share": [0.1, 0.9], "low": [0.0, 0.8], "high": [0.2, 1.0]}
    profiles = {"budgets": [1.0, 100.0], "methods": {"ga": share, "nlp": share}}
    data = {"name": "<b>", "verdict": "nlp is ahead <b>", "precisions": [0.1, 0.01], "profiles": profiles}
    (tmp_path / "comparison.json").write_text(json.dumps(data | {"contests": [contest]}))
    write_figures(data | {"contests": [contest]}, tmp_path)
    return tmp_path


def test_the_verdict_comes_first_and_then_what_each_method_found(folder):
    page = comparison_report(folder)
    for text in (
        "untuned and nlp",
        "300",
        "250",
        "123",
        "5",
        "9",
        "3.25",
        "7*",
        "4.69",
        "308 (310..310)*",
        "4/5 = 0.80",
    ):
        assert text in page
    assert page.index("nlp is ahead") < page.index("<table")
    for title in ("Data profiles", "All runs of each method", "Objective on plants never tuned for"):
        assert title in page
    assert "How far the objective moves" not in page


def test_without_designs_it_is_a_page_of_its_own(folder):
    rmtree(folder / "base-five" / "nlp")
    page = comparison_report(folder)
    assert "nlp is ahead" in page
    assert "Headline numbers" not in page


def test_names_from_files_are_escaped(folder):
    for text in (comparison_section(folder).body(None), comparison_report(folder)):
        assert "ahead <b>" not in text
        assert "ahead &lt;b&gt;" in text


@pytest.mark.parametrize("content", ["", "{}", '{"contests": [{}]}', '{"contests": 3}'])
def test_a_broken_comparison_is_one_clear_line(folder, content):
    (folder / "comparison.json").write_text(content)
    with pytest.raises(ResultError, match="holds no comparison that can be shown"):
        comparison_report(folder)
