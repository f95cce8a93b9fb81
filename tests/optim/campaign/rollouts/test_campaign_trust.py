"""Ledgers of rollouts: nothing where all is well, told where steps are too long, against whole rollouts."""

import numpy as np
import pytest
import xarray as xr

from optim.campaign.analysis.samples import simulate_sample
from optim.campaign.analysis.summary import summarise
from optim.campaign.rollouts.evaluator import build_evaluator
from optim.campaign.rollouts.trust import DEPTH, DRIFT, RESIDUAL, caveats, drift_of, residual_of, untrusted
from optim.campaign.run import run_campaign
from optim.campaign.store.netcdf import load_campaign
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate


def test_drift_is_that_of_a_whole_rollout(small):
    evaluator = build_evaluator(small(simulation__method="rk4"), {"stiff": {"robots.*.tips.tip.pid.kp": 300}})
    draw = np.array([25.0, 1.5, 0.01, 1.5])
    table = evaluator.evaluate(draw[None])
    names = [column.name for column in evaluator.columns]
    data = simulate_sample(evaluator, draw, "stiff").data
    for kind in ("linear", "angular"):
        drift = table.metrics[0, 0, names.index(f"{DRIFT} {kind}")]
        total, bodies = data[f"momentum_{kind}"].values, data[f"body_momentum_{kind}"].values
        largest = np.linalg.norm(bodies[[0, -1]], axis=-1).max()
        assert drift == pytest.approx(np.linalg.norm(total[-1] - total[0]) / largest, rel=1e-3)
        assert drift > 1e-12
    stored = (data.energy_kinetic + data.energy_spring + data.energy_potential).values
    works = {name: data[f"work_{name}"] for name in ("actuator", "joint", "grasp", "constraint")}
    explained = sum(float(work[-1]) * work.attrs["sign"] for work in works.values())
    largest = max(
        abs(stored[0]), abs(stored[-1]), abs(stored[-1] - stored[0]), *(abs(w[-1]) for w in works.values())
    )
    residual = table.metrics[0, 0, names.index(f"{RESIDUAL} total")]
    assert residual == pytest.approx(abs(stored[-1] - stored[0] - explained) / float(largest), rel=1e-3)
    assert residual > 1e-12


def test_shorter_steps_drift_less_by_the_order_of_the_method(small):
    drifts = []
    for step in (0.02, 0.01):
        evaluator = build_evaluator(small(campaign__step=step), {"stiff": {"robots.*.tips.tip.pid.kp": 300}})
        table = evaluator.evaluate(np.array([[25.0, 1.5, 0.01, 1.5]]))
        drifts.append(table.metrics[0, 0, -1])
    assert 8 < drifts[0] / drifts[1] < 80


def test_parts_by_hand():
    linear = [0.0, 3.0, -4.0, 10.0]  # changed by 5, a body has 10
    angular = [0, 0, 1e-8, 0.0]  # as good as nothing
    assert drift_of(np.array([linear + angular])) == pytest.approx(np.array([[0.5, 1e-3]]))
    energies = np.array([[2.0, 8.0], [1e-8, 0.0]])
    assert residual_of(energies) == pytest.approx(np.array([[0.25], [1e-2]]))


def test_a_campaign_with_steps_that_are_too_long_says_so(small, tmp_path):
    gains = {"all": {"robots.*.tips.tip.pid.kp": 400}}
    rough = small(simulation__method="rk4", campaign__step=0.25, campaign__samples=16, campaign__gains=gains)
    ran = run_campaign(rough, tmp_path / "rough")
    summary = summarise(ran.folder, ran.evaluator)
    data = load_campaign(ran.folder)
    told = summary["untrusted"]["all"]
    drift = data[DRIFT].values[:, 0].max(axis=1)
    residual = data[RESIDUAL].values[:, 0, 0]
    assert told["count"] == ((drift > 0.01) | (residual > 0.01)).sum() > 0
    assert told["largest"] == {DRIFT: np.nanmax(drift), RESIDUAL: np.nanmax(residual)}
    assert told["of"] == np.isfinite(drift).sum()
    (sentence,) = summary["caveats"]
    assert f"{told['count']} of {told['of']} completed rollouts leave the ledger open" in sentence
    assert "shorter than 0.25 s" in sentence
    nobody = untrusted(data, {"all": np.ones(16, bool)})
    assert nobody["all"]["not_failed"] == 0
    assert "all of them count as failed" in caveats(nobody, ran.evaluator.campaign)[0]


