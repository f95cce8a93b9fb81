"""Detumbling by touch: what its page states."""

import numpy as np

import spacerobot as sr
from tests.missions.pages import check

INERTIA = 0.533333
TIPS = "robots.chaser.tips"
DIRECT = {
    "phases.detumble.until.time": 0.01,
    f"{TIPS}.*.controllers.soft.stiffness": [6000, 6000, 6000],
    f"{TIPS}.*.controllers.soft.damping": [300, 300, 300],
    "phases.cage.robots.chaser.tips.left_tip.reference.duration": 2,
    "phases.cage.robots.chaser.tips.right_tip.reference.duration": 2,
}


def flown(changes):
    return sr.simulate(sr.load_scene("touch", changes), backend="interpreted")


def spin(data):
    """Spin of the cube [deg/s], by its angular momentum about its centre."""
    cube = data.sel(body="target")
    place, momentum = cube.body_position.values, cube.body_momentum_linear.values
    orbital = place[:, 0] * momentum[:, 1] - place[:, 1] * momentum[:, 0]
    return np.degrees((cube.body_momentum_angular.values[:, 2] - orbital) / INERTIA)


def peak(result):
    return result.summary["greatest_contact"]["force_n"]


def caged(result):
    return max(event["time_s"] for event in result.summary["events"] if event["kind"] == "captured")


def test_the_page_states_what_is_simulated():
    touched, direct = flown({}), flown(DIRECT)
    time, rates = touched.data.time.values, spin(touched.data)
    turned = touched.data.body_rotation.sel(body="chaser").values[:, 2]
    check(
        "touch",
        {
            "spin at first, deg/s": rates[0],
            "spin after 5 s, deg/s": np.interp(5, time, rates),
            "spin after 40 s, deg/s": np.interp(40, time, rates),
            "peak contact force, N": peak(touched),
            "caged after, s": caged(touched),
            "largest rotation of the robot, deg": np.degrees(np.abs(turned).max()),
            "direct caging: peak contact force, N": peak(direct),
            "direct caging: caged after, s": caged(direct),
        },
    )
    start = touched.data.momentum_linear.values[0]
    np.testing.assert_allclose(touched.data.momentum_linear.values[-1], start, atol=1e-6)
