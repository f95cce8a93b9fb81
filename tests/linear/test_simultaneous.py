"""Disk margins of loops that change at once: decoupled loops, one loop, the onset of instability."""

import sys

import numpy as np
import pytest

from spacerobot.errors import SpaceRobotError
from spacerobot.linear.loop_margins import loop_margins
from spacerobot.linear.simultaneous import simultaneous_disk_margin
from tests.linear.test_margins import random_system


def test_without_slycot_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "slycot", None)
    with pytest.raises(SpaceRobotError, match="pip install slycot"):
        simultaneous_disk_margin(random_system(1))


def test_one_loop_has_its_own_disk_margin():
    pytest.importorskip("slycot")
    found = random_system(1)
    (own,) = loop_margins(found, ["torque/0"])
    np.testing.assert_allclose(simultaneous_disk_margin(found, "torque/0"), own.disk, rtol=1e-3)


def test_two_loops_at_once():
    """Within what is guaranteed no change destabilises; together they allow no more than each alone."""
    pytest.importorskip("slycot")
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
