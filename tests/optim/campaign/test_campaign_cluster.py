"""A campaign on Dask: the same bits, whoever works and whoever dies."""

import os
import signal
import sys

import pytest
import xarray as xr

from optim.campaign import LocalExecutor, load_campaign, run_campaign
from optim.campaign.cluster import DaskExecutor
from optim.campaign.rollouts.evaluator import build_evaluator
from optim.workers.cluster import connect
from spacerobot.common.errors import SpaceRobotError

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def plain(small, tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain") / "store"
    run_campaign(small(), folder, executor=LocalExecutor())
    return load_campaign(folder)


def test_a_worker_changes_no_bit(small, plain, tmp_path):
    """By a worker that loads everything first, as users have it."""
    from dask import config

    with config.set({"distributed.worker.multiprocessing-method": "spawn"}):
        run_campaign(small(), tmp_path / "store", executor=DaskExecutor("local:1", size=9))
    xr.testing.assert_identical(load_campaign(tmp_path / "store"), plain)


def test_two_workers_and_a_killed_one_change_no_bit(small, plain, forked_workers, tmp_path):
    """Kill -9 of a worker in the middle, seen through a cluster reached by its address."""
    options = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "host": "127.0.0.1"}
    with distributed.LocalCluster(n_workers=2, **options) as cluster, distributed.Client(cluster) as client:
        victims = list(client.run(os.getpid).values())
        killed = []

        def kill(progress):
            if progress.done > 20 and not killed:
                killed.append(victims[0])
                os.kill(victims[0], signal.SIGKILL)

        dask = DaskExecutor(cluster.scheduler_address, size=5)
        found = run_campaign(small(), tmp_path / "store", executor=dask, progress=kill)
    assert killed
    assert found.done == 100
    xr.testing.assert_identical(load_campaign(tmp_path / "store"), plain)


def test_a_recipe_builds_the_same_campaign(small):
    from optim.campaign.rollouts.evaluator import all_draws

    evaluator = build_evaluator(small())
    draws = all_draws(evaluator)
    again = evaluator.recipe.build()
    assert again.identity(draws) == evaluator.identity(draws)
    assert again.recipe == evaluator.recipe


@pytest.mark.parametrize("address", ["local:0", "local:x", "nowhere.json"])
def test_addresses_that_are_none(address):
    with pytest.raises(SpaceRobotError, match="allowed: local:N"), connect(address):
        pass


def test_without_dask_it_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SpaceRobotError, match=r"pip install 'dask\[distributed\]'"), connect("local:1"):
        pass


def test_nothing_imports_dask_before_it_is_asked_for():
    import subprocess

    code = "import sys, optim.campaign, optim.campaign.cluster, spacerobot.cli.commands.campaign as c; "
    code += "assert not {'dask', 'distributed', 'SALib'} & set(sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
