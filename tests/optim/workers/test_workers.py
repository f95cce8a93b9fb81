"""Searches on threads, taking turns, and on Dask: the same bits whoever works and whoever dies."""

import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

from optim.methods.evolutionary import evolve
from optim.methods.nlp import solve
from optim.methods.settings import EvolutionSettings, NlpSettings
from optim.problem import worker_operations
from optim.problem.tuning_problem import build_problem
from optim.search.search import Search
from optim.tuning import tune
from optim.workers import Threads
from optim.workers.concurrent_searches import TurnLock
from spacerobot.common.errors import SpaceRobotError
from tests.oracles.known_optima import constrained, quadratic, rosenbrock

distributed = pytest.importorskip("distributed")


class Waiting:
    """A problem that waits for its values as if others worked them out."""

    def __init__(self, problem, turns, seconds=0.0):
        self._problem, self._turns, self._seconds = problem, turns, seconds

    def __getattr__(self, name):
        return getattr(self._problem, name)

    def evaluate(self, u):
        with self._turns.away():
            time.sleep(self._seconds)
        return self._problem.evaluate(u)

    def sample(self, u):
        with self._turns.away():
            time.sleep(self._seconds)
        return self._problem.sample(u)


def searches(make):
    """CMA-ES draws from NumPy's global state."""
    found = [
        partial(evolve, Search(make(quadratic()), "cmaes", seed=s), EvolutionSettings(budget=400))
        for s in (1, 2)
    ]
    found.append(partial(evolve, Search(make(constrained()), "ga", seed=3), EvolutionSettings(20, 400)))
    for start in ([0.2, 0.75], [0.9, 0.1]):
        search = Search(make(rosenbrock("squares")), "nlp")
        found.append(partial(solve, search, np.array(start), NlpSettings()))
    return found


def test_searches_that_take_turns_end_as_they_do_alone():
    turns = TurnLock()
    alone = [search() for search in searches(lambda problem: problem)]
    together = turns.together(searches(lambda problem: Waiting(problem, turns)))
    for one, other in zip(alone, together, strict=True):
        assert np.array_equal(one.u, other.u)
        assert one.objective == other.objective
        assert one.cost == other.cost
        assert (one.status, one.message) == (other.status, other.message)


def test_only_one_search_computes_at_a_time_while_all_wait_side_by_side():
    turns, inside, most, begun = TurnLock(), [0], [0], threading.Barrier(4)

    class Ended:
        status = "done"

    def search():
        for _ in range(20):
            inside[0] += 1
            most[0] = max(most[0], inside[0])
            time.sleep(0.0005)
            inside[0] -= 1
            with turns.away():
                begun.wait(timeout=10)
        return Ended()

    assert len(turns.together([search] * 4)) == 4
    assert most[0] == 1


def test_a_fault_of_one_search_stops_the_others_and_is_raised():
    turns = TurnLock()

    def fault():
        with turns.away():
            time.sleep(0.05)
        raise SpaceRobotError("no")

    slow = Waiting(quadratic(), turns, 0.01)
    endless = partial(evolve, Search(slow, "ga"), EvolutionSettings(20, 10**9))
    with pytest.raises(SpaceRobotError, match="no"):
        turns.together([endless, fault])


def test_ctrl_c_ends_every_search_with_what_it_has():
    turns = TurnLock()
    problem = Waiting(quadratic(), turns, 0.001)

    pressed = []

    def tell(_report):
        if not pressed and min(search.cost.rollouts for search in both) > 100:
            pressed.append(True)
            signal.raise_signal(signal.SIGINT)

    both = [Search(problem, "ga", seed=s, progress=tell) for s in (0, 1)]
    ended = turns.together([partial(evolve, search, EvolutionSettings(20, 10**9)) for search in both])
    assert [run.status for run in ended] == ["interrupted"] * 2
    assert all(np.isfinite(run.objective) for run in ended)


def test_ctrl_c_before_anything_has_ended_is_an_interruption():
    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        TurnLock().together([interrupted])


LOCAL = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "host": "127.0.0.1"}


@pytest.fixture(scope="module")
def cluster(forked_workers):
    with distributed.LocalCluster(n_workers=2, **LOCAL) as made:
        yield made


@pytest.fixture
def dask(cluster):
    from optim.workers.dask import open_workers

    with open_workers(dask=cluster.scheduler_address) as workers:
        yield workers


def test_a_scheduler_file_leads_to_the_cluster(small, cluster, tmp_path):
    from optim.workers.dask import open_workers

    with distributed.Client(cluster) as client:
        client.write_scheduler_file(str(tmp_path / "scheduler.json"))
    problem = build_problem(small())
    with open_workers(dask=str(tmp_path / "scheduler.json")) as workers:
        there = build_problem(small(), workers=workers)
        assert np.array_equal(
            there.evaluate(problem.start[None]).objective, problem.evaluate(problem.start[None]).objective
        )


