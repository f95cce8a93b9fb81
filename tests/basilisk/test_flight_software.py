"""Basilisk's flight software on a base whose arms are simulated here; skipped without the package bsk."""

from typing import Literal

import numpy as np
import pytest

import spacerobot as sr

pytest.importorskip("Basilisk")

from Basilisk.architecture import messaging
from Basilisk.fswAlgorithms import attTrackingError, inertial3D, mrpFeedback
from Basilisk.simulation import simpleNav
from Basilisk.utilities import SimulationBaseClass, macros

from spacerobot.basilisk import BasiliskController, BasiliskModules

K, P = 200.0, 500.0


@sr.register
class MrpFeedback(BasiliskController):
    """Attitude feedback by Basilisk's chain: navigation, guidance, tracking error, mrpFeedback."""

    kind: Literal["basilisk_mrp_feedback"] = "basilisk_mrp_feedback"

    def modules(self):
        simulation = SimulationBaseClass.SimBaseClass()
        process = simulation.CreateNewProcess("process")
        process.addTask(simulation.CreateNewTask("task", macros.sec2nano(self.period)))
        state = messaging.SCStatesMsg()
        navigation, guidance = simpleNav.SimpleNav(), inertial3D.inertial3D()
        navigation.scStateInMsg.subscribeTo(state)
        guidance.sigma_R0N = [0.0, 0.0, 0.0]
        error, law = attTrackingError.attTrackingError(), mrpFeedback.mrpFeedback()
        error.attNavInMsg.subscribeTo(navigation.attOutMsg)
        error.attRefInMsg.subscribeTo(guidance.attRefOutMsg)
        law.guidInMsg.subscribeTo(error.attGuidOutMsg)
        vehicle = messaging.VehicleConfigMsg().write(messaging.VehicleConfigMsgPayload(ISCPntB_B=[0.0] * 9))
        law.vehConfigInMsg.subscribeTo(vehicle)
        law.K, law.P, law.Ki = K, P, -1.0
        for module in (navigation, guidance, error, law):
            simulation.AddModelToTask("task", module)
        self.__dict__["kept"] = (vehicle, navigation, guidance, error, law)
        return BasiliskModules(simulation, state, torques=(law.cmdTorqueOutMsg,))


def fly(period, duration=20.0):
    base = {"joint": "free_flyer", "rotation_deg": [20.0, -10.0, 30.0], "spin_deg": [1.0, -2.0, 0.5]}
    changes = {
        "grasps": {},
        "target": None,
        "robots.servicer.base": base,
        "robots.servicer.tips": {},
        "robots.servicer.joints.left_joint_1.rate_deg": 5.0,
        "robots.servicer.controllers": {"fsw": {"kind": "basilisk_mrp_feedback", "period": period}},
        "robots.servicer.actuators": {"base": {"kind": "base_wrench"}},
        "simulation.duration": duration,
        "simulation.output_step": 0.1,
    }
    return sr.simulate(sr.load_scene("servicer", changes), backend="interpreted")


@pytest.fixture(scope="module")
def result():
    return fly(0.1)


def test_the_base_turns_to_the_reference(result):
    from scipy.spatial.transform import Rotation

    angles = Rotation.from_quat(result.data.body_orientation.sel(body="servicer")).magnitude()
    assert angles[-1] < 0.4 * angles[0]


def test_momentum_closes_over_both_sides(result):
    """The change of the scene's angular momentum is the impulse of the torques that Basilisk commands.

    The torque is computed again from the law, K sigma + P omega, at each update, and held for a period.
    """
    from scipy.spatial.transform import Rotation

    data = result.data
    rotation = Rotation.from_quat(data.body_orientation.sel(body="servicer").values)
    sigma = rotation.as_mrp()
    spin = result.array("v")[:, 3:6]
    torque = rotation.apply(-K * sigma - P * spin)
    impulse = np.cumsum(torque[:-1] * np.diff(data.time.values)[:, None], axis=0)
    change = data.momentum_angular.values[1:] - data.momentum_angular.values[0]
    assert np.abs(change).max() > 1
    np.testing.assert_allclose(change, impulse, atol=1e-6 * np.abs(change).max())


def test_the_coupling_is_of_first_order():
    ends = [fly(period, 4.0).data.body_rotation.sel(body="servicer").values[-1] for period in (0.4, 0.2, 0.1)]
    ratio = np.linalg.norm(ends[0] - ends[1]) / np.linalg.norm(ends[1] - ends[2])
    assert 1.7 < ratio < 2.4
