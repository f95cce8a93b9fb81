"""Every method against problems whose optima are known by hand, through the adapters that scenes use."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from optim.methods.descent import FLAT, DescentSettings, descend
from optim.methods.evolutionary import EvolutionaryMethod, PointSearch, evolve
from optim.methods.kkt import kkt_residual
from optim.methods.local_model import EvaluatedPoint
from optim.methods.nlp import solve, solve_from_many
from optim.methods.settings import EvolutionSettings, NlpSettings
from optim.problem.problem import EvaluationCost
from optim.problem.varied_parameters import vary
from optim.search.search import Search, better
from optim.tuning import tune
from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.common.registry import TUNING_METHODS
from tests.linear.scenes import arm_scene
from tests.oracles.known_optima import (
    Walled,
    chebyshev,
    constrained,
    mixed,
    quadratic,
    rosenbrock,
    two_basins,
)

METHODS = [n for n, m in TUNING_METHODS.entries().items() if isinstance(m, EvolutionaryMethod)]
POPULATIONS = [name for name in METHODS if not isinstance(TUNING_METHODS.find(name), PointSearch)]
SMALL = EvolutionSettings(population=20, budget=1200)


@pytest.mark.parametrize("method", POPULATIONS)
def test_evolutionary_methods_find_a_quadratic_minimum(method):
    problem = quadratic()
    run = evolve(Search(problem, method, seed=3), SMALL)
    assert run.objective < 1e-3
    assert np.abs(run.u - problem.optimum).max() < 0.03
    assert run.cost.rollouts == problem.calls <= SMALL.budget
    assert [m.objective for m in run.history] == sorted((m.objective for m in run.history), reverse=True)


@pytest.mark.parametrize("method", POPULATIONS)
def test_a_diverged_rollout_is_infeasible_not_a_number(method):
    run = evolve(Search(quadratic(Walled), method, seed=1), SMALL)
    assert run.feasible
    assert run.u[0] <= 0.6
    assert run.objective < 2e-3


@pytest.mark.parametrize("method", POPULATIONS)
def test_constraints_hold(method):
    run = evolve(Search(constrained(), method, seed=5), SMALL)
    assert run.feasible
    assert run.objective == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_the_same_seed_gives_the_same_answer_and_another_seed_another(method):
    first, again, other = (evolve(Search(quadratic(), method, seed=s), SMALL) for s in (0, 0, 1))
    assert np.array_equal(first.u, again.u)
    assert not np.array_equal(first.u, other.u)


@pytest.mark.parametrize("method", POPULATIONS)
def test_a_population_that_has_converged_is_begun_anew_within_the_budget(method):
    problem = two_basins()
    points = []
    evaluate = problem.evaluate
    problem.evaluate = lambda u: points.append(u) or evaluate(u)
    run = evolve(Search(problem, method, seed=2), EvolutionSettings(population=10, budget=6000))
    spread = np.array([np.ptp(u, axis=0).max() for u in points])
    assert run.status == "budget spent"
    assert run.cost.rollouts <= 6000
    assert run.cost.rollouts > 5900 - 40 * 10
    tight = int(np.flatnonzero(spread < 0.05)[0])
    assert spread[tight:].max() > 0.5  # wide again
    if method != "cmaes":
        assert "begun" in run.message


@pytest.mark.parametrize("method", [*METHODS, "nlp"])
def test_every_method_tries_the_start_among_its_first_points(method):
    """So that none knows more of the problem than another."""
    problem, batches = quadratic(), []
    for name in ("evaluate", "sample"):
        ask = getattr(problem, name)
        setattr(problem, name, lambda u, ask=ask: batches.append(np.atleast_2d(u)) or ask(u))
    search = Search(problem, method, seed=3)
    if method == "nlp":
        solve_from_many(search, NlpSettings(), 2)
    else:
        evolve(search, SMALL)
    assert (batches[0][0] == problem.start).all()


@pytest.mark.parametrize("method", ["sobol", "random"])
def test_a_search_without_a_method_is_the_floor(method):
    run = evolve(Search(quadratic(), method, seed=3), EvolutionSettings(budget=200))
    assert run.cost.rollouts == 200
    assert run.status == "budget spent"
    assert run.objective < 5


def test_the_crossover_probability_falls_as_in_the_paper(monkeypatch):
    import optim.methods.evolutionary as module

    seen, anneal = [], module._anneal

    def spy(algorithm, protocol, share):
        anneal(algorithm, protocol, share)
        seen.append(float(algorithm.mating.crossover.prob.get()))

    monkeypatch.setattr(module, "_anneal", spy)
    evolve(Search(quadratic(), "ga", seed=0), EvolutionSettings(population=10, budget=200))
    assert seen[0] == 0.5
    assert seen[-1] == pytest.approx(0.15, abs=0.03)
    assert seen == sorted(seen, reverse=True)


@pytest.mark.parametrize(
    ("problem", "value"),
    [
        (quadratic(), 0.0),
        (rosenbrock("squares"), 0.0),
        (rosenbrock("smooth"), 0.0),
        (chebyshev(), 0.125),
        (mixed(), 0.75),
        (constrained(), 0.5),
    ],
    ids=["quadratic", "gauss-newton", "rosenbrock", "minimax", "minimax beside a smooth part", "constrained"],
)
def test_the_nlp_finds_known_optima(problem, value):
    run = solve(Search(problem, "nlp"), problem.start, NlpSettings(tolerance=1e-6))
    assert run.feasible
    assert run.objective == pytest.approx(value, abs=2e-5)
    assert np.abs(run.u - problem.optimum).max() < 5e-3
    assert run.status in ("converged", "settled")
    assert run.kkt is not None


def test_gauss_newton_needs_fewer_rollouts_than_bfgs():
    newton, quasi = (
        solve(Search(p, "nlp"), p.start, NlpSettings()) for p in (rosenbrock("squares"), rosenbrock("smooth"))
    )
    assert newton.cost.samples < quasi.cost.samples / 2


def test_the_first_order_residual_vanishes_at_optima_and_nowhere_else():
    for problem in (quadratic(), chebyshev(), constrained()):
        there = kkt_residual(problem.optimum, problem.parts(problem.optimum), problem.form)
        away = kkt_residual(problem.start, problem.parts(problem.start), problem.form)
        assert away > 0.5
        assert there < 0.02 or problem.parts(problem.optimum).objective < 1e-12


def test_an_active_bound_counts_as_optimal():
    problem = quadratic()
    problem.optimum = np.array([-0.5, 0.7, 0.2])
    run = solve(Search(problem, "nlp"), problem.start, NlpSettings(tolerance=1e-8))
    assert run.u[0] == pytest.approx(0, abs=1e-3)
    assert run.kkt < 0.02


def test_the_nlp_backs_away_from_diverged_rollouts():
    problem = quadratic(Walled)
    problem.optimum = np.array([0.59, 0.7, 0.2])
    run = solve(Search(problem, "nlp"), np.array([0.1, 0.1, 0.9]), NlpSettings())
    assert run.objective < 1e-3


def test_a_start_that_diverges_says_so():
    run = solve(Search(quadratic(Walled), "nlp"), np.array([0.9, 0.5, 0.5]), NlpSettings())
    assert run.status == "failed"
    assert "diverges" in run.message
    assert not run.feasible


def test_the_nlp_is_never_worse_than_its_start():
    problem = chebyshev()
    run = solve(Search(problem, "nlp"), problem.optimum, NlpSettings())
    assert run.objective <= problem.parts(problem.optimum).objective


def test_a_minimax_problem_needs_few_rollouts():
    """Three alternating peaks of one height make a vertex, where first derivatives say enough."""
    problem = chebyshev()
    run = solve(Search(problem, "nlp"), problem.start, NlpSettings())
    assert run.objective == pytest.approx(0.125, rel=1e-6)
    assert run.kkt < 1e-6
    assert run.cost.samples <= 1 + 2 + 3 + 2  # the start, differences, steps, differences that confirm


def test_descents_in_lockstep_share_batches_and_end_as_each_alone(monkeypatch):
    problem, sizes = rosenbrock(), []
    sample = problem.sample
    monkeypatch.setattr(problem, "sample", lambda u: sizes.append(len(u)) or sample(u))
    settings = NlpSettings(screen=2)
    together = solve_from_many(Search(problem, "nlp", seed=4), settings, 7)
    assert [entry["status"] for entry in together.log] == ["converged"] * 7
    assert together.status == "converged"
    assert max(sizes[sizes.index(4 * 2) + 1 :]) == 4 * 2  # differences of four descents at once
    again = solve_from_many(Search(rosenbrock(), "nlp", seed=4), settings, 7)
    other = solve_from_many(Search(rosenbrock(), "nlp", seed=5), settings, 7)
    assert np.array_equal(together.u, again.u)
    assert together.log == again.log
    assert together.log != other.log


def test_a_descent_where_nothing_changes_says_so():
    """As where pulses are rounded: it is no optimum. A constraint that is met changes nothing of it."""
    start = EvaluatedPoint(np.array([0.4, 0.6]), 1.0, np.array([-0.5]), np.empty(0))
    descent = descend(start, DescentSettings("smooth", exact=False, radius=0.1, steps=10, tolerance=1e-6))

    def answered():
        asked = next(descent)
        while True:
            points = [dataclasses.replace(start, u=u, constraints=u[:1] - 0.9) for u in asked.points]
            asked = descent.send(points)

    with pytest.raises(StopIteration) as ended:
        answered()
    assert ended.value.value.message == FLAT


def test_several_starts_find_the_lower_of_two_basins():
    problem = two_basins()
    alone = solve(Search(problem, "nlp"), problem.start, NlpSettings())
    several = solve_from_many(Search(problem, "nlp", seed=1), NlpSettings(screen=2), 8)
    assert alone.objective == pytest.approx(0.6, rel=1e-3)
    assert several.objective == pytest.approx(0.1, rel=1e-3)


def test_a_budget_ends_the_search():
    run = solve_from_many(Search(quadratic(), "nlp"), NlpSettings(budget=30), 1000)
    assert run.status in ("converged", "budget spent")
    assert run.cost.equivalent(4.0) <= 30 + 8 * 4 * 1.2 + 4


def test_a_start_that_breaks_a_constraint_is_led_back():
    problem = constrained()
    run = solve(Search(problem, "nlp"), np.array([1.0, 0.9]), NlpSettings())
    assert run.feasible
    assert run.objective == pytest.approx(0.5, rel=1e-3)


def test_a_problem_without_a_feasible_point_says_so():
    problem = constrained()
    parts = problem.parts
    problem.parts = lambda u: dataclasses.replace(parts(u), constraints=np.array([u.sum() + 1]))
    run = solve(Search(problem, "nlp"), problem.start, NlpSettings())
    assert run.status == "infeasible"
    assert "a constraint is passed by 100 %" in run.message


def test_interrupting_keeps_the_best_so_far():
    for method in (*METHODS, "nlp"):
        problem = quadratic()
        problem.interrupt_at = 200 if method != "nlp" else 4
        search = Search(problem, method)
        run = solve(search, problem.start, NlpSettings()) if method == "nlp" else evolve(search, SMALL)
        assert run.status == "interrupted"
        assert run.feasible
        assert np.isfinite(run.objective)


def test_the_books_tell_each_kind_and_the_point_that_improved():
    problem = quadratic()
    search = Search(problem, "ga")
    search.evaluate(np.array([[0.5, 0.5, 0.5], [0.9, 0.9, 0.9], [0.3, 0.7, 0.3], [0.0, 0.0, 0.0]]))
    search.linearise(problem.optimum)
    assert [m.cost.rollouts for m in search.history] == [1, 3, 4, 4]
    assert [m.cost.gradients for m in search.history] == [0, 0, 0, 1]
    assert EvaluationCost(3, 2, 5).equivalent(4.0, 3.0) == 3 + 8 + 15
    assert str(EvaluationCost(3, 0, 5)) == "3 rollouts, 5 directional derivatives"


def test_feasible_points_beat_infeasible_ones():
    assert better(5.0, 0.0, 1.0, 0.1)
    assert not better(1.0, 0.1, 5.0, 0.0)
    assert better(9.0, 0.1, 1.0, 0.2)
    assert better(1.0, 0.0, 2.0, 0.0)


def test_an_unknown_method_names_the_near_ones():
    with pytest.raises(SpaceRobotError, match="did you mean cmaes"):
        evolve(Search(quadratic(), "cmae"), SMALL)


def test_the_manual_procedure_says_which_variables_it_lacks():
    scene = vary(arm_scene(1), ["hold.kd=2..6"])
    with pytest.raises(
        ScenarioError, match=r"manual needs the variables kp, ki, kd, found: hold_kd"
    ) as caught:
        tune(scene, "manual")
    assert "\n" not in str(caught.value)
