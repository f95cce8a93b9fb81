"""What objects and small numbers look like in a terminal."""

import copy

import casadi as ca
import pytest

from optim import build_problem
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.result.table import headline
from spacerobot.rollout import Measures, Signals, build_rollout, integral
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles import one_arm
from tests.oracles.free_bodies import FLAT, free_bodies


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return load_scene(one_arm.write(tmp_path_factory.mktemp("shown")))


@pytest.fixture(scope="module")
def result(scene):
    return simulate(scene)


def test_objects_show_themselves_in_a_few_lines(scene):
    loop = build_closed_loop(scene)
    signals = Signals.of(loop)
    measures = Measures(signals, {"error": integral(ca.sumsqr(signals["tip_error"]))})
    rollout = build_rollout(loop, duration_s=0.1, step_s=0.01, measures=measures)
    batch = rollout.batch(["target.links.body.mass"], [[20.0], [21.0]])
    for shown, part in (
        (scene, "Scene small: planar"),
        (loop, "ClosedLoop: "),
        (measures, "Measures error (integral)"),
        (rollout, "Rollout of 0.1 s: 10 steps"),
        (batch, "Batch of 2 rollouts: 2 ran, 0 diverged"),
        (rollout.run(), "Trajectory: completed"),
        (simulate(scene), "Result small: completed, 1 s"),
    ):
        assert repr(shown).startswith(f"<{part}")
        assert len(repr(shown)) < 400


def test_objects_show_themselves_in_a_notebook_as_a_small_table(scene):
    loop = build_closed_loop(scene)
    signals = Signals.of(loop)
    measures = Measures(signals, {"<error>": integral(ca.sumsqr(signals["tip_error"]))})
    rollout = build_rollout(loop, duration_s=0.1, step_s=0.01, measures=measures)
    batch = rollout.batch(["target.links.body.mass"], [[20.0], [21.0]])
    costs = batch.costs["<error>"]
    for shown, parts in (
        (scene, ("Scene small", ">arm</th><td>planar base, 3 joints", "tip")),
        (loop, ("Closed loop", f">{loop.nx}: ", "tip_error")),
        (measures, ("&lt;error&gt;</th><td>integral of 1<",)),
        (rollout, ("Rollout of 0.1 s", "10 steps")),
        (
            batch,
            (
                "Batch of 2",
                ">2, 0 of them diverged",
                f"<td>{min(costs):.4g} .. ",
                f" .. {max(costs):.4g}</td>",
            ),
        ),
        (simulate(scene), ("small", "momentum drift")),
    ):
        text = shown._repr_html_().replace("<wbr>", "")
        assert all(part in text for part in parts), text
        assert len(text) < 3000


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (-1.6293, 1.2421, "-1.629 .. +1.242"),
        (0.0, 0.0, "+0.000 .. +0.000"),
        (-0.00021, 0.00123, "-0.00021 .. +0.00123"),
        (-0.0004, 0.0913, "-0.0004 .. +0.0913"),
        (-1e-9, 0.5, "+0.000 .. +0.500"),
        (-4.12e-8, 3.1e-9, "-4.12e-08 .. +3.10e-09"),
        (float("nan"), float("nan"), "+nan .. +nan"),
    ],
)
def test_a_small_axis_keeps_three_figures_beside_a_large_one(result, low, high, text):
    axes = {"x": {"min_m": 1e-3 * low, "max_m": 1e-3 * high}, "y": {"min_m": -0.004, "max_m": 0.004}}
    summary = dict(result.summary) | {"tip_error": {"arm/tip": axes | {"norm": {"rms_m": 0.003}}}}
    told = dict(headline(summary, result.data))["tip error arm/tip"]
    assert told == f"x {text}, y -4.000 .. +4.000 mm (rms 3.000 mm)"


def test_with_predictive_control_tips_have_a_distance_from_their_reference(result):
    summary = dict(result.summary) | {"mpc": {"plans": 11}}
    names = [name for name, _ in headline(summary, result.data)]
    assert "tip from its reference arm/tip" in names
    assert not any(name.startswith("tip error") for name in names)


@pytest.mark.parametrize(("metres", "text"), [(3e-4, "0.300 mm"), (3e-7, "0.300 um"), (3e-10, "0.300 nm")])
def test_small_errors_have_digits(result, metres, text):
    summary = copy.deepcopy(dict(result.summary))
    for axis in summary["tip_error"]["arm/tip"].values():
        axis |= {"min_m": -metres, "max_m": metres, "rms_m": metres}
    told = dict(type(result)(result.scenario, result.data, summary).headline())["tip error arm/tip"]
    assert f"(rms {text})" in told
    assert "-0.300 .. +0.300" in told


def test_a_wrong_variable_says_what_is_wanted(scene):
    for wrong in ((1, 2), ("robots.arm.tips.tip.pid.kp", 1), "robots.arm.tips.tip.pid.kp", (1, 2, 3)):
        with pytest.raises(
            ScenarioError, match=r"variables\.kp: found .*required: \(dotted path, lower, upper\)"
        ):
            build_problem(scene, variables={"kp": wrong})


def test_a_tip_that_nothing_leads_has_no_row_of_errors(tmp_path):
    grasp = {"kind": "point", "capture": {"distance": 0.001}}
    scene = free_bodies(tmp_path, FLAT, grasp, simulation={"duration": 0.1, "step": 0.05})
    result = simulate(scene, backend="interpreted")
    assert result.summary["unled_tips"] == ["one/tip"]
    assert not any(name.startswith("tip error") for name, _ in result.headline())
