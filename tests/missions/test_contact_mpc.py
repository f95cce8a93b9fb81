"""Test of a predictive controller: what it chooses costs less, when it is simulated, than staying."""

from pathlib import Path

import numpy as np
import pytest

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import build_rollout
from spacerobot.rollout.resumable_loop import resumed
from spacerobot.updates.plant import SinglePlant
from spacerobot.updates.scheme import UpdatedScene

PLUGIN = Path(__file__).parents[2] / "examples" / "touch" / "contact_mpc.py"
PERIOD_S, HORIZON_S, STEP_S = 0.2, 1.5, 0.01
STRIKE_S, UNIT_N, FORCE_WEIGHT = 0.1, 10.0, 0.01
STRONG_N = 500.0
"""Force of an earlier strike, beside which no contact of this test counts."""
CHANGES = {
    "phases": {},
    "grasps": {},
    "robots.chaser.controllers.contacts": {
        "kind": "contact_mpc",
        "period": PERIOD_S,
        "horizon": HORIZON_S,
        "candidates": 24,
    },
    "robots.chaser.tips.left_tip.reference": {"kind": "approach", "direction": [0, -1, 0]},
    "robots.chaser.tips.right_tip.reference": {"kind": "approach", "direction": [0, 1, 0]},
    "simulation.duration": HORIZON_S,
    "target.base.spin_deg.2": 5,
}


def costs(plant):
    """Peak force over the horizon [N], and cost without it, of the approaches that are followed."""
    (end,) = plant.roll(plant.parameters, plant.start, HORIZON_S).inputs
    effort, waited, last = (end[f"contacts_input_{name}"].item() for name in ("effort", "waited", "cost"))
    return UNIT_N * (effort / STRIKE_S) ** 0.25, waited / HORIZON_S + last


def test_the_choice_costs_less_than_staying_and_contacts_below_an_earlier_peak_cost_nothing():
    sr.load_plugin(PLUGIN)
    updated = UpdatedScene.of(sr.load_scene("touch", CHANGES))
    loop = build_closed_loop(updated.scene)
    rollout = build_rollout(resumed(loop), duration_s=HORIZON_S, step_s=STEP_S, backend="interpreted")

    def followed(earlier_n):
        """Costs of staying and of the choice, after an earlier strike."""
        plant = SinglePlant(loop, rollout, HORIZON_S)
        (effort,) = [k for k, name in enumerate(loop.state_names) if "contacts.effort" in name]
        before = costs(plant)
        plant.start[0, 1 + effort] = value = STRIKE_S * (earlier_n / UNIT_N) ** 4
        plant.inputs = [{"contacts_input_effort": np.array([value])}]
        updated.schemes[0].start(plant, 1, "interpreted", lambda _: None).update(np.array([0]))
        plant.start[0, 1 + effort] = 0.0
        return before, costs(plant)

    (stay_n, stay), (careful_n, careful) = followed(0.0)
    _, (bold_n, bold) = followed(STRONG_N)
    assert FORCE_WEIGHT * careful_n + careful < FORCE_WEIGHT * stay_n + stay - 1e-3
    assert bold < careful - 1e-3
    assert careful_n < bold_n < STRONG_N / 2


def test_predictions_count_as_rollouts_in_the_choice_of_the_backend(monkeypatch):
    sr.load_plugin(PLUGIN)
    requests = []

    def build(*_, rollouts, **options):
        requests.append(rollouts * options["duration_s"])
        raise InterruptedError

    monkeypatch.setattr("spacerobot.simulation.run.build_rollout", build)
    for candidates in (24, 3):
        changes = CHANGES | {"robots.chaser.controllers.contacts.candidates": candidates}
        with pytest.raises(InterruptedError):
            sr.simulate(sr.load_scene("touch", changes))
    choices = 8  # in 1.5 s, one every 0.2 s
    assert requests == pytest.approx([2 * HORIZON_S + choices * n * HORIZON_S for n in (24, 3)], abs=PERIOD_S)
