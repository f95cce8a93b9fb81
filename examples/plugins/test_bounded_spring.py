"""Test of a controller: its force follows its law and stays within its bound."""

from pathlib import Path

import numpy as np

import spacerobot as sr

sr.load_plugin(Path(__file__).with_name("bounded_spring.py"))


def test_the_force_follows_the_law_of_a_spring_that_saturates():
    """With a stiff spring the simulated forces are the law of the reference and the simulated positions."""
    spring = {"kind": "bounded_spring", "stiffness": 1e6, "damping": 0, "bound": 5}
    changes = {"robots.*.tips.tip.controllers": {"spring": spring}, "simulation.duration": 0.2}
    data = sr.simulate(sr.load_scene("paper", changes), backend="interpreted").data
    force = data.spring_force.values
    error = (data.tip_reference - data.tip_position).transpose(*data.spring_force.dims).values
    np.testing.assert_allclose(force, 5 * np.tanh(1e6 * error / 5), atol=1e-9)
    assert abs(force).max() > 0.1
