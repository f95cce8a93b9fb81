"""Identification of a caught object: exact without noise, unbiased with it, realisable, or refused."""

import functools
from fractions import Fraction

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

import spacerobot as sr
from optim.identification import consistent, momentum_regressor
from spacerobot.common.errors import SpaceRobotError
from spacerobot.dynamics.inertial_parameters import is_realisable
from tests.oracles import one_arm


def turn(vector, displacement):
    line = {"kind": "line", "displacement": displacement, "rotation_deg": vector, "duration": 4}
    return {"target": {"reference": line}, "until": {"time": 4.5}}


AXES = {
    "roll": turn([25, 0, 0], [0, 0.1, 0.1]),
    "pitch": turn([0, 25, 0], [0.1, 0, -0.1]),
    "yaw": turn([0, 0, 25], [-0.1, -0.1, 0]),
}
HEAVIER = {"target.links.body.mass": 140, "target.links.body.com": [0.03, -0.01, 0.02]}


HELD = {
    "robots.servicer.controllers": {"turn": {"kind": "base_attitude", "kp": 40, "kd": 200}},
    "robots.servicer.actuators": {"ideal": {"kind": "base_wrench"}},
}
"""A base that an outside torque holds, whose impulse counts."""


@functools.cache
def moved(name="servicer", *, held=False):
    changes = (
        HEAVIER
        | (HELD if held else {})
        | {
            "simulation.duration": 13.5,
            "simulation.output_step": 0.1,
            "phases": AXES,
        }
    )
    return sr.simulate(sr.load_scene(name, changes), backend="interpreted")


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_regressor_is_the_momentum_of_a_body(seed):
    rng = np.random.default_rng(seed)
    inertia, motion = pin.Inertia.Random(), pin.Motion(rng.normal(size=6))
    found = momentum_regressor(motion.linear, motion.angular) @ inertia.toDynamicParameters()
    np.testing.assert_allclose(found, (inertia * motion).vector, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "held"), [("servicer", False), ("servicer-wheels", False), ("servicer", True)]
)
def test_without_noise_it_is_exact(name, held):
    result = moved(name, held=held)
    assert ("impulse_angular" in result.data) == held
    found = sr.identify(result)
    np.testing.assert_allclose(found.values, found.truth, atol=2e-5)
    np.testing.assert_allclose(found.values[1:4], [0.03, -0.01, 0.02], atol=1e-6)


def test_errors_scatter_as_their_covariance_says():
    """Squared errors in standard deviations of ten parameters and eight draws, near their number."""
    found = [sr.identify(moved(), noise=sr.SensorNoise(), seed=seed) for seed in range(8)]
    squares = np.array([((one.values - one.truth) / one.deviations) ** 2 for one in found])
    # by simulation of correlated normal deviates the mean lies within these bounds in 999 of 1000 cases
    assert 0.4 < squares.mean() < 2.1
    assert (
        np.median(np.abs(found[0].values - found[0].truth)[[0, 4, 5, 6]] / found[0].truth[[0, 4, 5, 6]])
        < 0.02
    )


def test_the_identified_object_is_saved_and_simulated_by_its_changes(tmp_path):
    found = sr.identify(moved())
    found.save(tmp_path / "object.json")
    assert repr(sr.load(tmp_path / "object.json")) == repr(found)
    scene = sr.load_scene("servicer", found.changes)
    np.testing.assert_allclose(
        scene.model.inertias[scene.target.root_joint].toDynamicParameters(),
        moved().scene().model.inertias[scene.target.root_joint].toDynamicParameters(),
        atol=1e-4,
    )


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    """An object carried on a circle in a plane, heavier than its URDF says and out of balance."""
    file = one_arm.write(
        tmp_path_factory.mktemp("planar"),
        grasps={"left": {"tip": "arm/tip", "frame": "mate_1", "kind": "weld"}},
    )
    heavier = {"target.links.body.mass": 12, "target.links.body.com": [0.03, -0.02, 0]}
    return file, sr.simulate(sr.load_scene(file, heavier), backend="interpreted")


def test_of_a_planar_object_mass_centre_and_one_inertia_are_identified(planar, tmp_path):
    file, result = planar
    found, names = sr.identify(result), ("mass", "com_x", "com_y", "inertia_zz")
    assert found.identified == names
    assert [row[0].split()[0] for row in found.rows()] == list(names)
    np.testing.assert_allclose(found.values, found.truth, atol=2e-5)
    np.testing.assert_allclose(found.values[:3], [12, 0.03, -0.02], atol=1e-5)
    noisy = [sr.identify(result, noise=sr.SensorNoise().scaled(0.1), seed=seed) for seed in range(8)]
    own = [0, 1, 2, 6]
    squares = np.array([((one.values - one.truth)[own] / one.deviations[own]) ** 2 for one in noisy])
    assert 0.3 < squares.mean() < 2.3
    noisy[0].save(tmp_path / "object.json")
    again = sr.load(tmp_path / "object.json")
    assert again.identified == names
    changed = sr.load_scene(file, again.changes)
    inertia = changed.model.inertias[changed.target.root_joint]
    assert inertia.mass == again.values[0]
    assert inertia.inertia[2, 2] == pytest.approx(again.values[6])


