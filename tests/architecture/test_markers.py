"""Markers say what tests need, and only tests that are there are named."""

import ast
from pathlib import Path

import pytest

from tests.conftest import FIXTURES, PLACES

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("place", [place for places in PLACES.values() for place in places])
def test_a_place_of_a_marker_is_there(place):
    file, _, name = place.partition("::")
    assert (ROOT / file).exists()
    if name:
        assert f"\ndef {name}" in (ROOT / file).read_text(encoding="utf-8")


def test_every_marker_is_registered(pytestconfig):
    known = {line.partition(":")[0] for line in pytestconfig.getini("markers")}
    assert FIXTURES.keys() | PLACES.keys() <= known


CLOCKS = {"perf_counter", "process_time", "thread_time", "perf_counter_ns", "process_time_ns"}


def test_no_test_measures_how_long_something_takes():
    """``monotonic`` bounds how long is waited for another process; no number is made of it."""
    for path in (ROOT / "tests").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = (
                node.attr
                if isinstance(node, ast.Attribute)
                else node.id
                if isinstance(node, ast.Name)
                else ""
            )
            assert name not in CLOCKS, f"{path}:{node.lineno}"
