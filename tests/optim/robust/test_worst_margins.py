"""Least margins over uncertain parameters: against a grid, inside the range, and in the scenario itself."""

import itertools

import numpy as np
import pytest

from optim.problem.varied_parameters import vary
from optim.robust.worst_margins import worst_margins
from spacerobot.common.errors import SpaceRobotError
from spacerobot.linear import margins
from spacerobot.scene import build_scene
from tests.linear.scenes import arm_scene

HOLD = "robots.arm.controllers.hold"
SAMPLED = {"sampled": {"period": 0.05, "delay": 0.02}}
NAME = "torque/arm/joint_1"


def ranged(scene, ranges):
    return vary(scene, [f"{path}={low}..{high}" for path, low, high in ranges.values()])


def own(scene, margin, at=(0.0,)):
    """Margin of the loop, of a scene built anew."""
    (loops,) = margins(scene, at, backend="interpreted").loops
    return getattr(next(one for one in loops if one.name == NAME), margin)


@pytest.mark.parametrize("margin", ["disk", "phase"])
def test_a_grid_finds_no_smaller_margin(margin):
    """By a gain, within whose range the margin has a maximum, and the delay."""
    scene = arm_scene(1, "planar", **SAMPLED)
    ranges = {
        "kd": (f"{HOLD}.kd", 2.0, 6.0),
        "delay": (f"{HOLD}.sampled.delay", 0.01, 0.05),
    }
    found = worst_margins(ranged(scene, ranges), margin=margin, loops=NAME, backend="interpreted")
    (case,) = found.cases
    assert case.nominal == pytest.approx(own(scene, margin), rel=1e-9)
    axes = [np.linspace(low, high, 3) for _, low, high in ranges.values()]
    paths = [path for path, _, _ in ranges.values()]
    grid = [
        own(build_scene(scene.scenario, dict(zip(paths, point, strict=True)), source=scene.source), margin)
        for point in itertools.product(*(axis.tolist() for axis in axes))
    ]
    assert case.value <= min(grid) * (1 + 1e-9)
    assert case.value == pytest.approx(min(grid), rel=0.02)
    assert case.simulated == pytest.approx(case.value, rel=1e-9)


def test_an_instability_within_the_range_is_negative():
    scene = arm_scene(1, "planar", **SAMPLED)
    scene = ranged(scene, {"kd": (f"{HOLD}.kd", 1.0, 60.0)})
    found = worst_margins(scene, loops=NAME, backend="interpreted")
    assert found.cases[0].value < 0 < found.cases[0].nominal


def test_a_delay_that_outgrows_the_queue_is_refused():
    """By a period or more longer than the scenario's, it is not kept; a little less is as in a scenario."""
    scene = arm_scene(1, "planar", **SAMPLED)
    with pytest.raises(SpaceRobotError, match="delay that is longer than the scenario's by a period or more"):
        worst_margins(ranged(scene, {"delay": (f"{HOLD}.sampled.delay", 0.02, 0.2)}), backend="interpreted")
    delay = 0.099  # two periods are kept
    found = worst_margins(
        ranged(scene, {"delay": (f"{HOLD}.sampled.delay", 0.02, delay)}), loops=NAME, backend="interpreted"
    )
    longest = build_scene(scene.scenario, {f"{HOLD}.sampled.delay": delay}, source=scene.source)
    assert found.cases[0].value == pytest.approx(own(longest, "disk"), rel=1e-9)


def test_names_that_are_wrong():
    scene = ranged(arm_scene(1), {"kd": (f"{HOLD}.kd", 1.0, 60.0)})
    with pytest.raises(SpaceRobotError, match="no margin 'disc'"):
        worst_margins(scene, margin="disc", backend="interpreted")
    with pytest.raises(SpaceRobotError, match=r"no break point 'wheel/\*'"):
        worst_margins(scene, loops="wheel/*", backend="interpreted")
