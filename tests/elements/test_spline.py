"""Spline references: SciPy's clamped cubic spline, held at its end."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests.oracles.motions import DesiredMotions
from tests.oracles.small_scenes import ONE_SPATIAL_ARM, small_scene

TIMES = [0, 0.4, 1.1, 1.6]
POINTS = [[0, 0, 0], [0.1, 0, -0.05], [0.05, 0.1, 0.1], [0, 0, 0.2]]


@pytest.mark.parametrize("t", [0.2, 0.9, 1.4, 2.0])
def test_a_spline_is_the_clamped_one_of_scipy(t):
    way = {"kind": "spline", "times": TIMES, "displacements": POINTS}
    desired = DesiredMotions(small_scene(ONE_SPATIAL_ARM, {"robots.one.tips.tip.reference": way}))
    begin, found = (desired.at(at, desired.x0)["one/tip"].position for at in (0, t))
    curve = CubicSpline(TIMES, POINTS, bc_type="clamped")
    np.testing.assert_allclose(found - begin, curve(min(t, TIMES[-1])), atol=1e-12)
