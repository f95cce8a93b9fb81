"""Tuning and comparing from Python and from the command line: reports, errors, the documented script."""

from __future__ import annotations

import json
import re
import threading

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import spacerobot as sr
from optim import (
    Effort,
    EvolutionSettings,
    NlpSettings,
    ResultProblem,
    SearchSession,
    compare,
    run_method,
    tune,
)
from optim.comparison import tables
from optim.comparison.design_evaluator import build_design_evaluator
from optim.comparison.report import to_data
from optim.comparison.results import results_of, write
from optim.comparison.statistics import statistics
from optim.comparison.sweep import run_sweep
from optim.problem.sensitivities import sensitivity
from optim.problem.tuning_problem import build_problem
from optim.problem.variables import at_bound
from spacerobot.common.errors import ResultError, ScenarioError, SpaceRobotError
from spacerobot.common.registry import COMMANDS, TUNING_METHODS
from spacerobot.result import Result
from tests.oracles.known_optima import quadratic

TINY = EvolutionSettings(population=8, budget=48)
EFFORT = Effort(TINY, TINY, runs=2, nlp=NlpSettings(iterations=15, screen=8), starts=2)


@pytest.fixture(scope="module")
def found(small, tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared")
    made = compare(
        small(), variants=["base"], sets=["four"], effort=EFFORT, session=SearchSession(folder / "journals")
    )
    write(made, folder)
    return made, folder


def test_every_method_runs_on_the_same_problem(found):
    (benchmark,) = found[0].problems
    assert list(benchmark.outcomes) == list(TUNING_METHODS.entries())
    for name in ("ga", "de", "pso", "cmaes"):
        assert len(benchmark.outcomes[name].runs) == 2
        assert benchmark.outcomes[name].best.objective < benchmark.baseline.nominal["objective"]
    assert benchmark.outcomes["nlp_ga"].best.objective <= benchmark.outcomes["ga"].best.objective
    everyone = [o.best.objective for n, o in benchmark.outcomes.items() if n != "manual"]
    assert benchmark.outcomes["nlp"].best.objective <= min(everyone) * 1.001
    assert benchmark.best_known == min(everyone)


def test_assessments_are_ordinary_rollouts_of_the_same_design(found):
    (benchmark,) = found[0].problems
    for name, found_there in benchmark.assessments.items():
        reached = benchmark.outcomes[name].best.objective
        assert found_there.nominal["objective"] == pytest.approx(reached, rel=1e-6)
        assert found_there.varied["objective"].shape == (8,)
        assert len(np.unique(found_there.varied["objective"])) == 8


def test_the_report_is_complete_and_strict_json(found):
    data = json.loads((found[1] / "comparison.json").read_text(), parse_constant=pytest.fail)
    (benchmark,) = data["problems"]
    assert benchmark["directions"] == ["arm/tip x", "arm/tip y"]
    for name, method in benchmark["methods"].items():
        assert {"best", "median", "lower", "upper", "worst"} <= set(method["objective"])
        assert method["best"]["other_plants"]["plants"] == 8
        assert set(method["best"]["gains"]) == {"kp", "ki", "kd", "ta"}
        assert method["best"]["peaks"]["joint_torque_peak"] > 0
        assert method["best"]["result"] == f"base-four/{name}"
        assert method["ranked"] == bool(method["trials"]) == (name != "manual")
        for trial in method["trials"]:
            costs, values = zip(*trial["history"], strict=True)
            assert list(costs) == sorted(costs)
            assert list(values) == sorted(values, reverse=True)
            assert costs[-1] <= trial["spent"]
    best = min(m["objective"]["best"] for n, m in benchmark["methods"].items() if n != "manual")
    assert benchmark["best_known"] == best
    assert benchmark["targets"] == pytest.approx([1.1 * best, 1.01 * best, 1.001 * best])
    assert data["conclusion"].count("lowest expected running time") == 1
    assert set(data["profiles"]["methods"]) == set(benchmark["methods"]) - {"manual"}
    assert len(benchmark["methods"]["manual"]["runs"][0]["log"]) > 5


def test_each_best_design_is_saved_as_a_result(found):
    made, folder = found
    data = json.loads((folder / "comparison.json").read_text())
    result = Result.load(folder / "base-four" / "nlp")
    best = data["problems"][0]["methods"]["nlp"]["best"]
    tip = result.scenario.robots["arm"].tips["tip"]
    assert tip.pid.kp == pytest.approx(best["gains"]["kp"])
    largest = max(made.problems[0].assessments["nlp"].nominal["tip_error_peak"])
    assert best["largest_error_checked_m"] == pytest.approx(largest, rel=1e-2)


def test_a_best_design_is_trusted_as_its_run_is(found, tmp_path, monkeypatch):
    made, _ = found
    (method, result), *_ = results_of(made.problems[0])
    judged = {"trusted": False, "open": [], "deep": ["contact bump is 96 mm deep"], "advice": None}
    result.summary["status"] |= judged
    monkeypatch.setattr("optim.comparison.results.results_of", lambda _: [(method, result)])
    data = write(made, tmp_path)
    entry = data["problems"][0]["baseline"]
    assert {name: entry[name] for name in ("trusted", "open", "deep")} == {
        name: judged[name] for name in ("trusted", "open", "deep")
    }


def test_a_comparison_run_again_is_read_from_its_journals(found, small, monkeypatch):
    first, folder = found
    monkeypatch.setattr("optim.problem.tuning_problem.TuningProblem.evaluate", None)
    again = run_method(
        first.problems[0].problem, "ga", EFFORT, session=SearchSession(folder / "journals" / "base-four")
    )
    assert again.best.objective == first.problems[0].outcomes["ga"].best.objective


def test_tables_have_a_cell_for_each_heading(found):
    data = to_data(found[0])
    (benchmark,) = data["problems"]
    made = [tables.summary_table(data), *tables.tables_of(benchmark, data["precisions"])]
    assert len(made) == 6
    for table in made:
        assert table.rows
        assert {len(row) for row in table.rows} == {len(table.headings)}


def test_the_nlp_from_the_ga_pays_for_the_ga(found):
    (benchmark,) = found[0].problems
    paid = sum(run.cost.rollouts for run in benchmark.outcomes["ga"].runs)
    (trial,) = benchmark.trials("nlp_ga")
    assert trial.costs[0] > paid


def test_gains_at_a_bound_say_which():
    u = np.array([0.0, 0.5, 0.9995, -3.0])
    assert at_bound(["a", "b", "c", "d"], u) == {
        "a": "at its lower bound",
        "c": "at its upper bound",
        "d": "below its lower bound",
    }


def test_sensitivities_are_relative_slopes(small, interpreted):
    problem = build_problem(small(), variables=["kp", "ta"])
    u, step = np.array([0.5, 0.5]), 1e-4
    found = sensitivity(problem, {"here": u})
    value = problem.evaluate(u[None]).objective[0]
    for i in range(2):
        moved = [u + sign * step * np.eye(2)[i] for sign in (1, -1)]
        up, down = problem.evaluate(np.array(moved)).objective
        p_up, p_down = (problem.variables.values(m)[i] for m in moved)
        slope = (np.log(up) - np.log(down)) / (np.log(p_up) - np.log(p_down))
        assert found.relative["here"][i] == pytest.approx(slope, rel=1e-3)
        assert found.over_range["here"][i] == pytest.approx((up - down) / (2 * step) / value, rel=1e-3)


def test_plants_stay_within_their_spreads_and_are_seeded(small):
    judge = build_design_evaluator(small(), variant="base")
    plants = judge.plants
    assert {path.split(".")[-1] for path in plants} >= {"mass", "stiffness", "offset"}
    assert any(path.startswith("target.links") and ".inertia." in path for path in plants)
    stiffness = plants["grasps.left.stiffness"]
    assert stiffness.min() >= 70
    assert stiffness.max() <= 130
    assert stiffness.std() > 10
    again = build_design_evaluator(small(), variant="base").plants
    assert all(np.array_equal(again[path], values) for path, values in plants.items())
    other = build_design_evaluator(small(tuning__robustness__seed=9), variant="base").plants
    assert not np.array_equal(other["grasps.left.stiffness"], stiffness)


def test_a_saved_comparison_is_loaded_and_copied(found, tmp_path):
    _, folder = found
    loaded = sr.load(folder)
    assert repr(loaded).endswith(": base-four>")
    assert loaded.summary["conclusion"] in loaded._repr_html_()
    copied = loaded.save(tmp_path / "copy")
    assert sr.load(copied.folder).summary == loaded.summary == sr.ComparisonResult.load(folder).summary
    (tmp_path / "copy" / "comparison.json").write_text("{")
    with pytest.raises(ResultError, match="no comparison that can be read"):
        sr.load(tmp_path / "copy")


def test_a_python_function_of_a_result_sees_events(small, interpreted):
    phases = {"first": {"until": {"time": 0.1}}, "second": {}}
    problem = ResultProblem(
        build_problem(small(phases=phases), variables=["kd"]), lambda result: len(result.summary["events"])
    )
    assert problem.evaluate(problem.start[None]).objective == [1]


def test_a_python_function_of_a_result_serves_the_ga(small, interpreted, tmp_path):
    def score(result):
        return result.summary["tip_error"]["arm/tip"]["norm"]["rms_m"]

    effort = Effort(EvolutionSettings(population=6, budget=18), runs=1)
    problem = ResultProblem(build_problem(small(), variables=["kd"]), score)
    tuned = tune(problem, "ga", effort=effort)
    assert 20 <= tuned.gains["kd"] <= 100
    assert tuned.objective == pytest.approx(score(_simulated(tuned.scene)), rel=1e-2)
    with pytest.raises(ScenarioError, match="no gradients"):
        tune(problem, "nlp")
    tuned.save(tmp_path / "tuned")
    loaded = sr.load(tmp_path / "tuned")
    assert (loaded.gains, loaded.objective, loaded.status) == (tuned.gains, tuned.objective, tuned.status)
    assert loaded.scene.scenario == tuned.scene.scenario
    np.testing.assert_array_equal(loaded.outcome.best.u, tuned.outcome.best.u)
    assert loaded.outcome.best.cost == tuned.outcome.best.cost
    assert repr(loaded) == repr(tuned)
    assert "objective" in loaded._repr_html_()
    (tmp_path / "tuned" / "tuning.json").write_text('{"gains": {}}')
    with pytest.raises(ResultError, match="no tuning that can be read"):
        sr.load(tmp_path / "tuned")


def _simulated(scene):
    from spacerobot.simulation import simulate

    return simulate(scene)


def test_new_variables_need_no_tuning_section(small, interpreted):
    effort = Effort(nlp=NlpSettings(iterations=5, screen=8), starts=1)
    bare = small(tuning=None)
    problem = build_problem(bare, variables={"kd": ("robots.arm.tips.tip.pid.kd", 20, 100)})
    tuned = tune(problem, effort=effort)
    assert tuned.scene.scenario.robots["arm"].tips["tip"].pid.kd == pytest.approx(tuned.gains["kd"])


def test_the_sweep_covers_probabilities_and_populations(small):
    trials = list(run_sweep(quadratic(), protocol=EvolutionSettings(population=10, budget=60), runs=2))
    settings = {(trial.setting, trial.value) for trial in trials}
    assert {("crossover", 0.1), ("crossover", 0.9), ("mutation", 0.9), ("population", 20)} <= settings
    assert all(len(trial.runs) == 2 and np.isfinite(trial.objectives).all() for trial in trials)


def test_statistics_count_what_has_no_value_as_worst():
    found = statistics(np.array([3.0, np.nan, 1.0]))
    assert (found["best"], found["median"], found["worst"]) == (1.0, 3.0, np.inf)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tuning__variables__kp__paths": ["robots.arm.tips.tip.pid.kpp"]}, "did you mean kp"),
        ({"tuning__variables__kp__paths": ["robots.arm.base.joint"]}, "is no number"),
        ({"tuning__variables__kp__paths": ["robots.arm.tips.tip.pid.kd"]}, "set by kp already"),
        ({"tuning__objective__kind": "eq45", "robots__arm__tips__tip__amnesia": None}, "tuning.variables.ta"),
        ({"tuning__variables__kp__paths": ["simulation.duration"]}, "does not depend on it"),
    ],
)
def test_variables_that_lead_nowhere_are_told_with_near_names(small, changes, words):
    with pytest.raises(ScenarioError, match=re.escape(words)):
        build_problem(small(**changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tuning__variables__kp__lower": 400}, "lower must be below upper, found 400 and 400"),
        ({"tuning__variables__ki__lower": 0}, "a log scale needs a lower bound above 0"),
        ({"tuning__sets": {"two": ["kp", "tta"]}}, "did you mean ta"),
        ({"tuning__sets": {"two": []}}, "no variable"),
        ({"tuning__methods": ["gaa"]}, "tuning.methods"),
        ({"tuning__objective__kind": "isee"}, "tuning.objective.kind"),
        ({"tuning__budgett": 3}, "did you mean budget"),
    ],
)
def test_a_section_that_makes_no_sense_is_refused(small, changes, words):
    with pytest.raises(ScenarioError, match=re.escape(words)):
        small(**changes)


