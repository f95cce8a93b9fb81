"""Test of a reference: the commanded points lie on the curve, which ends where it begins."""

from pathlib import Path

import numpy as np

import spacerobot as sr

sr.load_plugin(Path(__file__).with_name("lemniscate.py"))


def test_the_reference_is_a_lemniscate_that_returns_to_its_crossing():
    """References of all tips satisfy the equation of a lemniscate of Gerono, and end where they begin."""
    size = 0.05
    changes = {
        "robots.*.tips.tip.reference": {"kind": "lemniscate", "size": size, "duration": 1},
        "simulation.duration": 1,
    }
    data = sr.simulate(sr.load_scene("paper", changes), backend="interpreted").data
    for tip in data.tip.values:
        points = data.tip_reference.sel(tip=tip).values
        x, y, _ = (points - points[0]).T
        # a lemniscate of Gerono: y^2 = x^2 (1 - x^2 / size^2)
        np.testing.assert_allclose(y**2, x**2 * (1 - (x / size) ** 2), atol=1e-12)
        np.testing.assert_allclose(points[-1], points[0], atol=1e-12)
        assert abs(x).max() > 0.99 * size
