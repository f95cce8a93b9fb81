"""Expected running times, data profiles, the conclusion and the cost unit, against what is known by hand."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from optim.comparison.conclusion import conclusion
from optim.comparison.cost_unit import CostUnit, cost_unit_of, operations
from optim.comparison.profiles import budgets_of, profile
from optim.comparison.running_time import MethodRun, running_time, target_of, trial_of
from optim.problem.problem import EvaluationCost
from optim.problem.tuning_problem import build_problem
from optim.search.search import HistoryPoint, SearchRun
from tests.oracles.known_optima import quadratic


def trial(*steps, spent):
    costs, objectives = zip(*steps, strict=True) if steps else ((), ())
    return MethodRun(np.array(costs, dtype=float), np.array(objectives, dtype=float), spent)


def test_expected_running_time_is_what_all_spent_over_how_many_met_it():
    trials = [trial((10, 3.0), (40, 1.0), spent=100), trial((20, 2.0), spent=60), trial(spent=50)]
    found = running_time(trials, 1.5)
    assert found.expected == 40 + 60 + 50
    assert (found.met, found.runs, found.until_met, found.until_end) == (1, 3, 40, 55)
    assert found.low <= found.expected
    assert found.high == np.inf
    both = running_time(trials, 2.0)
    assert both.expected == (40 + 20 + 50) / 2
    assert running_time(trials, 0.5).expected == np.inf


def test_a_target_met_exactly_counts_and_negative_objectives_have_targets_above():
    assert trial((7, 1.01), spent=9).hit(target_of(1.0, 0.01)) == 7
    assert target_of(-2.0, 0.1) == pytest.approx(-1.8)


def test_the_intervals_of_ert_cover_the_truth_and_wilson_s_are_known():
    # a geometric race: each run meets the target at cost 10 with probability 0.5, or ends at 30 without
    rng, covered = np.random.default_rng(3), 0
    for _ in range(200):
        drawn = [trial((10, 0.0), spent=10) if rng.random() < 0.5 else trial(spent=30) for _ in range(30)]
        found = running_time(drawn, 0.0)
        covered += found.low <= 10 + 30 <= found.high
    assert 165 <= covered <= 195
    five = running_time([trial((1, 0.0), spent=1)] * 5, 0.0)
    z = 1.6448536269514722
    assert five.rate_low == pytest.approx(1 / (1 + z**2 / 5))
    assert five.rate_high == pytest.approx(1.0)


def test_a_run_is_charged_what_came_before_it():
    history = (
        HistoryPoint(EvaluationCost(1), 0.1, np.inf),
        HistoryPoint(EvaluationCost(2), 0.2, 5.0),
        HistoryPoint(EvaluationCost(2, 1), 0.3, 4.0),
    )
    run = SearchRun(
        "nlp", 0, 0, np.zeros(1), 4.0, 0.0, EvaluationCost(3, 1), 0.4, "converged", history=history
    )
    made = trial_of(run, CostUnit(100, 4.0, 2.0, 1.5), EvaluationCost(rollouts=10, slopes=1))
    assert made.costs.tolist() == [14, 18]
    assert made.objectives.tolist() == [5, 4]
    assert made.spent == 19


def test_profiles_count_contests_alike_and_rise():
    never = np.inf
    one = np.array([[10.0, 100.0], [20.0, never]])  # 2 runs, 2 targets
    other = np.array([[50.0, never]])
    budgets = np.array([5.0, 10.0, 60.0, 1e3])
    found = profile([one, other], budgets)
    assert found.share == pytest.approx([0, (0.25 + 0) / 2, (0.5 + 0.5) / 2, (0.75 + 0.5) / 2])
    assert (found.low <= found.share).all()
    assert (found.share <= found.high).all()
    assert budgets_of({"a": [one], "b": [other]})[[0, -1]] == pytest.approx([5, 100])
    assert len(budgets_of({"a": [np.full((1, 1), never)]}))


def times(*expected, met=5, until=None, low=None, high=None):
    return {
        "running_times": [
            {
                "expected": e,
                "low": e if low is None else low,
                "high": e if high is None else high,
                "met": met,
                "runs": 5,
                "until_met": e if until is None else until,
            }
            for e in expected
        ]
    }


def test_the_verdict_says_who_is_ahead_where_and_why():
    problems = [
        {"name": "one", "methods": {"ga": times(90, 900, 9e3), "nlp": times(70, 80, 90)}},
        {"name": "two", "methods": {"ga": times(5, 50, 60), "nlp": times(70, 80, 50)}},
        {"name": "three", "methods": {"ga": times(5, 50, 500), "nlp": times(9, 90, 90, met=2, until=40)}},
    ]
    said = conclusion({"precisions": [0.1, 0.01, 0.001], "problems": problems})
    assert said.startswith(
        "nlp has the lowest expected running time to 1 % on 1 and to 0.1 % on 3 of 3 benchmark problems"
    )
    assert "two to 1 %, ga (50 rollouts against 80: runs of nlp take longer to reach the target)" in said
    assert "three to 1 %, ga (50 rollouts against 90: nlp reaches it in 2 of 5 runs, ga in 5 of 5)" in said
    problems[1]["methods"]["nlp"] = times(None, None, None, met=0)
    problems.append(problems[0] | {"name": "four"})
    assert "two to 1 %, ga (nlp reaches it in none of 5 runs)" in conclusion(
        {"precisions": [0.1, 0.01, 0.001], "problems": problems}
    )
    alone = [{"name": "one", "methods": {"nlp": times(70, 80, 90)}}]
    assert "Fewer than two" in conclusion({"precisions": [0.1, 0.01, 0.001], "problems": alone})


def test_operations_are_what_a_function_computes():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    f = ca.Function("f", [x, y], [ca.sin(x * y) + 2 * x, x])
    assert operations(f) == 4


def test_prices_follow_from_the_functions_that_are_evaluated(small):
    problem = build_problem(small(), variables=["kp", "ta"])
    found, kernel = cost_unit_of(problem), problem.rollout.kernel
    stages = kernel.method.stages
    step = stages * operations(kernel.functions["dynamics"]) + operations(kernel.functions["normalise"])
    assert found.operations == pytest.approx(problem.rollout.grid.steps * step, rel=0.05)
    assert 2 < found.gradient < 5  # the reverse of a function costs at most four times the function
    assert 1.5 < found.slope < 3.5
    assert 1 < found.sample < 1.5
    assert found.rollouts(EvaluationCost(10, 2, 3)) == pytest.approx(
        10 + 2 * found.gradient + 3 * found.slope
    )


def test_a_longer_tape_is_integrated_again_and_paid_for(small):
    short = cost_unit_of(build_problem(small(), variables=["kp"]))
    long = cost_unit_of(build_problem(small(**{"simulation__duration": 400.0}), variables=["kp"]))
    assert long.gradient == pytest.approx(short.gradient + 1, abs=0.1)


def test_searches_of_a_problem_without_a_scene_have_trials_too():
    from optim.methods.run_method import run_method
    from optim.methods.settings import Effort, EvolutionSettings

    tiny = EvolutionSettings(population=10, budget=60)
    runs = run_method(quadratic(), "ga", Effort(tiny, tiny, runs=2)).runs
    made = [trial_of(run, CostUnit(1, 4.0, 2.0, 1.0)) for run in runs]
    assert all(one.spent == 60 for one in made)
    assert all((np.diff(one.objectives) < 0).all() and (np.diff(one.costs) >= 0).all() for one in made)
