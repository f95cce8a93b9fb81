"""The published detumbling: what its page states, and its start by the generalized Jacobian alone."""

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.description import find_urdf
from tests.missions.pages import check

POSTURE = (-0.72, 1.2, 0.72)
TARGET_RATE = np.radians(5)


def published_start():
    """Model, q and v of the authors' program, and the target's rate [rad/s].

    Joint rates by Umetani and Yoshida's generalized Jacobian; then the base cancels their linear momentum.
    """
    model = pin.buildModelFromUrdf(str(find_urdf("planar_detumble.urdf")), pin.JointModelFreeFlyer())
    data, q = model.createData(), pin.neutral(model)
    q[7:] = [f(angle) for angle in POSTURE for f in (np.cos, np.sin)]
    inertia = pin.crba(model, data, q)
    inertia = np.triu(inertia) + np.triu(inertia, 1).T
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    jacobian = pin.getFrameJacobian(model, data, model.getFrameId("target"), pin.LOCAL_WORLD_ALIGNED)
    reaction = -np.linalg.solve(inertia[:6, :6], inertia[:6, 6:])
    joints = np.linalg.pinv(jacobian[:, 6:] + jacobian[:, :6] @ reaction) @ [0, 0, 0, 0, TARGET_RATE, 0]
    momentum = inertia[:6, 6:] @ joints
    momentum[3:] = 0  # pinocchio's order: forces first
    v = np.r_[-np.linalg.solve(inertia[:6, :6], momentum), joints]
    return model, q, v, float((jacobian @ v)[4])


def angular_momentum(model, q, v):
    return float(np.linalg.norm(pin.computeCentroidalMomentum(model, model.createData(), q, v).angular))


@pytest.fixture(scope="module")
def planned():
    return sr.plan(sr.load_scene("detumble-published"), backend="interpreted").solution


def test_the_page_states_what_is_planned(planned):
    at_rest = {"plan.goals.rest": {"kind": "still", "still": "chaser"}}
    rest = sr.plan(sr.load_scene("detumble-published", at_rest), backend="interpreted").solution
    model, q, v, rate = published_start()
    motion = planned.motion
    positions, rates, _, drive, _ = motion.parts(motion.z)
    names = motion.problem.stage.driven.names
    greatest = {name.rpartition(".")[2]: value for name, value in zip(names, abs(drive).max(0), strict=True)}
    begun = angular_momentum(model, q, v)
    left = angular_momentum(planned.scene.model, positions[-1], rates[-1]) / begun
    check(
        "detumble-published",
        {
            "initial rate of the joints 1 to 3 together, deg/s": np.degrees(v[6:].sum()),
            "initial rate of the base, deg/s": np.degrees(v[4]),
            "initial rate of the target, deg/s": np.degrees(rate),
            "initial angular momentum, N m s": begun,
            "cost": planned.cost,
            "duration, s": planned.phased_motion.duration_s,
            "integral of squared base torques, weight 1": planned.terms["base_torque"],
            "integral of squared base forces, weight 10": planned.terms["base_force"],
            "integral of squared joint torques, weight 1": planned.terms["torque"],
            "largest joint torque, N m": max(v for k, v in greatest.items() if "joint" in k),
            "largest base torque, N m": greatest["ty"],
            "remaining angular momentum, %": 100 * left,
            "cost with joints entirely at rest": rest.cost,
        },
    )


def test_the_plan_costs_no_more_than_the_published_trajectory(planned):
    """8.413 is the cost of the trajectory that the authors' repository stores."""
    assert planned.cost < 8.413
    assert planned.cost == pytest.approx(8.413, rel=0.02)
    assert planned.phased_motion.duration_s == pytest.approx(4.095, rel=0.015)


def test_it_starts_as_published(planned):
    _, _, v, _ = published_start()
    assert planned.motion.v[0] == pytest.approx(v, abs=1e-8)
