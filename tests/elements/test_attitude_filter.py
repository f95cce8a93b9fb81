"""Attitude filter: against Gaussian conditioning, consistency over draws, both engines, gradients, errors."""

import numpy as np
import pytest
from scipy.stats import chi2

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import build_rollout
from spacerobot.symbolic.noise import NoiseTable
from tests.elements.test_sampling import costed, difference, plate
from tests.oracles.gaussian import chained, conditioned
from tests.oracles.small_scenes import PLANAR, small_scene

DRAW, FIRST_DEG = "simulation.noise_draw", 0.5
PERIOD, SLOW, TRACKER = 0.05, 0.25, 1e-3
GYRO = {"kind": "gyro", "errors": {"period": PERIOD, "noise": 1e-3, "bias": 2e-3, "bias_walk": 1e-3}}
SEEN = {"kind": "star_tracker", "errors": {"period": SLOW, "delay": 0, "noise": TRACKER * SLOW**0.5}}
FILTER = {"kind": "attitude_filter", "attitude_deg": FIRST_DEG}
ALONE = """
name: alone
robots:
  chaser:
    urdf: {urdf}
    base: {{joint: {joint}, spin_deg: {spin}, rotation_deg: [0, 0, 30]}}
simulation: {{duration: 2, step: 0.05, output_step: 0.5}}
"""
PLATE = ALONE.format(urdf="plate.urdf", joint="planar", spin=[0, 0, 8])
BOX = ALONE.format(urdf="flapped_box.urdf", joint="free_flyer", spin=[5, -8, 3])


def filtered(delay_s=0.0, robot="chaser", **section):
    """Changes that give a robot a gyro, a star tracker and a filter."""
    late = SEEN | {"errors": SEEN["errors"] | {"delay": delay_s}}
    return {
        f"robots.{robot}.sensors": {"base_spin": GYRO, "base_orientation": late},
        f"robots.{robot}.estimators": {"known": FILTER | section},
    }


def rolled(text, changes, duration_s, **options):
    loop = build_closed_loop(small_scene(text, changes))
    steps = {"step_s": 0.05, "output_step_s": PERIOD} | options
    return build_rollout(loop, duration_s=duration_s, **steps)


def states(rollout, run, name):
    """A state of the filter or of a sensor at all samples (samples, n)."""
    names = rollout.loop.state_names
    return run.state[:, [i for i, own in enumerate(names) if own.startswith(f"chaser/known{name}[")]]


@pytest.mark.parametrize("delay_s", [0.0, 0.1, SLOW])
def test_in_the_plane_it_is_the_conditional_expectation_given_all_that_arrived(delay_s):
    """One axis is linear: mean and covariance of (angle, bias) follow from one joint Gaussian.

    Two turns share each sample of the gyro, whose error is therefore a part of what is chained.
    """
    rollout = rolled(PLATE, filtered(delay_s), 1.0, backend="interpreted", output_step_s=PERIOD / 2)
    run, after = rollout.run(), slice(1, None, 2)  # after each instant
    rate = states(rollout, run, ".base_spin.measured")[after, 0]
    shown = states(rollout, run, ".base_orientation.measured")[after]
    count = len(rate)
    begin = np.radians(FIRST_DEG)
    drawn = NoiseTable("chaser/known.begin", 1, 1).drawn(0, 0)[0]
    turned = np.radians(30) + begin * drawn
    sample, walk = GYRO["errors"]["noise"] ** 2 / PERIOD, GYRO["errors"]["bias_walk"] ** 2 * PERIOD
    noise = walk * np.array([[PERIOD**2 / 3, -PERIOD / 2, 0], [-PERIOD / 2, 1, 0], [0, 0, 0]])
    noise += sample * np.outer([-PERIOD / 2, 0, 1], [-PERIOD / 2, 0, 1])
    forcing = np.outer(PERIOD * (rate[1:] + rate[:-1]) / 2, [1, 0, 0])
    spread = np.diag([begin**2, GYRO["errors"]["bias"] ** 2, sample])
    transition = np.array([[1, -PERIOD, -PERIOD / 2], [0, 1, 0], [0, 0, 0]])
    mean, covariance = chained([turned, 0, 0], spread, transition, forcing, noise)
    numbers, bias = states(rollout, run, ".attitude")[after], states(rollout, run, ".bias")[after, 0]
    angle = np.arctan2(numbers[:, 1], numbers[:, 0])
    known = states(rollout, run, ".covariance")[after]
    places = [0, 1, 4 if delay_s else 3]
    for k in range(count):
        # samples that arrived up to now, each of its own instant
        used = sorted({tuple(row) for row in shown[: k + 1] if row[2] >= 0}, key=lambda row: row[2])
        rows = np.zeros((len(used), 3 * count))
        for i, (*_, stamp) in enumerate(used):
            rows[i, 3 * round(stamp / PERIOD)] = 1
        values = np.array([np.arctan2(row[1], row[0]) for row in used])
        found, left = conditioned(mean, covariance, rows, values, TRACKER**2)
        own = slice(3 * k, 3 * k + 2)
        np.testing.assert_allclose([angle[k], bias[k]], found[own], rtol=0, atol=1e-12)
        wanted = left[own, own]
        np.testing.assert_allclose(
            known[k, places], [wanted[0, 0], wanted[0, 1], wanted[1, 1]], rtol=1e-9, atol=1e-18
        )
    assert len(used) == (3 if delay_s == SLOW else 4)
    assert abs(bias[-1]) > 1e-4