def test_names_of_methods_variants_and_sets_are_checked(small, interpreted):
    with pytest.raises(SpaceRobotError, match="did you mean nlp"):
        tune(small(), "nlpp", effort=EFFORT)
    with pytest.raises(ScenarioError, match="did you mean base"):
        compare(small(), variants=["bas"])
    with pytest.raises(ScenarioError, match="did you mean two"):
        compare(small(), sets=["twoo"])
    with pytest.raises(ScenarioError, match="no tuning section"):
        compare(small(tuning=None))
    with pytest.raises(ScenarioError, match="no variable or set 'kq'"):
        build_problem(small(), variables=["kq"])


def test_ctrl_c_in_a_rollout_keeps_what_was_found(small, monkeypatch):
    from optim.problem.tuning_problem import TuningProblem

    real, calls = TuningProblem.evaluate, threading.local()
    calls.n = 0

    def evaluate(self, u):
        calls.n += 1
        if calls.n > 3:
            raise KeyboardInterrupt
        return real(self, u)

    monkeypatch.setattr(TuningProblem, "evaluate", evaluate)
    made = compare(small(), variants=["base"], sets=["two"], methods=["ga", "nlp"], effort=EFFORT)
    assert made.interrupted
    assert list(made.problems[0].outcomes) == ["ga"]
    assert np.isfinite(made.problems[0].outcomes["ga"].best.objective)


