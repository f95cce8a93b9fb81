"""Dockings rolled out by the compiled loops against SciPy's integrator and root finding."""

import casadi as ca
import numpy as np
import pytest

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import Measures, Signals, build_rollout, final
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles.free_bodies import DEEP, FLAT, free_bodies
from tests.oracles.hybrid import roll

PHASES = {
    "approach": {"until": {"captured": ["left"]}, "timeout": 2.5, "on_timeout": "end"},
    "carry": {"until": {"time": 0.6}, "timeout": 1.0},
    "part": {"releases": ["left"], "captures": [], "timeout": 0.5},
}
CAPTURE = {"distance": 0.05, "dwell": 0.05, "draw_in": 0.4, "draw_in_deg": 120}


@pytest.mark.parametrize("bases", [FLAT, DEEP], ids=["planar", "spatial"])
@pytest.mark.parametrize("kind", ["compliant", "point", "weld"])
def test_a_docking_goes_as_an_independent_integrator_has_it(tmp_path, bases, kind):
    capture = CAPTURE if kind != "point" else {"distance": 0.05, "dwell": 0.05}
    scene = free_bodies(tmp_path, bases, {"kind": kind, "capture": capture}, phases=PHASES)
    loop = build_closed_loop(scene)
    expected = roll(loop, 3.0)
    found = build_rollout(loop, duration_s=3.0, step_s=0.01, backend="interpreted").run()
    names = [loop.events[fired.event].name for fired in found.events]
    assert names == expected.names
    assert "part.timeout" in names
    for one, other in zip(found.events, expected.events, strict=True):
        assert one.time_s == pytest.approx(other.time, abs=1e-8)
        np.testing.assert_allclose(one.after, other.after, atol=1e-7)
    assert found.ended_at_s == pytest.approx(expected.t, abs=1e-8)


@pytest.mark.parametrize("bases", [FLAT, DEEP], ids=["planar", "spatial"])
def test_momentum_and_the_ledger_hold_through_a_docking(tmp_path, bases):
    scene = free_bodies(tmp_path, bases, {"kind": "weld", "capture": CAPTURE}, phases=PHASES)
    result = simulate(scene, backend="interpreted")
    summary, data = result.summary, result.data
    assert summary["outcome"] == "captured"
    kinds = [event["kind"] for event in summary["events"]]
    assert kinds == ["entered", "captured", "phase", "drawn", "phase", "released", "end"]
    assert all(event["momentum_change"] < 1e-12 for event in summary["events"])
    assert summary["ledger"]["energy"]["relative_residual"] < 1e-6
    assert summary["status"]["reached_s"] == pytest.approx(summary["events"][-1]["time_s"])
    np.testing.assert_array_equal(np.unique(data.phase), [0, 1, 2])
    np.testing.assert_array_equal(np.unique(data.grasp_state.sel(grasp="left")), [0, 1, 2, 3])
    assert "0 approach, 1 carry, 2 part" in data.phase.attrs["long_name"]


def test_the_shipped_docking_catches_carries_and_lets_go(monkeypatch):
    monkeypatch.setenv("SPACEROBOT_COMPILER_FLAGS", "-O0")
    summary = simulate(load_scene("docking", {"simulation.step": 0.01})).summary
    assert summary["outcome"] == "captured"
    told = [(event["kind"], event["who"]) for event in summary["events"]]
    assert {("captured", "left"), ("captured", "right")} == {one for one in told if one[0] == "captured"}
    assert [who for kind, who in told if kind == "phase"] == ["stop", "carry", "rest", "part"]
    assert {who for kind, who in told if kind == "released"} == {"left", "right"}
    assert told[-1] == ("end", "part")
    assert all(event["momentum_change"] < 1e-12 for event in summary["events"])
    assert summary["ledger"]["energy"]["relative_residual"] < 1e-6
    assert summary["status"]["trusted"]


def test_no_events_of_the_shipped_docking_coincide(monkeypatch):
    """Otherwise a derivative would hold for one order of two events alone."""
    monkeypatch.setenv("SPACEROBOT_COMPILER_FLAGS", "-O0")
    scene = load_scene("docking", {"simulation.step": 0.01})
    found = sr.gradient(scene, "tip_error_rms", ["target.links.body.mass"])
    assert not found.status.startswith("coincident")


