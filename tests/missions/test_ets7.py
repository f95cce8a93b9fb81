"""ETS-VII: what its page states, and the base's reaction by conservation of momentum alone."""

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.description import find_urdf
from tests.missions.pages import check

POSTURE = np.radians([-95, -35, 45, 25, -15, 0])
WAY = np.array([0.35, 0.35, 0])
DURATION = 40.0
STEP = {"simulation.step": 0.25, "simulation.output_step": 0.25}


@pytest.fixture(scope="module")
def flown():
    return sr.simulate(sr.load_scene("ets7", STEP), backend="interpreted")


def base_rotation_by_momentum():
    """Rotation of the free base [deg], from zero momentum and the hand's velocity alone (no dynamics).

    Joint rates solve J* r = v of the hand; the base moves by -H_b^-1 H_bm r. Kinematics and composite inertia
    are Pinocchio's, steps are those of the midpoint rule.
    """
    model = pin.buildModelFromUrdf(str(find_urdf("ets7.urdf")), pin.JointModelFreeFlyer())
    data, hand = model.createData(), model.getFrameId("hand")

    def rates(q, time):
        s = time / DURATION
        inertia = pin.crba(model, data, q)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        jacobian = pin.getFrameJacobian(model, data, hand, pin.LOCAL_WORLD_ALIGNED)
        reaction = -np.linalg.solve(inertia[:6, :6], inertia[:6, 6:])
        generalized = jacobian[:, 6:] + jacobian[:, :6] @ reaction
        joints = np.linalg.solve(generalized, np.r_[WAY * 6 * s * (1 - s) / DURATION, 0, 0, 0])
        return np.r_[reaction @ joints, joints]

    q = pin.neutral(model)
    q[7:] = POSTURE
    step = DURATION / 400
    for k in range(400):
        middle = pin.integrate(model, q, rates(q, k * step) * step / 2)
        q = pin.integrate(model, q, rates(middle, (k + 0.5) * step) * step)
    return np.degrees(np.linalg.norm(pin.log3(pin.Quaternion(q[3:7]).normalized().matrix())))


def test_the_page_states_what_is_flown(flown):
    base = {name: body["max_rotation_deg"] for name, body in flown.summary["bases"].items()}
    hand = {name: 1e6 * tip["norm"]["max_m"] for name, tip in flown.summary["tip_error"].items()}
    feedback = sr.load_scene("ets7", {**STEP, "robots.wheels.controllers.attitude.feed_forward": 0})
    without = sr.simulate(feedback, backend="interpreted").summary["bases"]["wheels"]["max_rotation_deg"]
    placed = pin.buildModelFromUrdf(str(find_urdf("ets7.urdf")), pin.JointModelFreeFlyer())
    along = [np.linalg.norm(placed.jointPlacements[i].translation) for i in (4, 5)]
    tip = placed.frames[placed.getFrameId("hand")].placement.translation
    check(
        "ets7",
        {
            "chaser with arm, kg": pin.computeTotalMass(placed),
            "reach of links 2, 3 and 6, m": sum(along) + np.linalg.norm(tip),
            "hand error in inertial space, `free`, less than, um": hand["free/hand"],
            "rotation of the base during the motion, `free`, deg": base["free"],
            "the same by conservation of momentum alone (tests), deg": base_rotation_by_momentum(),
            "base turns, `reactionless`, less than, deg": base["reactionless"],
            "hand error in inertial space, `reactionless`, less than, um": hand["reactionless/hand"],
            "base turns, `wheels`, with the momentum of the arm fed forward, deg": base["wheels"],
            "base turns, `wheels`, feedback alone (`feed_forward: 0`), deg": without,
            "largest momentum of one wheel, N m s": float(abs(flown.data.wheel_speed).max()) * 0.05,
        },
    )


def test_the_published_moments_about_the_joints_are_kept():
    """Moments about the joint's axis as published; the inertia about the centre of mass is possible."""
    model = pin.buildModelFromUrdf(str(find_urdf("ets7.urdf")), pin.JointModelFreeFlyer())
    for joint, published in zip((2, 3, 4), (1.69, 3.75, 2.53), strict=True):
        inertia = model.inertias[joint]
        assert inertia.matrix()[5, 5] == pytest.approx(published, abs=1e-3)
        moments = np.linalg.eigvalsh(inertia.inertia)
        assert moments[0] + moments[1] >= moments[2]