@pytest.fixture(scope="module")
def app():
    made = typer.Typer()
    COMMANDS.find("tune").join(made)
    COMMANDS.find("compare").join(made)
    return made


def test_the_commands(app, small_file, tmp_path, monkeypatch):
    monkeypatch.setattr("viz.report.sections.to_bytes", lambda *_: b"<svg/>")  # figures of single results
    runner = CliRunner()
    few = ["--budget", "24", "--runs", "1", "--starts", "1", "--variants", "base", "--sets", "two"]
    asked = [
        "compare",
        str(small_file),
        "--methods",
        "ga,nlp",
        *few,
        "--out",
        str(tmp_path / "c"),
        "--report",
    ]
    done = runner.invoke(app, asked, catch_exceptions=False)
    assert done.exit_code == 0
    assert "base-two" in done.output
    assert "lowest expected running time" in done.output.split("base-two")[0]  # the conclusion comes first
    text = (tmp_path / "c" / "comparison.md").read_text()
    assert text.startswith("**")
    assert "of the generated code" in text
    for name in ("convergence", "running_times", "sensitivities", "robustness"):
        assert (tmp_path / "c" / "base-two" / "figures" / f"{name}.svg").is_file()
    assert (tmp_path / "c" / "figures" / "data_profiles.svg").is_file()
    assert "lowest expected running time" in (tmp_path / "c" / "report.html").read_text()
    assert Result.load(tmp_path / "c" / "base-two" / "nlp").completed
    asked = [
        "tune",
        str(small_file),
        "--method",
        "manual",
        "--variables",
        "four",
        "--out",
        str(tmp_path / "t"),
    ]
    done = runner.invoke(app, asked, catch_exceptions=False)
    assert done.exit_code == 0
    assert "step by step" in done.output
    assert json.loads((tmp_path / "t" / "tuning.json").read_text())["runs"][0]["log"]