def test_a_terminals_ctrl_c_does_not_reach_the_workers():
    from dask import config

    from optim.workers.cluster import connect

    def ignored():
        return signal.getsignal(signal.SIGINT) is signal.SIG_IGN

    # as users have it: a fork would inherit the handler from where it was loaded
    with config.set({"distributed.worker.multiprocessing-method": "spawn"}), connect("local:1") as client:
        assert all(client.run(ignored).values())


@pytest.fixture
def killed(cluster):
    """Kill -9 one of the workers, once, when asked to; and say who it was."""
    victims = []

    def kill(_report):
        if not victims:
            with distributed.Client(cluster) as client:
                victims.append(next(iter(client.run(os.getpid).values())))
            os.kill(victims[0], signal.SIGKILL)

    kill.victims = victims
    return kill


def same(one, other):
    assert one.gains == other.gains
    assert one.objective == other.objective
    for a, b in zip(one.outcome.runs, other.outcome.runs, strict=True):
        assert np.array_equal(a.u, b.u)
        assert (a.method, a.index, a.cost, a.status, a.message) == (
            b.method,
            b.index,
            b.cost,
            b.status,
            b.message,
        )
        assert [m.objective for m in a.history] == [m.objective for m in b.history]


@pytest.mark.parametrize("method", ["ga", "cmaes", "nlp", "nlp_ga"])
def test_tuning_on_dask_changes_no_bit(small, dask, method):
    same(
        tune(build_problem(small(), variables=["kp", "ta"], workers=dask), method),
        tune(build_problem(small(), variables=["kp", "ta"]), method),
    )


@pytest.mark.parametrize("method", ["ga", "nlp"])
def test_a_killed_worker_changes_no_bit_and_the_journals_are_whole(small, dask, killed, tmp_path, method):
    found = tune(build_problem(small(), workers=dask), method, folder=tmp_path, progress=killed)
    assert killed.victims
    same(found, tune(small(), method))
    same(found, tune(build_problem(small(), workers=Nobody()), method, folder=tmp_path))


def test_another_client_of_this_process_disturbs_nothing(small, dask, cluster):
    def slow(_problem, rows):
        time.sleep(1.0)  # several times as long as one waits at once
        return {"rows": rows}

    problem = build_problem(small(), workers=dask)
    rows = np.arange(4.0)[:, None]
    with ThreadPoolExecutor(1) as pool:
        found = pool.submit(dask.map, problem, slow, rows, grain=4)
        time.sleep(0.5)
        with distributed.Client(cluster):
            assert np.array_equal(found.result()["rows"], rows)


class Nobody(Threads):
    """Rolls out nothing but the check of the step at the best point: all else must be in the journals."""

    def map(self, problem, operation, rows, *, grain=8):
        assert operation is worker_operations.linearisations, "a rollout is not in the journals"
        assert len(rows) == 1
        return super().map(problem, operation, rows, grain=grain)


def test_constraints_and_peaks_travel(small, dask):
    changes = {"tuning.objective": {"kind": "minimax"}, "tuning.constraints": {"max_grip_force": 6.0}}
    scene = small(**changes)
    here, there = (build_problem(scene, workers=workers) for workers in (Threads(1), dask))
    u = np.random.default_rng(0).random((11, len(here.names)))
    one, other = here.evaluate(u), there.evaluate(u)
    assert np.array_equal(one.objective, other.objective)
    assert np.array_equal(one.constraints, other.constraints)
    a, b = here.linearise(u[0]).as_arrays(), there.linearise(u[0]).as_arrays()
    assert all(np.array_equal(a[name], b[name]) for name in a)


def test_a_users_own_objective_goes_along(small, dask):
    import casadi as ca

    from optim import integral

    def own(signals):
        return integral(ca.sumsqr(signals["tip_error"]) + 1e-6 * ca.sumsqr(signals["joint_torque"]))

    one, other = (
        tune(build_problem(small(), variables=["kp"], objective=own, workers=workers))
        for workers in (None, dask)
    )
    same(one, other)


def test_a_lost_scheduler_is_one_line(small, forked_workers, monkeypatch):
    from optim.workers import cluster
    from optim.workers.dask import open_workers

    monkeypatch.setattr(cluster, "CONNECT_S", 2)
    with (
        distributed.LocalCluster(n_workers=1, **LOCAL) as made,
        open_workers(dask=made.scheduler_address) as workers,
    ):
        problem = build_problem(small(), workers=workers)
        problem.evaluate(problem.start[None])
        made.close()
        with pytest.raises(SpaceRobotError, match="lost the cluster"):
            problem.evaluate(problem.start[None])


def test_a_worker_of_another_version_is_told_apart(small, monkeypatch):
    from optim.workers import cluster

    problem = build_problem(small())
    with pytest.raises(SpaceRobotError, match="a worker has spacerobot"):
        cluster._work("0.0.0", len, problem.recipe)
