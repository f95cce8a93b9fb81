"""Tuning over samples: against plain batches, finite differences and fresh samples."""

from dataclasses import replace

import numpy as np
import pytest

from optim.campaign.robust import build_robust, tune_robust
from optim.methods import effort_of, run_method
from optim.objectives import OBJECTIVE
from spacerobot.errors import ScenarioError, SpaceRobotError

TUNING = {
    "variables": {
        "kp": {"paths": "robots.*.tips.tip.pid.kp", "lower": 20, "upper": 400},
        "ta": {"paths": "robots.arm.tips.tip.amnesia.ta", "lower": 0.5, "upper": 20, "scale": "log"},
    },
    "budget": 40,
    "population": 8,
    "runs": 1,
    "starts": 1,
    "iterations": 15,
    "step": 0.01,
}


@pytest.fixture(scope="module")
def problems(small):
    scene = small(tuning=TUNING)
    return {kind: build_robust(scene, kind, samples=21) for kind in ("mean", "percentile", "worst")}


def test_values_are_those_of_a_plain_batch(problems):
    mean = problems["mean"]
    u = np.array([[0.3, 0.6], [0.8, 0.2]])
    for row, objective in zip(u, mean.evaluate(u).objective, strict=True):
        columns = dict(zip(mean.space.paths, mean.space.values(mean.draws).T, strict=True))
        each = mean.nominal.measure(np.tile(row, (21, 1)), columns)[OBJECTIVE]
        assert objective == pytest.approx(each.mean(), rel=1e-12)
        assert problems["worst"].evaluate(row[None]).objective == each.max()
        found = problems["percentile"].evaluate(row[None]).objective
        assert found == pytest.approx(np.percentile(each, 95), rel=1e-12)
        assert np.ptp(each) > 0.1 * each.mean()


@pytest.mark.parametrize("kind", ["mean", "percentile", "worst"])
def test_gradients_are_finite_differences(problems, kind):
    problem, u, h = problems[kind], np.array([0.3, 0.6]), 1e-5
    found = problem.linearise(u)
    for i, step in enumerate(h * np.eye(2)):
        up, down = problem.evaluate(np.array([u + step, u - step])).objective
        assert found.gradient[i] == pytest.approx((up - down) / (2 * h), rel=1e-5)
    assert found.objective == pytest.approx(problem.evaluate(u[None]).objective[0], rel=1e-9)
    if kind == "worst":
        assert found.rows.max() == found.objective
        assert found.rows_jacobian[found.rows.argmax()] == pytest.approx(found.gradient)


def test_a_diverged_sample_decides_only_what_it_belongs_to(problems):
    values = np.arange(21.0)
    values[4] = np.nan
    assert np.isnan(problems["mean"].reduce(values))
    assert np.isnan(problems["worst"].reduce(values))
    assert problems["percentile"].reduce(values) == 20  # 95 % of 21: the last but one
    few = replace(problems["percentile"], percent=50.0)
    assert few.reduce(values) == 11  # 4 counts as larger than any


@pytest.mark.parametrize("method", ["ga", "nlp"])
def test_the_worst_case_gets_better_on_the_samples_tuned_for(problems, method):
    problem = problems["worst"]
    effort = effort_of(problem.nominal.scene.scenario.tuning)
    found = tune_robust(problem, method, effort=effort, fresh=40)
    assert found.objective < problem.evaluate(problem.start[None]).objective[0]
    assert set(found.fresh) == {"start", "nominal", "robust"}
    assert np.nanmax(found.fresh["robust"]) < np.nanmax(found.fresh["start"])
    assert set(found.changes) == {"robots.arm.tips.tip.pid.kp", "robots.arm.tips.tip.amnesia.ta"}
    u = problem.nominal.variables.unit(np.array([*found.gains.values()]))
    assert problem.reduce(problem.objectives(u)) == pytest.approx(found.objective, rel=1e-6)


def test_dask_changes_no_bit(small, problems):
    pytest.importorskip("distributed")
    from optim.workers.dask import open_workers

    effort = effort_of(small(tuning=TUNING).scenario.tuning, runs=2, starts=2)
    with open_workers(dask="local:2") as workers:
        for kind, method in (("mean", "nlp"), ("worst", "ga"), ("worst", "nlp")):
            there = build_robust(small(tuning=TUNING), kind, samples=21, workers=workers)
            one = run_method(problems[kind], method, effort).best
            other = run_method(there, method, effort, workers=workers).best
            assert np.array_equal(one.u, other.u)
            assert one.objective == other.objective


def test_what_cannot_be_is_told(small, problems):
    with pytest.raises(SpaceRobotError, match="no robust tuning by manual"):
        tune_robust(problems["mean"], "manual")
    with pytest.raises(ScenarioError, match="no tuning section"):
        build_robust(small())
    twice = {"gain": {"paths": "robots.arm.tips.tip.pid.kp", "lower": 1, "upper": 2}}
    with pytest.raises(ScenarioError, match="tuned and uncertain at once"):
        build_robust(small(**{"tuning": TUNING, "campaign.parameters": twice}))
    limited = small(**{"tuning": TUNING | {"constraints": {"max_grip_force": 6.0}}})
    problem = build_robust(limited, "worst", samples=5)
    assert problem.evaluate(problem.start[None]).constraints.shape == (1, 1)
    with pytest.raises(SpaceRobotError, match="no gradients; take ga"):
        problem.linearise(problem.start)
