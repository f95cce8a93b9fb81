"""Test of a predictive controller: what it chooses costs less, when it is simulated, than staying."""

from pathlib import Path

import spacerobot as sr

PLUGIN = Path(__file__).parents[2] / "examples" / "touch" / "contact_mpc.py"
PERIOD_S = 0.2


def cost(depth):
    """Cost of one choice, from the simulation that follows it: as long as the horizon, equally rough."""
    chooses = {
        "kind": "contact_mpc",
        "period": PERIOD_S,
        "horizon": PERIOD_S,
        "candidates": 3,
        "depth": depth,
    }
    changes = {
        "phases": {},
        "grasps": {},
        "robots.chaser.controllers.contacts": chooses,
        "robots.chaser.tips.left_tip.reference": {"kind": "approach", "direction": [0, -1, 0]},
        "robots.chaser.tips.right_tip.reference": {"kind": "approach", "direction": [0, 1, 0]},
        "simulation.duration": PERIOD_S,
        "simulation.output_step": PERIOD_S,
    }
    data = sr.simulate(sr.load_scene("touch", changes), backend="interpreted").data
    last = {name: data[f"contacts_input_{name}"].values[-1].item() for name in ("effort", "waited", "cost")}
    return 0.01 * 10 * (last["effort"] / 0.1) ** 0.25 + last["waited"] / PERIOD_S + last["cost"]


def test_what_is_chosen_costs_less_than_staying():
    sr.load_plugin(PLUGIN)
    assert cost(0.06) < cost(1e-9) - 1e-3
