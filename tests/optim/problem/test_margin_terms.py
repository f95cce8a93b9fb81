"""Margins in tuning: exact derivatives, those of the tuned scenario, onset of instability, bad input."""

import numpy as np
import pytest

from optim import ResultProblem, build_problem, tune
from optim.problem.margin_terms import MarginTerms
from optim.robust.problem import build_robust
from optim.tuning import TuningResult
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.linear import margins
from spacerobot.rollout import build_rollout
from spacerobot.scene import build_scene
from tests.linear.scenes import arm_scene
from tests.oracles.free_bodies import FLAT, free_bodies

HOLD = "robots.arm.controllers.hold"
ATTITUDE = "robots.one.controllers.attitude"
PERIOD = 0.05
SHORT = {"step": 0.05, "starts": 1, "iterations": 14, "budget": 16, "population": 8, "runs": 1}


@pytest.fixture(autouse=True)
def interpreted(monkeypatch):
    monkeypatch.setattr("spacerobot.rollout.build.find_toolchain", lambda: None)


ONE = {"kp": {"paths": f"{HOLD}.kp", "lower": 2, "upper": 400, "scale": "log"}}


def held(*required, **tuning):
    """An arm that is stopped by a sampled PD; the fastest gains leave little room for delays."""
    tips = {"tips": {"tip": {}}}
    scene = arm_scene(
        1, "planar", rate_deg=2, robot=tips, kp=12.0, kd=1.5, sampled={"period": PERIOD, "delay": 0.02}
    )
    section = {
        "variables": {
            **ONE,
            "kd": {"paths": f"{HOLD}.kd", "lower": 1, "upper": 60, "scale": "log"},
        },
        "margins": list(required),
        **SHORT,
        **tuning,
    }
    changes = {"tuning": section, "simulation.step": PERIOD, "simulation.duration": 0.5}
    return build_scene(scene.scenario, changes, source=scene.source)


def captured(folder, *required):
    """A chaser with attitude control that captures a target."""
    wheels = {"kind": "reaction_wheels", "axes": [[0, 0, 1]], "inertia": 0.05, "speeds": [100]}
    attitude = {"kind": "base_attitude", "kp": 3.0, "kd": 8.0, "feed_forward": 0}
    variables = {
        "kp": {"paths": f"{ATTITUDE}.kp", "lower": 1, "upper": 9, "scale": "log"},
        "mass": {"paths": "target.links.body.mass", "lower": 5, "upper": 12},
    }
    changes = {
        "robots.one.controllers": {"attitude": attitude},
        "robots.one.actuators": {"wheels": wheels},
        "simulation.duration": 1.0,
        "tuning": {
            "variables": variables,
            "objective": {"weight": 0, "capture_time": 1.0},
            "margins": list(required),
        },
    }
    scene = free_bodies(folder, FLAT, {"kind": "compliant", "capture": {"distance": 0.05}})
    return build_scene(scene.scenario, changes, source=scene.source)


def extrapolated(problem, u, step=4e-3):
    """Derivatives of constraints (m, k) and objective (k,) by central differences, of fourth order."""

    def central(width):
        points = np.concatenate([u + width * np.eye(len(u)), u - width * np.eye(len(u))])
        found = problem.evaluate(points)
        values = np.column_stack([found.constraints, found.objective])
        return (values[: len(u)] - values[len(u) :]).T / (2 * width)

    found = (4 * central(step / 2) - central(step)) / 3
    return found[:-1], found[-1]


def check_gradients(problem, u):
    at, (constraints, objective) = problem.linearise(u), extrapolated(problem, u)
    value = problem.evaluate(u[None])
    np.testing.assert_allclose(at.objective, value.objective[0], rtol=1e-12)
    np.testing.assert_allclose(at.constraints, value.constraints[0], rtol=1e-12)
    scale = np.abs(constraints).max(axis=1, keepdims=True)
    assert (scale > 1e-3).all()
    assert (np.abs(at.constraint_jacobian - constraints) < 2e-6 * scale).all()
    np.testing.assert_allclose(at.gradient, objective, rtol=2e-6, atol=1e-12)


def test_gradients_where_the_state_follows_the_variables(tmp_path):
    """At the start, at a time, and on both sides of an event whose time moves; above and below the limit."""
    required = [
        {"loops": "torque/one/root*", "kind": kind, "at": at, "least": least}
        for at in (0, 0.8, "captured")
        for kind, least in (("disk", 0.5), ("delay", 5.0))
    ]
    problem = build_problem(captured(tmp_path, *required))
    assert len(problem.constraint_names) == 8
    u = np.array([0.45, 0.4])
    check_gradients(problem, u)
    values, following = problem.variables.values(u), problem.terms.margins._following
    events = following(values, slopes=True).motion[2:]
    late, early = (following(values + side * np.eye(2)[0], slopes=False).instants for side in (1e-4, -1e-4))
    for motion, one, other in zip(events, late[2:], early[2:], strict=True):
        np.testing.assert_allclose(motion[-1, 0], (one.time_s - other.time_s) / 2e-4, rtol=1e-6)


