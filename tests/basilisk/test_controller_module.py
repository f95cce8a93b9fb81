"""Our controllers on Basilisk's ``MJScene``; skipped without the package bsk.

Oracle: the same scene simulated here, where the controllers are continuous.
"""

import numpy as np
import pytest

import spacerobot as sr

pytest.importorskip("Basilisk")

from Basilisk.simulation import svIntegrators

from spacerobot.common.errors import ScenarioError
from spacerobot.exports.mjcf_bodies import coordinates, model_coordinates
from tests.basilisk.flight_software import simulated

DURATION, SPEED = 1.0, 100.0  # s, and rad/s, the speed of the wheels


@pytest.fixture(scope="module")
def scene():
    """The servicer: both arms reach, wheels hold the base."""
    changes = {
        "grasps": {},
        "target": None,
        "simulation.duration": DURATION,
        "robots.servicer.actuators.wheels.viscous": 0.0,
        "robots.servicer.actuators.wheels.coulomb": 0.0,
    }
    for tip, way in (("left_tip", [0.1, 0, 0.05]), ("right_tip", [0.05, -0.05, 0])):
        line = {"kind": "line", "displacement": way, "duration": DURATION}
        changes[f"robots.servicer.tips.{tip}.reference"] = line
    return sr.load_scene("servicer-wheels", changes)


def final_state(scene, period):
    """Final state of the bodies in Basilisk, without the wheels' angles."""
    module = sr.make_basilisk_controller(scene, period=period, backend="interpreted")
    module.bodies.setIntegrator(svIntegrators.svIntegratorRK4(module.bodies))
    simulated(period, DURATION, module.bodies, module)
    final = module.bodies.stateOutMsg.read()
    q, v, speeds = model_coordinates(scene, np.ravel(final.qpos), np.ravel(final.qvel), {1: 4})
    return np.concatenate([*coordinates(scene, q, v), speeds[1] / SPEED])


def test_the_bodies_move_as_here_in_second_order(scene):
    result = sr.simulate(scene, backend="interpreted")
    speeds = result.data.wheel_speed.values[-1]
    here = np.concatenate([*coordinates(scene, result.array("q")[-1], result.array("v")[-1]), speeds / SPEED])
    assert np.abs(result.array("q")[-1] - result.array("q")[0]).max() > 0.05
    coarse, fine = (final_state(scene, period) - here for period in (0.01, 0.005))
    assert 3.6 < np.abs(coarse).max() / np.abs(fine).max() < 4.4
    assert np.abs(4 * fine - coarse).max() / 3 < 5e-6  # where both lead


def test_actuators_without_motors_are_refused():
    changes = {"robots.servicer.actuators": {"base": {"kind": "base_wrench"}}}
    with pytest.raises(ScenarioError, match=r"actuators\.base: kind base_wrench has no motor"):
        sr.make_basilisk_controller(sr.load_scene("servicer-wheels", changes))
