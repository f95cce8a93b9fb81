"""A killed search, started again, ends with the same answer: whatever byte its journal was cut at."""

from __future__ import annotations

import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from optim.methods.evolutionary import evolve
from optim.methods.nlp import solve_from_many
from optim.methods.settings import EvolutionSettings, NlpSettings
from optim.search.journal import Journal
from optim.search.search import Search
from spacerobot.common.errors import ResultError
from tests import forks
from tests.oracles.known_optima import quadratic, rosenbrock

SMALL = EvolutionSettings(population=10, budget=150)


def _search(method, path):
    problem = rosenbrock() if method == "nlp" else quadratic()
    journal = Journal(path, f"{method} 1")
    search = Search(problem, method, seed=7, journal=journal)
    nlp = NlpSettings(screen=2)
    run = solve_from_many(search, nlp, 3) if method == "nlp" else evolve(search, SMALL)
    journal.close()
    return run, problem.calls


@pytest.mark.parametrize("method", ["ga", "de", "pso", "cmaes", "sobol", "random", "nlp"])
def test_a_journal_cut_anywhere_leads_to_the_same_answer(method, tmp_path):
    whole, calls = _search(method, tmp_path / "whole")
    content = (tmp_path / "whole").read_bytes()

    @settings(deadline=None, max_examples=8, derandomize=True)
    @given(st.integers(0, len(content)))
    def cut(size):
        path = tmp_path / "cut"
        path.write_bytes(content[:size])
        resumed, more = _search(method, path)
        assert np.array_equal(resumed.u, whole.u)
        assert resumed.objective == whole.objective
        assert resumed.cost == whole.cost
        assert len(resumed.history) == len(whole.history)
        assert more <= calls
        assert len(Journal(path, f"{method} 1")) == len(Journal(tmp_path / "whole", f"{method} 1"))

    cut()
    again, calls_again = _search(method, tmp_path / "whole")
    assert calls_again == 0
    assert again.objective == whole.objective


def test_a_damaged_record_and_all_after_it_are_forgotten(tmp_path):
    whole, _ = _search("ga", tmp_path / "j")
    content = bytearray((tmp_path / "j").read_bytes())
    content[len(content) // 2] ^= 255
    (tmp_path / "j").write_bytes(bytes(content))
    resumed, calls = _search("ga", tmp_path / "j")
    assert 0 < calls < SMALL.budget
    assert np.array_equal(resumed.u, whole.u)


def test_another_searchs_journal_is_begun_anew(tmp_path):
    _search("ga", tmp_path / "j")
    assert len(Journal(tmp_path / "j", "another")) == 0


def test_a_journal_that_asks_for_other_points_is_cut_there(tmp_path):
    journal = Journal(tmp_path / "j", "x")
    for value in (1.0, 2.0, 3.0):
        journal.append("values", np.array([value]), {"objective": np.array([value])})
    journal.close()
    again = Journal(tmp_path / "j", "x")
    assert again.replay("values", np.array([1.0]))["objective"] == 1.0
    assert again.replay("values", np.array([9.0])) is None
    again.close()
    assert len(Journal(tmp_path / "j", "x")) == 1


def test_a_journal_that_cannot_be_written_says_so(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ResultError, match="cannot be written"):
        Journal(tmp_path / "file" / "j", "x")


SCRIPT = """
    import sys
    from pathlib import Path
    from optim import Effort, NlpSettings, EvolutionSettings, build_problem, tune
    from spacerobot.scene import load_scene
    protocol = EvolutionSettings(population=10, budget=600)
    effort = Effort(protocol, protocol, runs=2, nlp=NlpSettings(iterations=40), starts=3)
    scene = load_scene(sys.argv[1])
    problem = build_problem(scene, variables=["kp", "ta"])
    found = tune(problem, sys.argv[2], effort=effort, folder=Path(sys.argv[3]))
    print(repr((dict(found.gains), found.objective, [r.cost for r in found.outcome.runs])))
"""


@pytest.mark.parametrize("method", ["ga", "nlp"])
def test_a_process_killed_at_a_random_time_runs_on_to_the_same_answer(method, small_file, tmp_path):
    def start(folder):
        return forks.begin(SCRIPT, small_file, method, folder)

    def written(folder):
        return sum(path.stat().st_size for path in folder.glob("*.journal"))

    whole = start(tmp_path / "whole").wait().stdout
    share = np.random.default_rng().uniform(0.05, 0.9)
    size = share * written(tmp_path / "whole")
    process = start(tmp_path / "killed")
    while process.poll() is None and written(tmp_path / "killed") < size:
        time.sleep(0.002)
    process.kill()
    process.wait()
    before = written(tmp_path / "killed")
    # by a fresh Python, whose sets have another order
    words = [textwrap.dedent(SCRIPT), str(small_file), method, str(tmp_path / "killed")]
    resumed = subprocess.run(
        [sys.executable, "-c", *words], stdout=subprocess.PIPE, text=True, check=True
    ).stdout
    assert before > 0
    assert resumed == whole, f"killed at {share:.3f} of the journal"
    assert "objective" not in whole
    assert whole.startswith("(")