@pytest.mark.compiler
@pytest.mark.parametrize("held_s", [0.0, 0.8 * PERIOD], ids=["at an update", "between updates"])
def test_errors_in_space_are_as_large_as_the_covariance_says(held_s):
    """NEES and NIS inside their 95 % bounds over 1000 draws, late star tracker."""
    changes = filtered(0.1) | {"simulation.duration": 1.5 + held_s}
    names = {"attitude_nees": 6, "attitude_nis": 3}
    found = sr.batch(small_scene(BOX, changes), list(names), {DRAW: np.arange(1000.0)}).data
    for name, freedoms in names.items():
        values = found[name].values.ravel()
        low, high = chi2.ppf([0.025, 0.975], freedoms * len(values)) / len(values)
        assert low < values.mean() < high
        inside = (values < chi2.ppf(0.95, freedoms)).mean()
        assert abs(inside - 0.95) < 3 * np.sqrt(0.95 * 0.05 / len(values))


def test_the_nis_has_no_degrees_of_freedom_until_a_sample_is_used():
    changes = filtered(0.1) | {"robots.chaser.sensors.base_orientation.errors.dropout": 0.8}
    rollout = rolled(BOX, changes, 2.0, backend="interpreted", output_step_s=PERIOD / 2)
    run = rollout.run()
    used = states(rollout, run, ".used")[:, 0]
    assert used[0] < 0
    assert used[-1] > 0
    np.testing.assert_array_equal(run.outputs["attitude_nis_dof"][:, 0], np.where(used < 0, 0, 3))
    np.testing.assert_array_equal(run.outputs["attitude_nis"][used < 0], 0)


def test_an_estimate_that_nobody_makes_is_refused():
    with pytest.raises(ScenarioError, match=r"attitude_nees: no robot .* estimator of kind attitude_filter"):
        sr.batch(small_scene(PLATE, {}), "attitude_nees", {"robots.chaser.base.spin_deg.2": [8.0]})


@pytest.mark.parametrize(("text", "delay_s"), [(PLATE, 0.1), (BOX, 0.1), (BOX, 0.0)])
def test_both_engines_estimate_the_same(text, delay_s):
    changes = filtered(delay_s)
    rollout = rolled(text, changes, 0.6, backend="interpreted", output_step_s=0.3)
    other = simulate(small_scene(text, changes), duration_s=0.6, output_step_s=0.3)
    np.testing.assert_allclose(rollout.run().state, other.state, atol=1e-9)


def controlled(delay_s=0.1, **section):
    """A plate whose attitude is controlled by what its filter estimates."""
    return plate(kp=40, kd=20) | filtered(delay_s, "one", **section)


def test_a_controller_reads_the_estimates():
    ideal = costed(plate(kp=40, kd=20), 0.6, backend="interpreted").run()
    own = costed(controlled(), 0.6, backend="interpreted").run()
    away = np.abs(own.outputs["body_rotation"] - ideal.outputs["body_rotation"]).max()
    assert 1e-4 < away < 5e-3


@pytest.mark.parametrize(
    ("path", "step"),
    [
        ("robots.one.controllers.turn.kp", 0.5),
        ("robots.one.estimators.known.attitude_noise", 4e-5),
        ("robots.one.sensors.base_spin.errors.noise", 1e-5),
        ("robots.one.sensors.base_spin.errors.bias", 4e-5),
    ],
)
def test_gradients_go_through_the_filter(path, step):
    """Of a gain, of what the filter assumes, and of a sensor's noise, which is drawn and assumed."""
    rollout = costed(controlled(attitude_noise=2e-3), 0.63, backend="interpreted")
    found = rollout.value_and_gradient(wrt=[path])
    assert found.status == ("exact",)
    wanted = difference(rollout, path, step)
    assert abs(wanted) > 1e-9
    np.testing.assert_allclose(found.gradients["x"][0], wanted, rtol=1e-7)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"robots.one.sensors.base_spin": {"kind": "linear"}},
            r"samples of base_spin, found none; give",
        ),
        ({"robots.one.sensors": None}, r"needs samples of base_spin, found none"),
        (
            {"robots.one.sensors.base_orientation.errors.delay": 0.12},
            r"found 0\.12 s as delay of",
        ),
        (
            {"robots.one.sensors.base_orientation.errors.delay": 0.3},
            r"0\.3 s late, allowed: at",
        ),
        ({"robots.one.sensors.base_spin.errors.delay": 0.05}, r"found a gyro that is 0\.05 s late"),
        (
            {"robots.one.sensors.base_spin.errors.bias": 0},
            r"known\.bias: missing, and base_spin",
        ),
        ({"robots.one.sensors.base_spin.errors.period": 0}, r"period: found 0, allowed: above 0"),
        ({"robots.one.estimators.other": FILTER}, r"other: estimates base_orientation, which"),
    ],
)
def test_a_filter_without_what_it_needs_is_refused(changes, told):
    with pytest.raises(ScenarioError, match=told):
        small_scene(PLANAR, controlled() | changes)
