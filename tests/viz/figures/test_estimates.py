"""Errors of estimates beside the standard deviations that their filters state."""

import numpy as np

from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.figures.estimates import SIGMAS, estimate_errors


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
