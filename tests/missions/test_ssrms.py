"""SSRMS: what its page states; the impulse of the capture by the inertia at the grapple."""

import numpy as np
import pinocchio as pin

import spacerobot as sr
from spacerobot.description import find_urdf
from tests.missions.pages import check


def inverse_inertia(model, q, frame):
    """Velocity of a frame per unit impulse and couple on it (6x6), world axes; linear first."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
    inertia = pin.crba(model, data, q)
    inertia = np.triu(inertia) + np.triu(inertia, 1).T
    return jacobian @ np.linalg.solve(inertia, jacobian.T)


def impulse(result, captured):
    """Impulse [N s] on the free flyer that ends the relative motion: (J M^-1 J^T)^-1 of both, times it."""
    arm = pin.buildModelFromUrdf(str(find_urdf("ssrms.urdf")))
    flyer = pin.buildModelFromUrdf(str(find_urdf("ssrms_htv.urdf")), pin.JointModelFreeFlyer())
    last = int(np.searchsorted(result.data.time.values, captured["time_s"])) - 1
    joints = result.data.joint_position.values[last]
    free = pin.neutral(flyer)
    free[3:] = result.data.body_orientation.values[last, -1]
    both = inverse_inertia(arm, joints, arm.getFrameId("end_effector"))
    both = both + inverse_inertia(flyer, free, flyer.getFrameId("grapple"))
    relative = np.r_[captured["relative_velocity_m_s"], captured["relative_spin_rad_s"]]
    return np.linalg.norm(np.linalg.solve(both, relative)[:3])


def test_the_page_states_what_is_flown():
    result = sr.simulate(sr.load_scene("ssrms", {"simulation.step": 0.08}), backend="interpreted")
    events = {event["name"]: event for event in result.summary["events"]}
    captured, time = events["grapple.captured"], result.data.time.values
    tip, speed = (result.data[name].values[:, 0] for name in ("tip_position", "tip_velocity"))

    def moved(first, last):
        begin, end = (int(np.searchsorted(time, events[name]["time_s"])) for name in (first, last))
        return np.linalg.norm(tip[min(end, len(tip) - 1)] - tip[begin])

    halted = int(np.searchsorted(time, events["carry.time"]["time_s"]))
    model = pin.buildModelFromUrdf(str(find_urdf("ssrms.urdf")))
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    check(
        "ssrms",
        {
            "mass of the arm, kg": sum(inertia.mass for inertia in model.inertias),
            "length stretched, m": data.oMf[model.getFrameId("end_effector")].translation[0],
            "relative speed at the capture, mm/s": 1e3 * np.linalg.norm(captured["relative_velocity_m_s"]),
            "impulse on the free flyer, N s": np.linalg.norm(captured["impulses_n_s"]["grapple"]),
            "the same by the inertia of arm and free flyer at the grapple (tests), N s": impulse(
                result, captured
            ),
            "stopping distance after the capture, m": moved("grapple.captured", "stop.settled"),
            "stopping distance from 2 cm/s, m": moved("carry.time", "halt.settled"),
            "the same by the brake's law, 3/4 v²/a, m": 0.75 * np.linalg.norm(speed[halted]) ** 2 / 0.002,
            "largest force at the grapple, N": np.linalg.norm(result.data.grasp_force, axis=-1).max(),
            "largest torque at the grapple, N m": np.linalg.norm(result.data.grasp_torque, axis=-1).max(),
            "largest joint torque, N m": result.summary["greatest_torque"]["torque_n_m"],
            "largest joint rate, rad/s": float(np.abs(result.data.joint_velocity).max()),
            "largest speed of the tip, m/s": np.linalg.norm(speed, axis=1).max(),
        },
    )


def test_the_engines_agree_on_flexible_booms_and_joints():
    short = {"simulation.duration": 0.4, "simulation.output_step": 0.1, "simulation.tolerance": 1e-9}
    own, other = (
        sr.simulate(
            sr.load_scene("ssrms-flexible", short | {"simulation.engine": engine}), backend="interpreted"
        ).data
        for engine in ("casadi", "pinocchio")
    )
    assert np.abs(own.deflection.values).max() > 1e-7
    for name in ("joint_velocity", "deflection", "motor_speed", "motor_torque"):
        size = np.abs(own[name].values).max()
        np.testing.assert_allclose(other[name].values, own[name].values, rtol=0, atol=1e-6 * size)