def test_nothing_is_said_where_all_is_well_or_momentum_is_not_constant(small, tmp_path):
    ran = run_campaign(small(campaign__samples=8), tmp_path / "fine")
    summary = summarise(ran.folder, ran.evaluator)
    assert summary["caveats"] == []
    assert summary["untrusted"]["soft"]["largest"][DRIFT] < 1e-4
    held = small(campaign__samples=8, gravity=[0, -0.1, 0])
    ran = run_campaign(held, tmp_path / "held")
    assert DRIFT not in load_campaign(ran.folder)
    assert list(summarise(ran.folder, ran.evaluator)["untrusted"]["soft"]["largest"]) == [RESIDUAL]


def test_energy_is_judged_where_momentum_is_not_constant(small, tmp_path):
    """As that of a scene in gravity."""
    gains = {"all": {"robots.*.tips.tip.pid.kp": 400}}
    rough = small(
        simulation__method="rk4",
        campaign__step=0.25,
        campaign__samples=16,
        campaign__gains=gains,
        gravity=[0, -0.1, 0],
    )
    ran = run_campaign(rough, tmp_path / "rough")
    summary = summarise(ran.folder, ran.evaluator)
    assert summary["untrusted"]["all"]["count"] > 0
    assert "energy residual at most" in summary["caveats"][0]


def test_indentation_counts_as_in_a_run(tmp_path):
    """A soft contact: the ball is half way through the fist, though momenta and energy are kept."""
    soft = {
        "contacts.bump": {"between": ["fist", "target/body"], "stiffness": 300, "friction": 0},
        "simulation": {"duration": 1.2, "output_step": 0.1, "step": 0.005},
        "campaign": {
            "parameters": {"speed": {"paths": "target.base.velocity.0", "lower": -1.5, "upper": -0.2}},
            "metrics": ["tip_error_peak"],
            "samples": 4,
            "step": 0.005,
        },
    }
    scene = load_scene("bounce", soft)
    evaluator = build_evaluator(scene)
    names = [column.name for column in evaluator.columns]
    speeds = np.array([[-0.2], [-1.5]])
    found = evaluator.evaluate(speeds).metrics[:, 0, names.index(f"{DEPTH} bump")]
    assert found[0] < 0.5 < found[1]
    for speed, depth in zip(speeds[:, 0], found, strict=True):
        run = simulate(load_scene("bounce", {**soft, "target.base.velocity.0": speed}), backend="interpreted")
        assert ("deep" in run.summary["status"]) is bool(depth > 0.5)
        assert ("stiffer contact" in (run.summary["status"]["advice"] or "")) is bool(depth > 0.5)
        caveats_of_run = [w for w in run.summary["warnings"] if "bodies pass into each other" in w]
        assert len(caveats_of_run) == int(depth > 0.5)
    data = xr.Dataset({DEPTH: (("gains", "sample", "contact"), found[None, :, None])}, {"gains": ["all"]})
    told = untrusted(data, {"all": np.zeros(2, bool)})
    assert (told["all"]["count"], told["all"]["of"]) == (1, 2)
    (sentence,) = caveats(told, evaluator.campaign)
    assert "1 of 2 completed rollouts press bodies too deep into each other" in sentence
    assert "a stiffer contact" in sentence
    assert "campaign.step" not in sentence