def exact_minors(parameters):
    """Leading principal minors of the pseudo-inertia in rational arithmetic; in a plane m and m I - h^2."""
    numbers = [Fraction(float(number)) for number in parameters]
    if len(numbers) == 4:
        mass, x, y, moment = numbers
        return [mass, mass * moment - x * x - y * y]
    mass, x, y, z, xx, xy, yy, xz, yz, zz = numbers
    half = (xx + yy + zz) / 2
    rows = [
        [mass, x, y, z],
        [x, half - xx, -xy, -xz],
        [y, -xy, half - yy, -yz],
        [z, -xz, -yz, half - zz],
    ]
    minors = [Fraction(1)]
    for k in range(4):  # elimination: the k-th pivot is the ratio of successive minors
        minors.append(minors[-1] * rows[k][k])
        for row in rows[k + 1 :]:
            factor = row[k] / rows[k][k]
            row[k:] = [a - factor * b for a, b in zip(row[k:], rows[k][k:], strict=True)]
    return minors[1:]


def test_a_planar_body_that_cannot_be_is_moved_to_the_nearest():
    possible = np.array([3.0, 0.3, 0.0, 0.1])
    np.testing.assert_array_equal(consistent(possible, np.eye(4))[0], possible)
    impossible = np.array([3.0, 0.6, 0.0, 0.0])  # less than m c^2
    moved_to, moved_at_all = consistent(impossible, np.eye(4))
    assert moved_at_all
    nearest = minimize(
        lambda p: np.sum((p - impossible) ** 2),
        [3.0, 0.5, 0.0, 0.2],
        constraints={"type": "ineq", "fun": lambda p: p[3] * p[0] - p[1:3] @ p[1:3]},
        method="SLSQP",
        options={"ftol": 1e-14},
    )
    np.testing.assert_allclose(moved_to, nearest.x, atol=1e-5)


@pytest.mark.parametrize("size", [4, 10])
def test_the_nearest_body_exists_in_exact_arithmetic(size):
    """Rounding moves none across the boundary, whatever the magnitudes."""
    rng = np.random.default_rng(size)
    for _ in range(10):
        mass, length = 10.0 ** rng.uniform(-2, 4), 10.0 ** rng.uniform(-1, 1)
        body = pin.Inertia(mass, rng.normal(size=3) * length, np.diag([0.0, 1.0, 1.0]) * mass * length**2)
        rod = body.toDynamicParameters()[[0, 1, 2, 9] if size == 4 else slice(None)]
        units = np.array([mass, *[mass * length] * (2 if size == 4 else 3), *[mass * length**2] * 6])[:size]
        deviations = 0.1 * units * 10.0 ** rng.uniform(-1, 0, size)
        impossible = rod - deviations * np.abs(rng.normal(size=size))
        impossible[3 if size == 4 else 9] -= 2 * rod[-1]
        nearest, moved_at_all = consistent(impossible, np.diag(deviations**2))
        assert moved_at_all
        assert all(minor > 0 for minor in exact_minors(nearest))
        assert is_realisable(nearest)
        # bodies are a convex cone, to whose projection the part cut off is orthogonal
        cut = (impossible - nearest) / deviations
        assert abs(cut @ (nearest / deviations)) < 1e-6 * np.linalg.norm(cut) * np.linalg.norm(
            nearest / deviations
        )


def test_what_no_body_can_have_is_moved_to_the_nearest():
    inertia = pin.Inertia(3.0, np.array([0.1, 0, 0]), np.diag([1.0, 2.0, 2.5])).toDynamicParameters()
    moved_to, moved_at_all = consistent(inertia, np.eye(10))
    assert not moved_at_all
    np.testing.assert_array_equal(moved_to, inertia)
    impossible = pin.Inertia(3.0, np.zeros(3), np.diag([1.0, 2.0, 2.0])).toDynamicParameters()
    impossible[9] = 3.4  # violates I_zz <= I_xx + I_yy
    moved_to, moved_at_all = consistent(impossible, np.eye(10))
    assert moved_at_all
    assert all(minor > 0 for minor in exact_minors(moved_to))
    # the nearest point of the plane I_xx + I_yy = I_zz is at a distance of 0.4 / sqrt(3)
    assert np.linalg.norm(moved_to - impossible) == pytest.approx(0.4 / np.sqrt(3), rel=1e-3)


def test_what_cannot_be_identified_is_said():
    with pytest.raises(SpaceRobotError, match=r"motion is too slow for this noise|determines .* unknowns"):
        sr.identify(moved(), since=12.5, noise=sr.SensorNoise().scaled(10))
    with pytest.raises(SpaceRobotError, match=r"found 5 samples since 13\.1 s, allowed: at least 10"):
        sr.identify(moved(), since=13.1)
    compliant = sr.simulate(sr.load_scene("paper", {"simulation.duration": 0.1}), backend="interpreted")
    with pytest.raises(SpaceRobotError, match=r"no floating target .* `weld` holds"):
        sr.identify(compliant)