def test_gradient_of_a_weighed_margin():
    """Of a sum of squares; a margin that is both required and weighed."""
    problem = build_problem(held({"kind": "disk", "weight": 1e-3, "least": 0.3}))
    assert problem.form == "squares"
    check_gradients(problem, np.array([0.3, 0.4]))


def own(scene, at=(0.0,)):
    """Margins of the torque loop of a scene."""
    found = margins(scene, at, backend="interpreted")
    return [next(one for one in loops if one.name.startswith("torque/")) for loops in found.loops]


@pytest.mark.parametrize("method", ["nlp", "ga"])
def test_gains_tuned_to_a_delay_margin(method, tmp_path):
    """Without the requirement they have too little; what is printed is the tuned scenario's own margin."""
    least = PERIOD  # the delay margin of a sampled loop is exact for whole periods
    free = tune(held(variables=ONE), method)
    limited = held({"kind": "delay", "least": least}, variables=ONE)
    (before,) = build_problem(limited).terms.margins.values(np.array([free.gains["kp"]]))
    assert before.value < 0.9 * least
    found = tune(limited, method)
    (one,) = own(found.scene)
    assert one.delay > least * (1 - 1e-6)
    assert found.outcome.best.feasible
    assert found.objective > free.objective
    name = "delay margin of torque/arm/joint_1 at 0 s"
    assert found.margins == {name: f"{one.delay:.6g} s, at least {least:g}"}
    found.save(tmp_path / "tuned")
    assert TuningResult.load(tmp_path / "tuned").margins == found.margins
    if method == "nlp":
        np.testing.assert_allclose(one.delay, least, rtol=1e-4)  # the requirement is active
        check_onset(found.scene, one.delay)


def check_onset(scene, delay):
    """With one percent less delay than the margin allows a motion decays, with one percent more it grows."""
    for factor, grows in ((0.99, False), (1.01, True)):
        changes = {f"{HOLD}.sampled.delay": 0.02 + factor * delay, "simulation.duration": 30.0}
        loop = build_closed_loop(build_scene(scene.scenario, changes, source=scene.source))
        options = {"duration_s": 30.0, "step_s": PERIOD, "output_step_s": PERIOD}
        rate = np.abs(build_rollout(loop, **options).run().state[:, loop.state_names.index("v.arm/joint_1")])
        third = len(rate) // 3
        assert (rate[-third:].max() > rate[third : 2 * third].max()) == grows, factor


def test_margins_are_those_of_the_tuned_scenario():
    at = (0, 0.3)
    scene = held(*({"kind": kind, "at": time, "least": 1} for time in at for kind in ("disk", "phase")))
    problem = build_problem(scene)
    values = np.array([9.0, 2.0])
    terms = problem.terms.margins
    assert isinstance(terms, MarginTerms)
    changed = build_scene(scene.scenario, problem.variables.as_changes(values), source=scene.source)
    expected = [getattr(one, kind) for one in own(changed, at) for kind in ("disk", "phase")]
    np.testing.assert_allclose([one.value for one in terms.values(values)], expected, rtol=1e-9)


def test_fingerprints_differ_where_margins_do():
    sections = ([], [{"least": 0.3}], [{"least": 0.4}], [{"weight": 0.3}], [{"least": 0.3, "at": 0.4}])
    prints = {build_problem(held(*one)).fingerprint for one in sections}
    assert len(prints) == len(sections)


@pytest.mark.parametrize(
    ("required", "told"),
    [
        ({}, "tuning.margins.0: found neither `least` nor `weight`"),
        ({"least": -1}, "tuning.margins.0.least: found -1, allowed: above 0"),
        ({"least": 1, "kind": "disc"}, "tuning.margins.0.kind: .*'disk'"),
        ({"least": 1, "loops": "wheel/*"}, r"tuning.margins.0.loops: no break point 'wheel/\*'"),
        ({"least": 1, "at": 7}, "tuning.margins.*at: found 7 s, allowed: from 0 to 0.5 s"),
        ({"least": 1, "at": "captured"}, "tuning.margins.*at: no event 'captured'"),
        ({"weight": 1, "loops": "*"}, "tuning.margins.0.weight: found 3 margins"),
    ],
)
def test_bad_input(required, told):
    with pytest.raises(ScenarioError, match=told) as fault:
        build_problem(held(required))
    assert "\n" not in str(fault.value)


def test_where_margins_are_not_known():
    scene = held({"least": 0.3})
    with pytest.raises(ScenarioError, match="robust tuning knows no margins"):
        build_robust(scene)
    assert ResultProblem(build_problem(scene), len).constraint_names == build_problem(scene).constraint_names
