"""What one evaluation of the shipped closed loops costs, counted in operations."""

from __future__ import annotations

import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.scene import load_scene


@pytest.mark.parametrize(("name", "bound"), [("paper", 2700), ("servicer", 25_300)])
def test_loads_are_reduced_once_and_accelerations_swept_once(name, bound):
    """A sweep forward for each unit load as well would cost 2900 and 42 700."""
    dynamics = build_closed_loop(load_scene(name)).dynamics
    assert dynamics.n_instructions() - dynamics.nnz_in() - dynamics.nnz_out() <= bound
