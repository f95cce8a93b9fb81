"""Test of a quantity: its value is the root mean square of the speed in the result, for every tip."""

from pathlib import Path

import numpy as np

import spacerobot as sr

sr.load_plugin(Path(__file__).with_name("tip_speed.py"))


def test_the_quantity_is_the_root_mean_square_of_the_tip_speed():
    """The quantity equals the integral of the simulated tip velocity."""
    path = "robots.rpr1.tips.tip.pid.kp"
    scene = sr.load_scene("paper", {"simulation.duration": 0.5, "simulation.output_step": 0.002, path: 400})
    velocity = sr.simulate(scene, backend="interpreted").data.tip_velocity
    expected = np.sqrt((velocity**2).sum("axis").integrate("time") / 0.5)
    batch = sr.batch(scene, "tip_speed_rms", {path: [400]}, backend="interpreted")
    values = batch.data.tip_speed_rms.isel({path: 0})  # of each tip
    assert expected.min() > 1e-4
    np.testing.assert_allclose(values, expected.transpose("tip"), rtol=1e-4)
