"""Batches and campaigns under model predictive control."""

import numpy as np
import pytest

from optim.campaign.rollouts.evaluator import build_evaluator
from optim.evaluation import batch, gradient
from spacerobot.common.errors import ScenarioError
from spacerobot.simulation import simulate
from tests.optim.planning.test_mpc import FLIGHT, SLOW

SPINS = [0.3, 0.7]
DELAYED = [*FLIGHT, *SLOW, ("robots.one.controllers.lead.delay", 0.3)]
NOISY = {
    "target_position": {"errors": {"period": 0.1, "delay": 0.1, "noise": 1e-3}},
    "joint_rate": {"errors": {"period": 0.05, "noise": 1e-4}},
}
METRICS = ("capture_time", "base_rotation_peak")


def test_a_batch_flies_each_simulation_as_alone(reach):
    scene = reach(*DELAYED)
    values = {"target.base.spin_deg.2": SPINS}
    found = batch(scene, METRICS, values, backend="interpreted", threads=1).data
    for i, spin in enumerate(SPINS):
        alone = simulate(reach(*DELAYED, ("target.base.spin_deg.2", spin)), backend="interpreted")
        (captured,) = (e["time_s"] for e in alone.summary["events"] if e["kind"] == "captured")
        assert found.capture_time.values[i, 0] == pytest.approx(captured, abs=1e-9)
        turned = np.degrees(np.linalg.norm(alone.data.body_rotation.sel(body="one"), axis=1).max())
        assert found.base_rotation_peak.values[i, 0] == pytest.approx(turned, rel=1e-2)  # at samples alone
    assert len(set(found.capture_time.values[:, 0])) == len(SPINS)


def test_numbers_do_not_depend_on_the_number_of_processes(reach):
    changes = [("robots.one.sensors", NOISY), ("campaign", CAMPAIGN)]
    evaluator = build_evaluator(reach(*DELAYED, *changes), compiled=False)
    draws = np.array([[1.0], [2.0]])
    alone = evaluator.evaluate(draws, threads=1)
    several = evaluator.evaluate(draws, threads=2)
    one = evaluator.evaluate(draws[1:2], threads=1)
    times = [i for i, column in enumerate(evaluator.columns) if column.unit == "s" and "mpc" in column.metric]
    for table, rows in ((several, slice(None)), (one, slice(1, 2))):
        found, known = (np.delete(each, times, axis=2) for each in (table.metrics, alone.metrics[rows]))
        np.testing.assert_array_equal(found, known)
    names = [column.name for column in evaluator.columns]
    plans = alone.metrics[:, 0, names.index("mpc_plans total")]
    assert (plans == 2).all()
    assert len(set(alone.metrics[:, 0, names.index("capture_time grip")])) == 2  # noise differs


CAMPAIGN = {
    "parameters": {"noise": {"paths": "simulation.noise_draw", "lower": 0, "upper": 1e6}},
    "samples": 3,
    "step": 0.01,
    "metrics": ["capture_time"],
}


def test_gradients_are_refused_in_one_line(reach):
    with pytest.raises(ScenarioError, match="has no gradient") as fault:
        gradient(reach(*DELAYED), "capture_time", ["target.base.spin_deg.2"], backend="interpreted")
    assert fault.value.exit_code == 2
