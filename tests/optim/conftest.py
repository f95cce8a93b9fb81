"""A small scene with a tuning problem."""

import pytest

from spacerobot.scene import load_scene
from tests.oracles import one_arm

TUNING = {
    "variables": {
        "kp": {"paths": "robots.*.tips.tip.pid.kp", "lower": 20, "upper": 400},
        "ki": {"paths": "robots.arm.tips.tip.pid.ki", "lower": 1, "upper": 300, "scale": "log"},
        "kd": {"paths": "robots.arm.tips.tip.pid.kd", "lower": 20, "upper": 100},
        "ta": {"paths": "robots.arm.tips.tip.amnesia.ta", "lower": 0.5, "upper": 20, "scale": "log"},
        "grip": {"paths": ["grasps.left.stiffness", "grasps.left.damping"], "lower": 20, "upper": 100},
    },
    "sets": {"two": ["kp", "ta"], "four": ["kp", "ki", "kd", "ta"]},
    "variants": {
        "base": {"robots.*.tips.tip.pid.feedback": "base"},
        "inertial": {"robots.*.tips.tip.pid.feedback": "inertial"},
    },
    "objective": {"kind": "ise"},
    "robustness": {"plants": 8},
    "budget": 120,
    "baseline_budget": 120,
    "population": 12,
    "runs": 2,
    "starts": 2,
    "iterations": 25,
    "step": 0.01,
}


LOADED = ["distributed.nanny", "optim.campaign", "optim.robust.problem", "optim.tuning", "optim.workers.dask"]


@pytest.fixture(scope="module")
def forked_workers():
    """Workers that Dask starts are forks of a process that has loaded its libraries already.

    A fresh Python, as users have it, takes each worker 2 s to load them first. Every module that starts a
    worker in this way compiles with the same flags, which a fork has from the first of them.
    """
    dask = pytest.importorskip("dask")
    utils = pytest.importorskip("distributed.utils")
    with dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}):
        utils.get_mp_context().set_forkserver_preload(LOADED)
        yield


@pytest.fixture(scope="session")
def small_file(tmp_path_factory):
    return one_arm.write(
        tmp_path_factory.mktemp("small"),
        tuning=TUNING,
        simulation={"duration": 1.0, "step": 0.005, "output_step": 0.05},
    )


@pytest.fixture(scope="session")
def small(small_file):
    """Function of changes that gives the small scene."""
    return lambda **changes: load_scene(small_file, {k.replace("__", "."): v for k, v in changes.items()})
