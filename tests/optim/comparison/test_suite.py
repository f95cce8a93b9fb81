"""The suite of problems: every one is a tuning problem that can be built, and a small one runs as a whole."""

from __future__ import annotations

import numpy as np
import pytest

from optim.comparison.report import to_data
from optim.comparison.suite import compare_suite, read_suite, scene_of
from optim.problem.variables import variables_of
from optim.search.session import SearchSession
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.registry import TUNING_METHODS

SUITE = read_suite()


def test_it_has_a_dozen_contests_of_known_methods():
    assert len(SUITE["problems"]) >= 12
    assert set(SUITE["methods"]) <= set(TUNING_METHODS.names())
    kinds = {benchmark["tuning"]["objective"]["kind"] for benchmark in SUITE["problems"].values()}
    assert {"ise", "itae", "minimax", "eq45"} <= kinds


@pytest.mark.parametrize("name", SUITE["problems"])
def test_each_contest_names_variables_of_its_scene(name):
    scene = scene_of(SUITE, name)
    variables = variables_of(scene, scene.scenario.tuning.variables)
    assert list(variables.names) == SUITE["problems"][name]["tune"]
    inside = (variables.lower <= variables.start) & (variables.start <= variables.upper)
    assert inside.sum() >= len(inside) / 2
    if "robust" in SUITE["problems"][name]:
        assert scene.scenario.campaign is not None


def test_two_contests_run_and_are_resumed(tmp_path):
    effort = {"budget": 32, "runs": 2, "starts": 1}
    asked = {"methods": ["de", "nlp"], "effort": effort, "session": SearchSession(tmp_path)}
    data = [to_data(compare_suite(["carry-ise", "carry-torque"], **asked)) for _ in range(2)]
    for benchmark, again in zip(data[0]["problems"], data[1]["problems"], strict=True):
        assert benchmark["baseline"] is None
        assert benchmark["best_known"] < benchmark["start_objective"]
        assert benchmark["best_known"] == again["best_known"]
        assert all(np.isfinite(t["spent"]) for m in benchmark["methods"].values() for t in m["trials"])
    assert data[0]["conclusion"] == data[1]["conclusion"]


def test_an_unknown_contest_is_told_with_near_names():
    with pytest.raises(SpaceRobotError, match="did you mean carry-ise"):
        compare_suite(["carry-is"])
