"""A small scene with a campaign."""

import pytest

from spacerobot.scene import load_scene
from tests.oracles import one_arm

CAMPAIGN = {
    "parameters": {
        "mass": {"paths": "target.links.body.mass", "lower": 10, "upper": 30},
        "spin": {"paths": "target.base.spin_deg.2", "lower": -2, "upper": 2},
        "com": {"paths": "target.links.body.com.0", "kind": "normal", "mean": 0, "std": 0.01},
        "grip": {"paths": "grasps.*.stiffness", "apply": "factor", "lower": 0.5, "upper": 2},
    },
    "gains": {"soft": {"robots.*.tips.tip.pid.kp": 50}, "stiff": {"robots.*.tips.tip.pid.kp": 300}},
    "samples": 100,
    "limits": {"grip_force": 7.0},
    "step": 0.01,
}


@pytest.fixture(scope="session")
def small_file(tmp_path_factory):
    return one_arm.write(tmp_path_factory.mktemp("small"), campaign=CAMPAIGN)


@pytest.fixture(scope="session")
def small(small_file):
    """Function of changes that gives the small scene."""
    return lambda **changes: load_scene(small_file, {k.replace("__", "."): v for k, v in changes.items()})
