"""Seeded mangled scenarios, rollouts and result folders: no traceback, none above 15 s of processor time."""

from __future__ import annotations

import random
import shutil

import pytest

from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles import mangled_results, one_arm
from tests.oracles.mangled import cases, judged, rollouts


@pytest.mark.parametrize("seed", range(100, 105))
def test_mangled_scenarios_end_in_one_line(seed):
    assert [wrong for case in cases(seed, 100) if (wrong := judged(case)) is not None] == []


@pytest.mark.parametrize("seed", [11, 12])
def test_mangled_rollouts_end_in_one_line(seed):
    assert [wrong for case in rollouts(seed, 100) if (wrong := judged(case)) is not None] == []


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    scene = load_scene(one_arm.write(folder), {"simulation.duration": 0.2})
    return simulate(scene, backend="interpreted").save(folder / "r").folder


def test_mangled_results_end_in_one_line(whole, tmp_path):
    rng, faults, folder = random.Random(5), [], tmp_path / "r"
    for number in range(100):
        mangled_results.mangle(rng, whole, folder)
        wrong = judged(lambda: mangled_results.use(folder))
        faults += [(number, wrong)] * (wrong is not None)
        shutil.rmtree(folder)
    assert faults == []
