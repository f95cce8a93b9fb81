"""Errors of estimates beside the standard deviations that their filters state."""

import numpy as np

from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.figures.estimates import SIGMAS, converged_range, estimate_errors


def test_each_error_is_drawn_in_its_band_of_three_standard_deviations():
    scene = load_scene("examples/filters.yaml", {"simulation.duration": 0.4, "simulation.output_step": 0.1})
    result = simulate(scene, backend="interpreted")
    drawn = {panel.get_title("left"): panel for panel in estimate_errors(result).axes}
    assert "chaser, bias" in drawn
    panel, data = drawn["chaser, bias"], result.data.sel(body="chaser")
    for k, curve in enumerate(panel.get_lines()[:3]):
        np.testing.assert_allclose(curve.get_ydata(), np.degrees(data.bias_estimate_error.values[:, k]))
        (path,) = panel.collections[k].get_paths()
        band = SIGMAS * np.degrees(data.bias_estimate_deviation.values[:, k])
        np.testing.assert_allclose(path.vertices[:, 1].max(), band.max(), rtol=1e-12)
    # estimate and error add up to the gyro's bias, which is drawn at its first sample and walks by less than
    # five of its standard deviations in 0.3 s
    bias = (data.bias_estimate + data.bias_estimate_error).values[1:]
    assert np.abs(bias).max() > 1e-5
    walk = result.scenario.robots["chaser"].sensors.base_spin.errors.bias_walk
    assert np.ptp(bias, axis=0).max() < 5 * walk * np.sqrt(0.3)


def test_the_axis_shows_the_converged_filter():
    """A wide initial band is cut off; an error outside the band of a converged filter never is."""
    time = np.linspace(0, 10, 101)
    bound = np.stack([0.1 + 50 * np.exp(-4 * time), np.full(101, 0.1)], axis=1)
    error = np.zeros((101, 2))
    limit = converged_range(error, bound)
    assert 0.1 < limit < 0.17
    error[80, 1] = 0.7
    assert 0.7 < converged_range(error, bound) < 0.8
    assert converged_range(error[80:], bound[80:]) is None
    assert converged_range(error, np.full((101, 2), 1.0)) is None
