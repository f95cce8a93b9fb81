"""Tests of a sensor: exact at the temperature of its calibration, and with the error of its law when warm."""

from pathlib import Path

import numpy as np

import spacerobot as sr

sr.load_plugin(Path(__file__).with_name("thermal.py"))
SHORT = {"simulation.duration": 0.2}
IDEAL = {"kind": "linear"}


def tip_positions(sensor):
    """Positions of the tips of the paper's scenario, whose amnesia controllers use the joint rates."""
    scene = sr.load_scene("paper", {**SHORT, "robots.*.sensors.joint_rate": sensor})
    return sr.simulate(scene, backend="interpreted").data.tip_position.values


def test_the_sensor_is_exact_at_the_temperature_of_its_calibration():
    """At the temperature of its calibration the sensor changes nothing in a simulation."""
    calibrated = tip_positions({"kind": "thermal", "temperature": 20})
    np.testing.assert_array_equal(calibrated, tip_positions(IDEAL))


def test_a_warm_sensor_has_the_error_of_a_linear_one():
    """A warm sensor moves the tips as a sensor with the same offset and scale does."""
    # 25 K above the calibration scale the signal by 1 + 25 * 0.002
    warm = tip_positions({"kind": "thermal", "temperature": 45, "scale_by_kelvin": 2e-3})
    linear = tip_positions({"kind": "linear", "scale": 1.05})
    np.testing.assert_allclose(warm, linear, rtol=0, atol=1e-12)
    assert abs(warm - tip_positions(IDEAL)).max() > 1e-9
