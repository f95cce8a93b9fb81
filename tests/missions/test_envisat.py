"""Envisat: what its page states of scenario and simulation; the plan itself costs too much for a test."""

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.description import find_urdf
from tests.missions.pages import check
from viz.page.animation import animation


@pytest.fixture(scope="module")
def run():
    return sr.simulate(sr.load_scene("envisat", {"simulation.step": 0.1}), backend="interpreted")


def test_the_page_states_what_the_scenario_has_and_does(run):
    envisat = pin.buildModelFromUrdf(str(find_urdf("envisat.urdf")), pin.JointModelFreeFlyer())
    servicer = pin.buildModelFromUrdf(str(find_urdf("debris_servicer.urdf")), pin.JointModelFreeFlyer())
    inertia, ring = envisat.inertias[1], envisat.frames[envisat.getFrameId("ring")].placement.translation
    spin = np.radians([0, 0, 3.5])
    moments, axes = np.linalg.eigh(inertia.inertia)
    captured, _, ended = run.summary["events"]
    torque = np.abs(run.data.joint_torque.values).max(axis=0)
    check(
        "envisat",
        {
            "mass of Envisat, kg": inertia.mass,
            "smallest principal moment, kg m²": moments[0],
            "intermediate principal moment, kg m²": moments[1],
            "largest principal moment, kg m²": moments[2],
            "angle of the intermediate axis from y, deg": np.degrees(np.arccos(abs(axes[1, 1]))),
            "angular momentum at 3.5 deg/s about z, N m s": np.linalg.norm(inertia.inertia @ spin),
            "angular momentum at 5 deg/s about the intermediate axis, N m s": moments[1] * np.radians(5),
            "speed of the ring at 3.5 deg/s, m/s": np.linalg.norm(np.cross(spin, ring)),
            "mass of the servicer, kg": sum(inertia.mass for inertia in servicer.inertias),
            "captured after, s": captured["time_s"],
            "relative speed at the capture, m/s": np.linalg.norm(captured["relative_velocity_m_s"]),
            "at rest below 0.01 m/s and 0.05 deg/s after, s": ended["time_s"],
            "largest torque of wrist_1, N m": torque[4],
            "largest torque of wrist_2 and wrist_3, N m": torque[5:].max(),
            "largest force at the ring, N": run.summary["greatest_grip"]["force_n"],
        },
    )


def test_the_servicer_follows_the_plan_that_ships_until_envisat_is_at_rest(run):
    events = [(event["kind"], event["who"]) for event in run.summary["events"]]
    assert events == [("captured", "grip"), ("phase", "detumble"), ("end", "detumble")]
    spin = np.degrees(np.linalg.norm(run.data.v.values[:, -3:], axis=1))
    assert spin[0] == pytest.approx(3.5)
    assert spin[-1] < 0.06  # the last sample is up to 0.1 s before the event


def test_the_servicer_begins_at_rest_relative_to_envisat():
    """Base and arm turn with Envisat: no tip motion seen from the ring, to the digits of the scenario."""
    scene = sr.load_scene("envisat", {"simulation.duration": 0.02})
    result = sr.simulate(scene, backend="interpreted")
    tip = result.data.tip_position.values[0, 0]
    velocity = result.data.tip_velocity.values[0, 0]
    np.testing.assert_allclose(velocity, np.cross(np.radians([0, 0, 3.5]), tip), atol=5e-5)


def test_the_camera_comes_near_at_the_capture_although_envisat_is_large(run):
    whole, near, _ = (np.ptp(shot["points"], axis=0).max() for shot in animation(run)["shots"])
    assert near < whole / 3
