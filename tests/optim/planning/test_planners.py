"""Processes that solve plans end without a word when the process that began them is gone."""

import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

ROOT = Path(__file__).parents[3]
ENDLESS = """
import os
from optim.planning.mpc import planners

class Endless:
    def __init__(self, scene):
        pass

    def name(self):
        return "endless"

    def first(self):
        os.write(2, b"solving ")
        while True:
            sum(range(1000))

planners.Planners = Endless
planners.serve()
"""
RECIPE = pickle.dumps(SimpleNamespace(build=int))


@pytest.mark.parametrize(
    ("requests", "said"),
    [
        ([pickle.dumps(("first", ()))], b"solving "),
        ([pickle.dumps(("name", ()))], b""),
        ([pickle.dumps(("first", (b" " * 1000,)))[:500]], b""),
        ([], b""),
    ],
    ids=["while it solves", "between two requests", "within a request", "before the first request"],
)
def test_a_planner_ends_when_its_requests_end(requests, said):
    """The pipe ends as it does when the parent is killed; without its end the solve here never ends."""
    process = subprocess.Popen(
        [sys.executable, "-c", ENDLESS],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        for request in [RECIPE, *requests]:
            process.stdin.write(request)
        process.stdin.flush()
        if said:
            assert process.stderr.read(len(said)) == said
        elif requests == [pickle.dumps(("name", ()))]:
            assert pickle.load(process.stdout) == "endless"
        _, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    assert errors == b""
    assert process.returncode == 130


def test_a_planner_whose_answer_nobody_reads_ends_silently():
    process = subprocess.Popen(
        [sys.executable, "-c", ENDLESS],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    process.stdout.close()
    process.stdin.write(RECIPE + pickle.dumps(("name", ())))
    process.stdin.flush()
    assert process.wait(timeout=120) == 130
    assert process.stderr.read() == b""
    process.stdin.close()
    process.stderr.close()
