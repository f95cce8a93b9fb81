"""Tuning over samples: against plain batches, finite differences and fresh samples."""

from dataclasses import replace

import numpy as np
import pytest

from optim.methods.run_method import run_method
from optim.methods.settings import effort_of
from optim.problem.objectives import OBJECTIVE
from optim.robust.problem import Statistic, build_robust, describe, tune_robust
from optim.search.session import SearchSession
from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.scene import load_scene

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
    return {
        kind: build_robust(scene, Statistic(kind, samples=21)) for kind in ("mean", "percentile", "worst")
    }


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


def test_dask_changes_no_bit(small, problems, forked_workers):
    from optim.workers.dask import open_workers

    effort = effort_of(small(tuning=TUNING).scenario.tuning, runs=2, starts=2)
    with open_workers(dask="local:2") as workers:
        for kind, method in (("mean", "nlp"), ("worst", "ga"), ("worst", "nlp")):
            there = build_robust(small(tuning=TUNING), Statistic(kind, samples=21), workers=workers)
            one = run_method(problems[kind], method, effort).best
            other = run_method(there, method, effort, session=SearchSession(workers=workers)).best
            assert np.array_equal(one.u, other.u)
            assert one.objective == other.objective


def test_what_cannot_be_is_told(small, problems):
    with pytest.raises(SpaceRobotError, match="found 'manual', which cannot tune robustly; allowed: "):
        tune_robust(problems["mean"], "manual")
    with pytest.raises(ScenarioError, match="no tuning section"):
        build_robust(small())
    twice = {"gain": {"paths": "robots.arm.tips.tip.pid.kp", "lower": 1, "upper": 2}}
    with pytest.raises(ScenarioError, match="tuned and uncertain at once"):
        build_robust(small(**{"tuning": TUNING, "campaign.parameters": twice}))


LIMIT = {"max_grip_force": 8.5}


@pytest.fixture(scope="module")
def limited(small):
    return build_robust(small(tuning=TUNING | {"constraints": LIMIT}), Statistic("mean", samples=9))


def test_every_sample_brings_its_constraints_and_their_exact_derivatives(limited):
    u, h = np.array([0.3, 0.6]), 1e-5
    found = limited.linearise(u)
    assert found.constraints.shape == (9,)
    assert found.constraint_jacobian.shape == (9, 2)
    assert found.constraints.max() == pytest.approx(limited.evaluate(u[None]).constraints[0, 0], rel=1e-9)
    values = limited.space.values(limited.draws)
    plants = dict(zip(limited.space.paths, values.T, strict=True))

    def each(point):
        return limited.nominal.measure(np.tile(point, (9, 1)), plants)["grip_force_peak"][:, 0] / 8.5 - 1

    for i, step in enumerate(h * np.eye(2)):
        differences = (each(u + step) - each(u - step)) / (2 * h)
        assert found.constraint_jacobian[:, i] == pytest.approx(differences, rel=1e-4, abs=1e-8)


@pytest.mark.parametrize("kind", ["mean", "worst"])
def test_constraints_hold_at_every_sample(small, limited, kind):
    """The limit binds: without it every method passes it."""
    problem = replace(limited, kind=kind)
    free = build_robust(small(tuning=TUNING), Statistic(kind, samples=9))
    effort = effort_of(problem.nominal.scene.scenario.tuning)
    loose = run_method(free, "nlp", effort).best
    assert problem.evaluate(loose.u[None]).violation[0] > 0.01
    found = run_method(problem, "nlp", effort).best
    assert found.feasible
    assert problem.evaluate(found.u[None]).violation[0] <= 1e-6
    assert problem.reduce(problem.objectives(found.u)) > free.reduce(free.objectives(loose.u))
    searched = run_method(problem, "ga", effort_of(small(tuning=TUNING).scenario.tuning, budget=200)).best
    assert found.objective <= searched.objective * 1.001


def test_gains_are_tuned_over_draws_of_the_noise():
    """Sampled and delayed control by noisy sensors: gradients, and a better result on fresh draws."""
    scene = load_scene("examples/as-flown.yaml", {"simulation.duration": 1.5})
    gains = scene.scenario.tuning.sets["gains"]
    problem, h = build_robust(scene, Statistic("mean", samples=8), variables=gains), 1e-4
    u = problem.start
    found = problem.linearise(u)
    for i, step in enumerate(h * np.eye(len(u))):
        up, down = problem.evaluate(np.array([u + step, u - step])).objective
        assert found.gradient[i] == pytest.approx((up - down) / (2 * h), rel=1e-4)
    tuned = tune_robust(problem, "nlp", effort=effort_of(scene.scenario.tuning, starts=1), fresh=32)
    assert np.ptp(tuned.fresh["start"]) > 0
    assert np.mean(tuned.fresh["robust"]) < 0.9 * np.mean(tuned.fresh["start"])


def test_periods_are_tuned_without_gradients_alone():
    """The objective jumps where a controller reads another sample of a noisy sensor."""
    scene = load_scene("examples/as-flown.yaml", {"simulation.duration": 1.0})
    problem = build_robust(scene, Statistic("mean", samples=4), variables=["kp", "period"])
    with pytest.raises(
        ScenarioError, match=r"tuning\.variables\.period: found a period, .*nlp.*; methods:.*cmaes"
    ):
        tune_robust(problem, "nlp")
    effort = effort_of(scene.scenario.tuning, baseline_budget=40)
    tuned = tune_robust(problem, "cmaes", effort=effort, fresh=16)
    assert tuned.gains["period"] < 0.02
    assert describe(tuned.common)["robust"]["mean"] == pytest.approx(tuned.objective, rel=1e-9)
    assert describe(tuned.fresh)["robust"]["change_high"] < 0


def test_statistics_have_intervals_and_leave_out_what_diverged():
    told = describe({"start": np.array([1.0, 2, 3, 4]), "robust": np.array([0.5, 1, np.nan, 3.5])})
    half = 3.182446 * np.sqrt(5 / 3) / 2  # Student's quantile of 3 degrees of freedom
    start, robust = told["start"], told["robust"]
    assert (start["mean"], start["diverged"], start["change"]) == (2.5, 0, 0)
    assert [start["mean_low"], start["mean_high"]] == pytest.approx([2.5 - half, 2.5 + half], rel=1e-6)
    assert (robust["largest"], robust["diverged"]) == (np.inf, 1)
    assert robust["change"] == pytest.approx(-2 / 3)
