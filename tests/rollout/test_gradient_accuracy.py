"""Comparison of derivatives with those of half the step."""

import numpy as np
import pytest

from spacerobot.rollout.gradient_accuracy import inaccurate

PATHS = ("friction", "stiffness")
PARAMETERS = np.array([0.2, 1e4])
VALUE = {"peak": np.array([1e-3])}


def status(coarse, fine):
    slopes = ({"peak": np.array([row])} for row in (coarse, fine))
    return inaccurate(*slopes, VALUE, PARAMETERS, PATHS)


@pytest.mark.parametrize("elasticity", [1.0, 1e-2, 1e-4])
def test_a_small_derivative_that_half_the_step_changes_is_inaccurate(elasticity):
    """The elasticity is the relative change of the value by that of the parameter."""
    slopes = elasticity * VALUE["peak"][0] / PARAMETERS
    assert status(slopes, slopes) == ""
    assert status(slopes * [1.17, 1], slopes) == (
        "inaccurate: step: half of it changes the derivative of 'peak' by 'friction' by 17 %"
    )
    assert "'stiffness' by more than 1000 %" in status(slopes * [1, -120], slopes)


def test_a_derivative_that_vanishes_at_an_optimum_is_accurate():
    slopes = 1e-7 * VALUE["peak"][0] / PARAMETERS
    assert status(slopes, -slopes) == ""
