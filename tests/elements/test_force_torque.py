"""Force-torque sensor: Newton's law, the torque of a joint, tools, rigid grasps, errors, messages."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from tests.oracles.gantry import TARGET_MASS, TOOL_MASS, gantry_scene
from tests.oracles.small_scenes import SPATIAL, small_scene

PERIOD = 0.005
SENSOR = {"kind": "force_torque", "errors": {"period": PERIOD}}
LAW = {"kind": "admittance", "inertia": [3, 3, 3], "stiffness": [30, 40, 1], "damping": [1, 1, 1]}
FORCE, TORQUE = "robots.arm.sensors.tip_force", "robots.arm.sensors.tip_torque"


FINE = 8
"""Steps of results in a period: a sample changes the torques, so that accelerations jump there."""


def samples(changes, signal="tip_force", grasp="compliant"):
    """Samples of the first tip, and all results."""
    step = {"simulation.output_step": PERIOD / FINE, "simulation.step": PERIOD / FINE}
    data = sr.simulate(gantry_scene(LAW, step | changes, grasp), backend="interpreted").data
    return data[f"measured_{signal}"].values[::FINE, 0], data


def rates(values):
    """Rates at the samples, but the first of them, from values before them (n-1,)."""
    last, before, first = (values[FINE - k :: FINE][: (len(values) - 1) // FINE] for k in range(3))
    return (3 * last - 4 * before + first) / (2 * PERIOD / FINE)


@pytest.mark.parametrize("grasp", ["compliant", "weld"])
def test_the_force_on_a_tip_is_the_rate_of_the_momentum_that_it_holds(grasp):
    drifts = {"robots.arm.base.velocity": [0.1, 0, 0], "simulation.duration": 1}
    force, data = samples({FORCE: SENSOR, TORQUE: SENSOR} | drifts, grasp=grasp)
    expected = -rates(data.body_momentum_linear.sel(body="target").values[:, 0])
    assert np.abs(expected).max() > 0.05
    np.testing.assert_allclose(force[1:, 0], expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("gravity", [0.0, 0.3])
@pytest.mark.parametrize("compensated", [False, True])
def test_a_tool_beyond_the_flange_adds_inertia_and_weight_unless_it_is_compensated(compensated, gravity):
    section = SENSOR | {"joint": "flange", "compensated": compensated}
    changes = {FORCE: section, "simulation.duration": 1, "gravity": [gravity, 0, 0]}
    force, data = samples(changes)
    tool = TOOL_MASS * (rates(data.tip_velocity.values[:, 0, 0]) - gravity)
    expected = TARGET_MASS * gravity - rates(data.body_momentum_linear.sel(body="target").values[:, 0])
    expected = expected - (not compensated) * tool
    assert np.abs(tool).max() > 0.02
    np.testing.assert_allclose(force[1:, 0], expected, atol=1e-3 * np.abs(expected).max())


def test_the_wrench_through_a_joint_has_the_torque_of_its_actuator_about_its_axis():
    """Spatial arm that moves, with a body in its hand: about an axis it transmits motor minus friction."""
    for joint in ("slant", "round", "wrist"):
        sensor = {"kind": "force_torque", "joint": joint, "errors": {"period": 0.05}}
        law = {"kind": "impedance", "stiffness": [4, 4, 4], "inertia": [9, 9, 9]}
        scene = small_scene(
            SPATIAL,
            {
                "robots.one.sensors": {"tip_force": sensor, "tip_torque": sensor},
                "robots.one.tips.tip.controllers.soft": law | {"sampled": {"period": 0.5, "delay": 0.01}},
                "simulation": {"duration": 0.4, "output_step": 0.05, "step": 0.005},
            },
        )
        result = sr.simulate(scene, backend="interpreted")
        data, model = result.data, scene.model
        index = model.getJointId(f"one/{joint}")
        axis = {"slant": [0.6, 0, 0.8], "round": [0, 1, 0], "wrist": [1, 0, 0]}[joint]
        friction = {"slant": 0.3, "round": 0.2, "wrist": 0.0}[joint]
        for k in (2, 5):
            q, v = (np.array(data[key].values[k]) for key in ("q", "v"))
            work = model.createData()
            pin.forwardKinematics(model, work, q, v)
            place, turned = work.oMi[index].translation, work.oMi[index].rotation @ axis
            tip = data.tip_position.values[k, 0]
            force, torque = (data[f"measured_tip_{part}"].values[k, 0] for part in ("force", "torque"))
            about = turned @ (torque + np.cross(tip - place, force))
            column = model.idx_vs[index]
            motor = data.joint_torque.sel(joint=f"one/{joint}").values[k]
            np.testing.assert_allclose(about, -(motor - friction * v[column]), rtol=1e-6)


def test_the_second_engine_measures_the_same():
    """A rigid grasp and a tool that is not compensated, with noise: everything that takes accelerations."""
    section = {"kind": "force_torque", "joint": "flange", "errors": {"period": 0.01, "noise": 0.001}}
    changes = {FORCE: section, TORQUE: section, "robots.arm.base.velocity": [0.1, 0, 0]}
    times = {"duration": 0.2, "step": 0.005, "output_step": 0.05}
    forces = []
    for engine in ("casadi", "pinocchio"):
        scene = gantry_scene(LAW, changes | {"simulation": times | {"engine": engine}}, "weld")
        forces.append(sr.simulate(scene, backend="interpreted").data.measured_tip_force.values)
    assert np.abs(forces[0]).max() > 1
    np.testing.assert_allclose(forces[1], forces[0], atol=1e-10)


def test_errors_of_a_sensor_act_on_force_and_torque():
    errors = {"period": PERIOD, "resolution": 0.5, "range": 1.0}
    force, _ = samples({FORCE: SENSOR | {"errors": errors}})
    assert np.abs(force[1:]).max() == 1.0
    np.testing.assert_allclose(force[1:] / 0.5, np.round(force[1:] / 0.5))
    torque, _ = samples({TORQUE: SENSOR | {"offset": 0.25}}, "tip_torque")
    np.testing.assert_allclose(
        torque[1:, 2], 0.25, atol=1e-9
    )  # nothing turns: the line of action meets the tip


def test_a_bias_pushes_the_tip_as_a_force_would():
    """An admittance that reads b at rest comes to b / k, less the error b / (m w^2) of its inner loop."""
    still = {"target.base.velocity": [0, 0, 0], f"{FORCE}": {"offset": 0.6}, "grasps.hold.stiffness": 0}
    law = LAW | {"damping": [20, 20, 20], "stiffness": [30, 1e6, 1]}
    changes = still | {"grasps.hold.damping": 0, "simulation.duration": 12, "robots.arm.base.joint": "fixed"}
    data = sr.simulate(gantry_scene(law, changes), backend="interpreted").data
    moved = data.tip_position.values[-1, 0, 0] - data.tip_position.values[0, 0, 0]
    assert moved == pytest.approx(0.6 / 30 - 0.6 / (5.5 * 10**2), rel=1e-4)


def test_what_cannot_be_measured_is_refused_with_its_place():
    with pytest.raises(ScenarioError, match=r"tip_velocity\.kind.*force_torque.*tip_force, tip_torque"):
        gantry_scene(LAW, {"robots.arm.sensors.tip_velocity": SENSOR})
    with pytest.raises(ScenarioError, match=r"'elbow', allowed: .*flange"):
        build_closed_loop(gantry_scene(LAW, {FORCE: SENSOR | {"joint": "elbow"}}))
    with pytest.raises(ScenarioError, match=r"tip_force.*continuous sensor.*allowed"):
        build_closed_loop(gantry_scene(LAW, {FORCE: SENSOR | {"joint": "along", "errors": None}}))
