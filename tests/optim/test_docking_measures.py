"""What tuning and campaigns measure of a docking."""

import casadi as ca
import pytest

from optim.campaign.rollouts.metrics import build_campaign_metrics
from optim.problem.objectives import build_terms
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.quantities import metrics
from spacerobot.scenario import Constraints, Objective
from tests.oracles.free_bodies import FLAT, free_bodies
from tests.oracles.hybrid import roll
from tests.oracles.small_scenes import PLANAR, small_scene


def final_values(measures, run):
    """Measures that are values at the end, evaluated where a rollout came to."""
    signals = measures.signals
    own = ("capture_time", "impulse", "event_energy")
    expressions = {name: value for name, value in measures.of_kind("final").items() if name in own}
    inputs = [signals.x, *signals.outputs.values()]
    values = run.outputs()
    at = ca.Function("at", inputs, list(expressions.values()))(run.x, *(values[n] for n in signals.outputs))
    return {name: value.full().ravel() for name, value in zip(expressions, at, strict=True)}


@pytest.mark.parametrize("distance", [0.05, 1e-3], ids=["captured", "missed"])
def test_a_campaign_keeps_what_a_docking_took(tmp_path, distance):
    scene = free_bodies(tmp_path, FLAT, {"kind": "point", "capture": {"distance": distance}})
    loop = build_closed_loop(scene)
    kept = build_campaign_metrics(loop, scene, metrics())
    names = [column.name for column in kept.columns]
    assert {"capture_time left", "miss_distance left", "impulse left", "event_energy total"} <= set(names)
    run = roll(loop, 3.0)
    values = final_values(kept.measures, run)
    if distance == 0.05:
        assert values["capture_time"] == pytest.approx(run.events[0].time)
        assert values["impulse"] > 0.1
        assert values["event_energy"] > 0
    else:
        assert values["capture_time"] == 3.0  # as late as the simulation
        assert values["impulse"] < 1e-9


def test_tuning_weighs_and_limits_it(tmp_path):
    scene = free_bodies(tmp_path, FLAT, {"kind": "weld", "capture": {"distance": 0.05}})
    loop = build_closed_loop(scene)
    objective = Objective(weight=0, capture_time=2.0, event_energy=3.0, lateral_miss=4.0, touchdown_speed=5.0)
    terms = build_terms(loop, scene, objective, Constraints(max_impulse=5.0))
    assert terms.limits == {"impulse": 5.0}
    r = {name: ca.SX.sym(name, size) for name, size in terms.measures.sizes.items()}
    cost = terms.measures.cost_expressions(r, {})["objective"]
    given = {"capture_time": 0.5, "event_energy": 0.25, "lateral_miss": 0.125, "touchdown_speed": 0.0625}
    value = ca.Function("cost", list(r.values()), [cost])(*(given.get(name, 1.0) for name in r))
    assert float(value) == pytest.approx(2.0 * 0.5 + 3.0 * 0.25 + 4.0 * 0.125 + 5.0 * 0.0625)


def test_a_scene_without_captures_refuses_them():
    scene = small_scene(PLANAR)
    loop = build_closed_loop(scene)
    assert not {"capture_time", "impulse"} & {
        c.metric for c in build_campaign_metrics(loop, scene, metrics()).columns
    }
    with pytest.raises(ScenarioError, match=r"tuning\.objective\.capture_time"):
        build_terms(loop, scene, Objective(capture_time=1.0), Constraints())
    with pytest.raises(ScenarioError, match=r"tuning\.constraints\.max_impulse"):
        build_terms(loop, scene, Objective(), Constraints(max_impulse=1.0))
