"""Derivatives of margins: central differences of margins that are computed anew, closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from spacerobot.linear.complex_step import derivative
from spacerobot.linear.loop_margins import loop_margins
from spacerobot.linear.margin_gradients import MARGINS, ParametricLinearisation, margin_slope
from tests.linear.scenes import KP, arm_scene
from tests.oracles.small_scenes import PLANAR, small_scene

SAMPLED = {"sampled": {"period": 0.05, "delay": 0.02}}


def check_slopes(found, values, loop, step=1e-6):
    """Slopes of every finite margin of a loop against central differences; number of those compared."""
    values, compared = np.array(values, dtype=float), 0
    (own,) = loop_margins(found.system(0, values), [loop])
    for i in range(len(values)):
        width = step * values[i] * np.eye(len(values))[i]
        up, down = (next(loop_margins(found.system(0, values + side * width), [loop])) for side in (1, -1))
        moved = found.system(0, values, i)
        for margin in MARGINS:
            slope = (getattr(up, margin) - getattr(down, margin)) / (2 * width[i])
            if np.isfinite(slope):
                scale = 2e-5 * max(abs(slope), abs(getattr(own, margin) / values[i]) * 0.1)
                exact = margin_slope(moved, own, margin)
                assert abs(exact - slope) <= scale, (margin, i, exact, slope)
                compared += 1
    return compared


def parametric(scene, *paths, at=(0.0,)):
    return ParametricLinearisation.of(scene, at, [(path,) for path in paths], "interpreted")


HOLD = "robots.arm.controllers.hold"
LINK = "robots.arm.links.link_1"


@pytest.mark.parametrize("rate", [0.0, 30.0])
def test_slopes_of_a_continuous_loop(rate):
    """By a gain, and by a mass; bodies move, so that the chart does too."""
    found = parametric(arm_scene(2, "planar", rate), f"{HOLD}.kp", f"{LINK}.mass")
    assert check_slopes(found, (KP, 3.0), "torque/arm/joint_2") >= 6


def test_slopes_of_a_sampled_loop():
    """By a gain, a mass, the period and the delay."""
    paths = (f"{HOLD}.kp", f"{LINK}.mass", f"{HOLD}.sampled.period", f"{HOLD}.sampled.delay")
    found = parametric(arm_scene(1, "planar", **SAMPLED), *paths)
    assert check_slopes(found, (KP, 3.0, 0.05, 0.02), "torque/arm/joint_1") >= 16


def test_slopes_on_a_constraint_manifold():
    """Of a closed chain, by the mass of what it holds, and by an angle that moves its constraints."""
    pins = {
        f"grasps.{side}": {"tip": f"{robot}/tip", "frame": frame, "kind": "point"}
        for side, robot, frame in (("left", "one", "mate_1"), ("right", "two", "mate_2"))
    }
    paths = ("target.links.body.mass", "robots.one.joints.joint_2.angle_deg")
    found = parametric(small_scene(PLANAR, {**pins, "simulation.duration": 0.2}), *paths)
    values = found.lineariser.loop.parameter_values[[place for (place,) in found.places]]
    assert check_slopes(found, values, "torque/one/joint_1", step=1e-4) >= 6


def test_slopes_by_the_time_of_an_instant():
    """Of a tip that is pulled along a line: by time alone, the state kept."""
    line = {"kind": "line", "displacement": [0.2, 0.1, 0], "duration": 1.0}
    tips = {"tips": {"tip": {"pid": {"kp": 60, "ki": 20, "kd": 20}, "reference": line}}}
    found = parametric(arm_scene(2, "planar", robot=tips), f"{HOLD}.kp", at=(0.4,))
    (instant,) = found.instants
    moved = replace(found, motion=(np.eye(len(instant.x) + 1)[:, -1:],))
    exact = derivative(moved.system(0, None, 0).A) - derivative(found.system(0, None, 0).A)

    def A(time_s):
        return replace(found, instants=(replace(instant, time_s=time_s),)).system(0).A

    slope = (A(0.4 + 1e-5) - A(0.4 - 1e-5)) / 2e-5
    assert np.abs(slope).max() > 1
    np.testing.assert_allclose(exact, slope, atol=1e-6 * np.abs(slope).max())


def test_gain_slope_in_closed_form():
    """Twice the controller's gains are 6.02 dB less of gain margin: d gain_up / d ln k = -20 / ln 10 dB."""
    scene = arm_scene(1, "planar", kp=12.0, kd=3.0, **SAMPLED)
    found = parametric(scene, f"{HOLD}.kp", f"{HOLD}.kd")
    (one,) = found.sizes(0, np.array([12.0, 3.0]), "gain_up", ["torque/arm/joint_1"])
    np.testing.assert_allclose(one.gradient @ [12.0, 3.0], -20 / np.log(10), rtol=1e-9)


def test_a_margin_passes_through_zero_at_the_onset_of_instability():
    found = parametric(arm_scene(1, "planar", **SAMPLED), f"{HOLD}.kd")

    def disk(kd):
        return found.sizes(0, np.array([kd]), "disk", ["torque/arm/joint_1"], least=True)[0]

    onset = brentq(lambda kd: disk(kd).value, 12.0, 40.0, xtol=1e-4)
    below, above = disk(0.999 * onset), disk(1.001 * onset)
    assert below.value > 0 > above.value
    np.testing.assert_allclose(above.gradient, below.gradient, rtol=1e-2)
    np.testing.assert_allclose(below.gradient * 0.002 * onset, above.value - below.value, rtol=1e-2)
