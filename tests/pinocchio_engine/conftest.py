"""The first quarter of the paper's scenario run once by each engine."""

from types import SimpleNamespace

import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import build_rollout
from spacerobot.scene import load_scene


@pytest.fixture(scope="session")
def paper():
    scene = load_scene("paper", {"simulation.duration": 2.5})
    loop, simulation = build_closed_loop(scene), scene.scenario.simulation
    rollout = build_rollout(
        loop,
        duration_s=simulation.duration,
        step_s=simulation.step,
        output_step_s=simulation.output_step,
    )
    # tolerances that leave an error of some 1e-9: the default ones take three times as long
    checked = simulate(scene, output_step_s=0.1, rtol=1e-7, atol=1e-9)
    return SimpleNamespace(scene=scene, loop=loop, fixed_step=rollout.run(), checked=checked)
