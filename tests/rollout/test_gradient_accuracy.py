"""Comparison of derivatives with those of half the step."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from spacerobot.rollout import Measures, Signals, build_rollout, peak
from spacerobot.rollout.gradient_accuracy import INACCURATE, inaccurate
from tests.rollout.conftest import toy_loop

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
        "inaccurate: step: half the step changes the derivative of 'peak' by 'friction' by 17 %"
    )
    assert "'stiffness' by more than 1000 %" in status(slopes * [1, -120], slopes)


def test_a_derivative_that_vanishes_at_an_optimum_is_accurate():
    slopes = 1e-7 * VALUE["peak"][0] / PARAMETERS
    assert status(slopes, -slopes) == ""


FREQUENCY, RATIO = 5.0, 0.01
SPRING = ("stiffness", "damping", "bend")


def oscillator():
    """A mass of 1 kg on a spring, let go at 1 m; ``bend`` is how steep the second output's kink at 1 s is."""
    p, t, x, c = ca.SX.sym("p", 3), ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("c", 3)
    values = np.array([FREQUENCY**2, 2 * RATIO * FREQUENCY, 3.0])
    bent = 1 - c[2] * ca.fabs(t - 1) + c[2] ** 2 * t / 9
    functions = {
        "setup": ca.Function("setup", [p], [ca.vertcat(1, 0), p]),
        "dynamics": ca.Function("dynamics", [t, x, c], [ca.vertcat(x[1], -c[0] * x[0] - c[1] * x[1])]),
        "normalise": ca.Function("normalise", [x], [x]),
        "outputs": ca.Function("outputs", [t, x, c], [-x[0], bent], ["t", "x", "c"], ["swing", "bent"]),
        "gaps": ca.Function("gaps", [p], [ca.SX(0, 1)]),
    }
    numbers = {"parameter_paths": SPRING, "parameter_values": values, "state_names": ("x", "v")}
    empty = {"nq": 0, "nv": 0, "nz": 2, "jumps": ()}
    return SimpleNamespace(**vars(toy_loop()) | functions | numbers | empty)


@pytest.fixture(scope="module")
def swing():
    """Rollouts of the oscillator by their step, with the peak behind half a period as measure and cost."""
    loop = oscillator()
    signals = Signals.of(loop)
    measures = Measures(signals, {name: peak(signals[name]) for name in ("swing", "bent")})
    times = {"duration_s": 1.6, "output_step_s": 0.2, "backend": "interpreted"}
    return lambda step_s: build_rollout(loop, step_s=step_s, measures=measures, **times)


def overshoot(wrt):
    """Derivatives of the peak exp(-pi z / sqrt(1 - z^2)), z = d / (2 sqrt(k)), by stiffness and damping."""
    k, d = ca.SX.sym("k"), ca.SX.sym("d")
    z = d / (2 * ca.sqrt(k))
    height = ca.exp(-ca.pi * z / ca.sqrt(1 - z**2))
    slopes = ca.Function("slopes", [k, d], [ca.jacobian(height, ca.vertcat(k, d))])
    return slopes(FREQUENCY**2, 2 * RATIO * FREQUENCY).full().ravel()[[SPRING.index(name) for name in wrt]]


@pytest.mark.parametrize("wrt", [("stiffness",), ("damping",)], ids=["stiffness", "damping"])
def test_a_peaks_derivative_called_exact_is_that_of_the_motion(swing, wrt):
    """The peak is between steps, and halving a step often leaves it at the same one."""
    (true,) = overshoot(wrt)
    statuses = []
    for step_s in 0.2 / np.array([2, 3, 4, 5, 8, 13, 20, 50, 200]):
        rollout = swing(step_s)
        forward, adjoint = rollout.jacobian(wrt=wrt), rollout.value_and_gradient(wrt=wrt, costs=["swing"])
        slope = forward.measures["swing"][0, 0]
        assert adjoint.gradients["swing"][0] == pytest.approx(slope, rel=1e-9)
        assert adjoint.status[0] == forward.status
        statuses.append(forward.status)
        if forward.status == "exact":
            assert abs(slope / true - 1) < 1.1 * INACCURATE
        else:
            assert "derivative of 'swing'" in forward.status
    assert (statuses[-1] == "exact") == (wrt == ("damping",))  # that by the stiffness is small


def test_derivatives_of_peaks_between_steps_converge_with_the_second_order(swing):
    wrt = ("stiffness", "damping")
    errors = []
    for step_s in (0.02, 0.01, 0.005):
        reference = swing(step_s)._reference
        slopes = reference.jacobian(wrt=wrt, orders=False).measures["swing"][0]
        (gradient,) = reference.value_and_gradient(wrt=wrt, costs=["swing"], orders=False).gradients.values()
        np.testing.assert_allclose(gradient, slopes, rtol=1e-9)
        errors.append(np.abs(slopes / overshoot(wrt) - 1).max())
    assert errors[-1] < 1e-3
    assert errors[0] > 8 * errors[-1]


def test_a_peak_at_a_kink_is_at_its_step(swing):
    """Its derivatives are those there, whatever the slopes on both sides: 2 bend t / 9 at 1 s."""
    for step_s in (0.1, 0.05, 0.025):
        found = swing(step_s).slope_batch(("bend",), [[3.0]])
        assert found.status == ("exact",)
        assert found.slopes["bent"][0, 0, 0] == pytest.approx(2 / 3, rel=1e-12)
