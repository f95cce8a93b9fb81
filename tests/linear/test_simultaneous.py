"""Disk margins of loops that change at once: decoupled loops, one loop, the onset of instability."""

import numpy as np
import pytest

import spacerobot as sr
from spacerobot.linear.loop_margins import loop_margins
from spacerobot.linear.simultaneous import greatest_structured_value, simultaneous_disk_margin
from tests.linear.scenes import arm_scene
from tests.linear.test_margins import random_system


@pytest.mark.parametrize("seed", range(4))
def test_bounds_of_three_numbers_meet(seed):
    """For up to three complex numbers mu is its upper bound (J. Doyle 1982), and the greatest rho(M U)."""
    rng = np.random.default_rng(seed)
    M = (rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3))) * np.geomspace(1, 1e3, 3)
    angles = np.exp(1j * np.linspace(0, 2 * np.pi, 121))
    first, second = np.meshgrid(angles, angles)
    turned = M * np.stack([np.ones_like(first), first, second], axis=-1)[..., None, :]
    greatest = np.abs(np.linalg.eigvals(turned)).max()
    upper, lower = greatest_structured_value(M[None])
    assert greatest <= upper * (1 + 1e-12)
    np.testing.assert_allclose([upper, lower], greatest, rtol=2e-3)


def test_the_greatest_of_many_matrices():
    """Bounds are those of the matrix that decides, whatever the scaling of the others."""
    rng = np.random.default_rng(0)
    many = rng.normal(size=(40, 5, 5)) + 1j * rng.normal(size=(40, 5, 5))
    each = [greatest_structured_value(one[None]) for one in many]
    upper, lower = greatest_structured_value(many)
    np.testing.assert_allclose(upper, max(one[0] for one in each), rtol=2e-3)
    assert 0.9 * upper < lower <= upper


def test_one_loop_has_its_own_disk_margin():
    found = random_system(1)
    (own,) = loop_margins(found, ["torque/0"])
    np.testing.assert_allclose(simultaneous_disk_margin(found, "torque/0"), own.disk, rtol=1e-3)


def test_the_loops_of_a_scene_have_the_bounds_of_its_linearisations():
    scene = arm_scene(1, "planar")
    options = {"backend": "interpreted"}
    margins = sr.simultaneous_margins(scene, [0, 0.5], loops="torque/*", **options)
    systems = sr.linearise(scene, [0, 0.5], **options)
    bounds = {system.label: simultaneous_disk_margin(system, "torque/*") for system in systems}
    assert margins.bounds == bounds
    assert [label for label, _ in margins.content()[0].rows] == list(bounds)


def test_two_loops_at_once():
    """Within what is guaranteed no change destabilises; together they allow no more than each alone."""
    found = random_system(5)
    alone = min(one.disk for one in loop_margins(found))
    sure, most = simultaneous_disk_margin(found)
    assert 0 < sure <= most <= alone * (1 + 1e-3)
    rng = np.random.default_rng(0)
    for _ in range(300):
        # real factors of the signals: u = f y + w, so the closed loop is A + B (I - F D)^-1 (F - I) C, D = 0
        factors = (1 + sure / 2 * rng.uniform(-1, 1, 2)) / (1 - sure / 2 * rng.uniform(-1, 1, 2))
        low, high = (2 - sure) / (2 + sure), (2 + sure) / (2 - sure)
        factors = np.clip(factors, low, high)
        poles = np.linalg.eigvals(found.A + found.B @ np.diag(factors - 1) @ found.C)
        assert poles.real.max() < 0
