"""Gains that follow a plan: of an arm that holds an object, and which replay the tolerance is for."""

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from optim.planning.verification.tracking_gains import BANDWIDTH, tracking_gains
from optim.planning.verification.verify import VerificationResult

HELD = {
    "grasps.grip": {"tip": "arm/tip", "frame": "mate_1", "kind": "weld"},
    "target.base": {"joint": "planar", "close_grasp": "grip"},
    "phases": {},
    "plan": {
        "duration": 4,
        "goals": {"rest": {"still": "arm"}},
        "costs": {"torque": 0.01, "base_wrench": 1e-4},
        "limits": {"base_force": 5, "base_torque": 5},
        "intervals": 4,
        "tolerance": 0.1,
    },
}


@pytest.fixture(scope="module")
def planned():
    return sr.plan(sr.load_scene("examples/catch.yaml", HELD), backend="interpreted").solution


def test_joints_feel_what_a_rigid_grasp_holds(planned):
    """As if the object were a part of the last link: least inertia of a joint of one tree without grasps."""
    scene = planned.scene
    model, data, q = scene.model, scene.model.createData(), np.array(planned.motion.q[0])
    pin.forwardKinematics(model, data, q)
    joints = scene.body("arm").driven_joints
    last, held = joints[-1], scene.body("target").root_joint
    joined = model.copy()
    joined.inertias[last] += data.oMi[last].actInv(data.oMi[held]).act(model.inertias[held])
    inverse = pin.computeMinverse(joined, joined.createData(), q)
    least = 1 / max(inverse[model.idx_vs[joint], model.idx_vs[joint]] for joint in joints)
    gains = tracking_gains(planned.motion, "arm")
    assert gains["kp"] == pytest.approx(BANDWIDTH**2 * least, rel=5e-3)
    assert gains["kd"] == pytest.approx(2 * BANDWIDTH * least, rel=5e-3)


@pytest.mark.parametrize(("open_loop", "refused"), [(True, True), (False, False)])
def test_the_tolerance_may_be_for_the_replay_with_feedback_alone(open_loop, refused):
    found = VerificationResult(0.0, (), {"arm/tip": 1.0}, {"arm/tip": 1e-6}, 1e-5, open_loop)
    assert bool(found.failures()) is refused
    assert found.fine_enough is not refused
    assert found.error_m == (1.0 if open_loop else 1e-6)
