"""Test of a collision shape: with equal semi-axes it is a sphere, also where it touches."""

from pathlib import Path

import numpy as np

import spacerobot as sr

sr.load_plugin(Path(__file__).with_name("ellipsoid.py"))


def gaps(measures):
    """Gap [m] between the fist of the scenario ``bounce`` and the ball that flies against it."""
    changes = {
        "pads.fist": {"link": "arm/tip", **measures},
        "target.base.velocity": [-2.5, 0, 0],
        "simulation.duration": 0.25,
    }
    return sr.simulate(sr.load_scene("bounce", changes), backend="interpreted").data.contact_gap.values


def test_an_ellipsoid_with_equal_semi_axes_is_a_sphere():
    """Distances of an ellipsoid with equal semi-axes are those of a sphere of this radius."""
    sphere = gaps({"kind": "sphere", "radius": 0.07})
    assert sphere.min() < 0  # they touch
    np.testing.assert_allclose(gaps({"kind": "ellipsoid", "semi_axes": [0.07] * 3}), sphere, atol=1e-6)
    assert gaps({"kind": "ellipsoid", "semi_axes": [0.1] * 3})[0] < sphere[0]
