"""Every method against problems whose optima are known by hand, through the adapters that scenes use."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest

from optim.evolutionary import METHODS, Protocol, evolve
from optim.kkt import kkt_residual
from optim.nlp import NlpSettings, _Guard, choose_starts, solve
from optim.protocol import Cost
from optim.search import Search, better
from spacerobot.errors import SpaceRobotError
from tests.oracles.known_optima import Walled, chebyshev, constrained, mixed, quadratic, rosenbrock

SMALL = Protocol(population=20, budget=1200)


@pytest.mark.parametrize("method", METHODS)
def test_evolutionary_methods_find_a_quadratic_minimum(method):
    problem = quadratic()
    run = evolve(Search(problem, method, seed=3), SMALL)
    assert run.objective < 1e-3
    assert np.abs(run.u - problem.optimum).max() < 0.03
    assert run.cost.rollouts == problem.calls <= SMALL.budget
    assert [m.objective for m in run.history] == sorted((m.objective for m in run.history), reverse=True)


@pytest.mark.parametrize("method", METHODS)
def test_a_diverged_rollout_is_infeasible_not_a_number(method):
    run = evolve(Search(quadratic(Walled), method, seed=1), SMALL)
    assert run.feasible
    assert run.u[0] <= 0.6
    assert run.objective < 2e-3


@pytest.mark.parametrize("method", METHODS)
def test_constraints_hold(method):
    run = evolve(Search(constrained(), method, seed=5), SMALL)
    assert run.feasible
    assert run.objective == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_the_same_seed_gives_the_same_answer_and_another_seed_another(method):
    first, again, other = (evolve(Search(quadratic(), method, seed=s), SMALL) for s in (0, 0, 1))
    assert np.array_equal(first.u, again.u)
    assert not np.array_equal(first.u, other.u)


def test_the_crossover_probability_falls_as_in_the_paper(monkeypatch):
    import optim.evolutionary as module

    seen, anneal = [], module._anneal

    def spy(algorithm, protocol, share):
        anneal(algorithm, protocol, share)
        seen.append(float(algorithm.mating.crossover.prob.get()))

    monkeypatch.setattr(module, "_anneal", spy)
    evolve(Search(quadratic(), "ga", seed=0), Protocol(population=10, budget=200))
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
    run = solve(Search(problem, "nlp"), problem.start, NlpSettings(patience=20, tolerance=1e-8))
    assert run.feasible
    assert run.objective == pytest.approx(value, abs=2e-5)
    assert np.abs(run.u - problem.optimum).max() < 5e-3
    assert run.status in ("converged", "settled")
    assert run.kkt is not None


def test_gauss_newton_needs_fewer_iterations_than_l_bfgs():
    newton, quasi = (
        solve(Search(p, "nlp"), p.start, NlpSettings(patience=50))
        for p in (rosenbrock("squares"), rosenbrock("smooth"))
    )
    assert newton.cost.gradients < quasi.cost.gradients


def test_the_first_order_residual_vanishes_at_optima_and_nowhere_else():
    for problem in (quadratic(), chebyshev(), constrained()):
        there = kkt_residual(problem.optimum, problem.parts(problem.optimum), problem.form)
        away = kkt_residual(problem.start, problem.parts(problem.start), problem.form)
        assert away > 0.5
        assert there < 0.02 or problem.parts(problem.optimum).objective < 1e-12


def test_an_active_bound_counts_as_optimal():
    problem = quadratic()
    problem.optimum = np.array([-0.5, 0.7, 0.2])
    run = solve(Search(problem, "nlp"), problem.start, NlpSettings(tolerance=1e-8, patience=30))
    assert run.u[0] == pytest.approx(0, abs=1e-3)
    assert run.kkt < 0.02


def test_the_nlp_backs_away_from_diverged_rollouts():
    problem = quadratic(Walled)
    problem.optimum = np.array([0.59, 0.7, 0.2])
    run = solve(Search(problem, "nlp"), np.array([0.1, 0.1, 0.9]), NlpSettings(patience=30))
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


def test_starts_are_seeded_good_and_apart():
    def starts(seed):
        return choose_starts(Search(quadratic(), "nlp", seed=seed), 4, NlpSettings())

    assert np.array_equal(starts(1), starts(1))
    assert not np.array_equal(starts(1), starts(2))
    found = starts(1)
    assert np.array_equal(found[0], quadratic().start)
    assert min(np.abs(a - b).max() for i, a in enumerate(found) for b in found[:i]) > 0.2


def test_interrupting_keeps_the_best_so_far():
    for method in (*METHODS, "nlp"):
        problem = quadratic()
        problem.interrupt_at = 200 if method != "nlp" else 4
        search = Search(problem, method)
        run = solve(search, problem.start, NlpSettings()) if method == "nlp" else evolve(search, SMALL)
        assert run.status == "interrupted"
        assert run.feasible
        assert np.isfinite(run.objective)


@pytest.mark.parametrize("delay_s", [0.05, 0.11, 0.17])
def test_ctrl_c_is_not_lost_inside_ipopt(delay_s, capfd):
    problem = rosenbrock("smooth")
    linearise, handler = problem.linearise, signal.getsignal(signal.SIGINT)

    def slow(u):
        time.sleep(0.02)
        return linearise(u)

    problem.linearise = slow
    timer = threading.Timer(delay_s, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    run = solve(Search(problem, "nlp"), problem.start, NlpSettings(patience=1000, tolerance=1e-14))
    timer.join()
    assert run.status == "interrupted"
    assert run.seconds < delay_s + 0.5
    assert np.isfinite(run.objective)
    assert signal.getsignal(signal.SIGINT) is handler
    assert capfd.readouterr() == ("", "")


def test_the_books_tell_each_kind_and_the_point_that_improved():
    problem = quadratic()
    search = Search(problem, "ga")
    search.evaluate(np.array([[0.5, 0.5, 0.5], [0.9, 0.9, 0.9], [0.3, 0.7, 0.3], [0.0, 0.0, 0.0]]))
    search.linearise(problem.optimum)
    assert [m.cost.rollouts for m in search.history] == [1, 3, 4, 4]
    assert [m.cost.gradients for m in search.history] == [0, 0, 0, 1]
    assert Cost(3, 2, 5).equivalent(4.0, 3.0) == 3 + 8 + 15
    assert str(Cost(3, 0, 5)) == "3 rollouts, 5 slopes"


def test_feasible_points_beat_infeasible_ones():
    assert better(5.0, 0.0, 1.0, 0.1)
    assert not better(1.0, 0.1, 5.0, 0.0)
    assert better(9.0, 0.1, 1.0, 0.2)
    assert better(1.0, 0.0, 2.0, 0.0)


def test_an_unknown_method_names_the_near_ones():
    with pytest.raises(SpaceRobotError, match="did you mean cmaes"):
        evolve(Search(quadratic(), "cmae"), SMALL)


@pytest.mark.parametrize(
    ("gradient", "warm", "iterations"),
    [(0.0, False, 3), (1.0, False, 4), (1.0, True, 8), (0.0, True, 4), (1e-3, True, 4)],
)
def test_patience_depends_on_the_residual(gradient, warm, iterations):
    """An optimum is left alone at once; a nearly optimal start that is none gets as many iterations again."""
    problem = quadratic()
    search = Search(problem, "nlp")
    search.evaluate(problem.start[None])
    flat = problem.build(1.0, np.array([gradient, 0.0, 0.0]))
    guard = _Guard(search, NlpSettings(patience=4), flat, warm=warm)
    assert [guard.stop() for _ in range(iterations)] == [False] * (iterations - 1) + [True]
    assert guard.optimal == (gradient == 0)


def test_an_infeasible_start_is_given_up_only_when_it_gets_no_better():
    problem = constrained()
    search = Search(problem, "nlp")
    guard = _Guard(search, NlpSettings(patience=3), problem.parts(np.array([1.0, 1.0])), warm=False)
    stops = []
    for i in range(12):
        guard.linearise(np.array([1.0, max(0.9 - 0.1 * i, 0.3)]))  # nearer to the limit, then stuck
        stops.append(guard.stop())
    assert stops.index(True) == 6 + 3
