"""What tuning and campaigns measure of bases that act, and of the tips' jitter."""

import numpy as np
import pytest

from optim.campaign.rollouts.metrics import build_campaign_metrics
from optim.problem.objectives import OBJECTIVE, build_terms, extended_loop
from optim.problem.quantity_measures import with_added_states
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.quantities import find_quantity
from spacerobot.rollout import build_rollout
from spacerobot.scenario import Constraints, Objective
from tests.oracles.small_scenes import PLANAR, small_scene

NOZZLES = {
    f"{name}_{side}": {"position": [x, y, 0], "direction": push}
    for name, push in (("ahead", [1, 0, 0]), ("back", [-1, 0, 0]), ("left", [0, 1, 0]), ("right", [0, -1, 0]))
    for side, x, y in (("one", 0.3, 0.3), ("two", -0.3, -0.3))
}
HELD = {
    "robots.one.controllers": {"turn": {"kind": "base_attitude", "kp": 40, "kd": 20}},
    "robots.one.actuators": {"jets": {"kind": "thrusters", "thrust": 20, "nozzles": NOZZLES}},
}
RUN = {"duration_s": 0.4, "step_s": 0.01, "backend": "interpreted"}


@pytest.fixture(scope="module")
def held():
    """A robot of two that holds its base by thrusters, and its closed loop."""
    scene = small_scene(PLANAR, HELD)
    return scene, build_closed_loop(scene)


def test_objectives_have_exact_gradients(held):
    scene, loop = held
    objective = Objective(weight=0, base_attitude=3.0, propellant=50.0, jitter=200.0, jitter_frequency=2.0)
    extended = extended_loop(loop, scene, objective)
    terms = build_terms(extended, scene, objective, Constraints(max_attitude_error_deg=2, max_propellant=0.1))
    assert terms.limits == {"attitude_error_peak": 2, "propellant": 0.1}
    rollout = build_rollout(extended, measures=terms.measures, **RUN)
    paths = ["robots.one.controllers.turn.kp", "robots.one.actuators.jets.specific_impulse"]
    found = rollout.value_and_gradient(wrt=paths)
    parts = rollout.run().measures
    weighed = [
        3 * parts["attitude_error_rms"],
        50 * parts["propellant"],
        200 * sum(parts["jitter"]),
    ]
    whole = sum(weighed)
    assert min(weighed) > 1e-6
    assert found.costs[OBJECTIVE] == pytest.approx(float(np.sum(whole)))
    for path, slope in zip(paths, found.gradients[OBJECTIVE], strict=True):
        value = loop.parameter_values[loop.index(path)]
        ends = [rollout.run({path: value * (1 + sign * 1e-4)}).costs[OBJECTIVE] for sign in (1, -1)]
        assert slope == pytest.approx((ends[0] - ends[1]) / (2e-4 * value), rel=1e-5)


def test_jitter_is_the_error_behind_a_high_pass(held):
    scene, loop = held
    extended, frequency = with_added_states(loop, scene, [find_quantity("jitter")], 2.0), 2.0
    kept = build_campaign_metrics(loop, scene, ["jitter", "propellant", "attitude_error_peak"], extended)
    rollout = build_rollout(extended, measures=kept.measures, output_step_s=1e-3, **(RUN | {"step_s": 1e-3}))
    run = rollout.run()
    slow, squares = np.zeros(6), 0.0
    for before, now in zip(run.outputs["tip_error"], run.outputs["tip_error"][1:], strict=False):
        first = before - slow
        fade = np.exp(-2 * np.pi * frequency * 1e-3)
        slow = (before + now) / 2 + fade * (slow - (before + now) / 2)
        squares = squares + 5e-4 * (first**2 + (now - slow) ** 2)
    np.testing.assert_allclose(run.measures["jitter"], squares.reshape(2, 3).sum(axis=1), rtol=1e-3)
    row = kept.table({name: np.atleast_2d(value) for name, value in run.measures.items()})[0]
    told = dict(zip([column.name for column in kept.columns], row, strict=True))
    assert told["jitter one/tip"] == pytest.approx(np.sqrt(run.measures["jitter"][0] / kept.duration_s))
    assert [column.unit for column in kept.columns if column.metric == "jitter"] == ["m", "m"]
    assert told["propellant one"] == pytest.approx(float(run.outputs["propellant"][-1][0]))
    error = np.degrees(np.abs(run.outputs["base_attitude_error"][:, 2]).max())
    assert told["attitude_error_peak one"] == pytest.approx(error)
    assert not {"propellant two", "attitude_error_peak target"} & set(told)  # which have neither


@pytest.mark.parametrize(
    ("objective", "limits", "told"),
    [
        ({"base_attitude": 1}, {}, r"tuning\.objective\.base_attitude.*controller of kind base_attitude"),
        ({"wheel_momentum": 1}, {}, r"tuning\.objective\.wheel_momentum.*reaction_wheels"),
        ({"propellant": 1}, {}, r"tuning\.objective\.propellant.*thrusters"),
        ({}, {"max_wheel_momentum": 1}, r"tuning\.constraints\.max_wheel_momentum.*reaction_wheels"),
    ],
)
def test_a_scene_without_them_refuses_them(objective, limits, told):
    scene = small_scene(PLANAR)
    with pytest.raises(ScenarioError, match=told):
        build_terms(build_closed_loop(scene), scene, Objective(**objective), Constraints(**limits))


def test_an_event_leaves_what_is_slow_of_the_errors_as_it_is():
    scene = small_scene(PLANAR, HELD | {"robots.one.actuators.jets.mode": "pulsed"})
    loop = build_closed_loop(scene)
    extended = with_added_states(loop, scene, [find_quantity("jitter")], 1.0)
    x0, c = extended.setup(extended.parameter_values)
    x = x0.full().ravel() + np.r_[np.zeros(len(loop.state_names)), np.arange(1, 7)]
    for event in range(len(loop.events)):
        after = extended.update(0.1, x, c, event).full().ravel()
        np.testing.assert_array_equal(after[-6:], np.arange(1, 7))
        own = loop.update(0.1, x[:-6], c, event).full().ravel()
        np.testing.assert_array_equal(after[:-6], own)
