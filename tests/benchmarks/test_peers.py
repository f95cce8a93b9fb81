"""The command that fills the page on peers, without the peers."""

import dataclasses
import json

import numpy as np
import pytest

from benchmarks.peers import __main__ as peers
from benchmarks.peers.compare import Outcome, Side, compare, converged, distance

OUTCOME = Outcome("state 1e-09", "2e-08 / 3e-08", 0.002, 0.05, "tanaka6, 20 ms", "RK4, 2.5 ms")


def absent():
    raise ImportError("No module named 'peer'")


@pytest.fixture
def scene():
    return dataclasses.replace(
        next(iter(peers.found_scenes().values())), package="numpy", measure=lambda: OUTCOME
    )


def columns(line):
    return line.count("|")


def test_every_scene_is_found_without_its_peer():
    found = peers.found_scenes()
    assert {scene.peer for scene in found.values()} == {"Basilisk", "Drake", "MuJoCo", "Pinocchio"}
    assert all(
        "\n" not in scene.title + scene.note and "|" not in scene.title + scene.note
        for scene in found.values()
    )


def test_a_missing_peer_is_one_line(scene):
    found = peers.measured(dataclasses.replace(scene, measure=absent))
    line = peers.row(scene, found)
    assert "not installed (pip install numpy)" in line
    assert "\n" not in line
    assert columns(line) == columns(peers.HEAD)


def test_a_peer_of_which_parts_are_left_is_missing(scene):
    found = peers.measured(dataclasses.replace(scene, package="no-such-peer", measure=lambda: 1 / 0))
    assert "not installed (pip install no-such-peer)" in found["missing"]


def test_a_scene_that_fails_is_one_line():
    found = peers.in_a_process("no_such_scene")
    assert found["missing"].startswith("ended with code 1: KeyError")


def test_a_measured_scene_has_every_column(scene):
    found = json.loads(json.dumps(peers.measured(scene)))
    assert found["version"] == np.__version__
    line = peers.row(scene, found)
    assert columns(line) == columns(peers.HEAD)
    assert "| 2 ms | 50 ms | 25 |" in line


def test_the_page_keeps_its_text_and_has_the_table():
    page = peers.PAGE.read_text(encoding="utf-8")
    once = peers.filled(page, ["new"])
    assert peers.filled(once, ["newer"]) == once.replace("new\n", "newer\n")
    assert once.split(peers.BEGIN)[0] == page.split(peers.BEGIN)[0]
    assert once.split(peers.END)[1] == page.split(peers.END)[1]
    assert peers.HEAD in page
    rows = [
        line
        for line in page.splitlines()
        if line.startswith(("| Basilisk ", "| Drake ", "| MuJoCo ", "| Pinocchio "))
    ]
    assert {columns(line) for line in rows if columns(line) > 5} == {columns(peers.HEAD)}


def decaying(rate, order):
    """exp(-rate) with an error of that order of the step."""
    return Side(
        lambda level: lambda: np.array([np.exp(-rate) + 0.1 * 2.0 ** (-order * level)]),
        lambda level: f"{level}",
    )


def test_each_side_is_refined_to_the_same_error():
    level, change, finer = converged(decaying(1.0, 2), 1e-4)
    assert level == 5  # 0.1 (2^-2k - 2^-2(k+1)) = 7.3e-5
    assert change == pytest.approx(0.075 * 4.0**-5)
    assert finer == pytest.approx(np.exp(-1) + 0.1 * 4.0**-6)
    outcome = compare(decaying(1.0, 4), decaying(1.0, 2), 1e-4)
    assert outcome.ours.startswith("3;")
    assert outcome.theirs == "5"
    assert outcome.numbers["difference"] == pytest.approx(0.1 * (4.0**-6 - 16.0**-4))


def test_whole_turns_do_not_matter_and_large_components_count_relatively():
    assert distance(np.array([0.1 + 4 * np.pi]), np.array([0.1])) < 1e-12
    assert distance(np.array([1000.1]), np.array([1000.0])) == pytest.approx(1e-4)