def test_the_shipped_capture_grips_a_tumbling_satellite_arm_by_arm():
    result = simulate(load_scene("capture", {"simulation.step": 0.04}), backend="interpreted")
    summary = result.summary
    assert summary["outcome"] == "captured"
    captures = [event for event in summary["events"] if event["kind"] == "captured"]
    assert [event["who"] for event in captures] == ["left", "right"]
    assert set(captures[1]["impulses_n_s"]) == {"left", "right"}  # the shock goes through the whole chain
    assert all(event["momentum_change"] < 1e-12 for event in summary["events"])
    assert summary["ledger"]["energy"]["relative_residual"] < 1e-6
    still = result.data.isel(time=-1)
    assert np.abs(still.grasp_capture_velocity).max() < 0.011
    assert summary["status"]["trusted"]


@pytest.mark.parametrize("kind", ["compliant", "weld"])
def test_gradients_go_through_captures_phases_and_releases(tmp_path, kind):
    """Capture time, impulse or energy, and where the object ends, against central differences."""
    phases = {
        "approach": {"until": {"captured": ["left"]}, "timeout": 2.5, "on_timeout": "end"},
        "carry": {"until": {"time": 0.3}},
        "part": {"releases": ["left"], "captures": []},
    }
    capture = {"distance": 0.05, "dwell": 0.05, "draw_in": 0.1}
    chaser = {"urdf": "chaser.urdf", "base": DEEP["base"], "tips": {"tip": {}}}
    chaser["controllers"] = {"stay": {"kind": "base_position", "kp": 0.8, "kd": 0.5}}
    chaser["actuators"] = {"ideal": {"kind": "base_wrench"}}
    grasp = {"kind": kind, "capture": capture}
    loop = build_closed_loop(free_bodies(tmp_path, DEEP, grasp, phases=phases, robots={"one": chaser}))
    signals = Signals.of(loop)
    named = {
        "when": final(signals["grasp_captured_at"]),
        "spin": final(signals["grasp_capture_spin"]),
        "place": final(signals["body_position"]),
        "lost": final(signals["work_event"]),
    }
    costs = {"all": lambda r: 3 * r["when"] + ca.sumsqr(r["place"]) + 50 * r["lost"] + ca.sum1(r["spin"])}
    measures = Measures(signals, named, lambda r, _: {name: cost(r) for name, cost in costs.items()})
    rollout = build_rollout(loop, duration_s=2.5, step_s=0.025, measures=measures, backend="interpreted")
    wrt = [
        *("grasps.left.capture.distance", "grasps.left.capture.dwell", "grasps.left.capture.draw_in"),
        *("robots.one.base.velocity.0", "target.base.spin_deg.2", "target.links.body.mass"),
        *("phases.carry.until.time", "robots.one.controllers.stay.kp", "robots.one.controllers.stay.kd"),
    ]
    adjoint = rollout.value_and_gradient(wrt=wrt)
    forward = rollout.jacobian(wrt=wrt)
    assert (*adjoint.status, forward.status) == ("exact", "exact")
    slopes, place = forward.measures, adjoint.measures["place"]
    chained = 3 * slopes["when"][0] + 2 * place @ slopes["place"] + 50 * slopes["lost"][0]
    chained += slopes["spin"].sum(0)
    np.testing.assert_allclose(adjoint.gradients["all"], chained, rtol=1e-9, atol=1e-12)
    for i, path in enumerate(wrt):
        value = loop.parameter_values[loop.index(path)]
        step = 1e-5 * max(abs(value), 0.01)
        ahead, behind = (rollout.run({path: value + sign * step}) for sign in (1, -1))
        for name in named:
            slope = (ahead.measures[name] - behind.measures[name]) / (2 * step)
            np.testing.assert_allclose(forward.measures[name][:, i], slope, rtol=1e-6, atol=1e-7)
        slope = (ahead.costs["all"] - behind.costs["all"]) / (2 * step)
        assert adjoint.gradients["all"][i] == pytest.approx(slope, rel=1e-6, abs=1e-7)
