"""What is no number, is lost, is empty or is asked for twice; every backend says the same."""

from __future__ import annotations

import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.closedloop.closed_loop import OutputVariable
from spacerobot.common.errors import SpaceRobotError
from spacerobot.rollout import Measures, Signals, build_rollout, final, integral, peak
from tests.oracles.small_scenes import PLANAR, small_scene
from tests.rollout.hybrid_loops import Hybrid, Rule

GRID = {"duration_s": 2.0, "step_s": 0.02, "output_step_s": 0.2}
LOST = {"arm.kp": -1e9, "arm.kd": -1e9}


@pytest.fixture(scope="module", params=["compiled", "interpreted"])
def rollout(request, loop):
    s = Signals.of(loop)
    named = {
        "root": peak(ca.vertcat(ca.sqrt(s.t - 0.5), ca.sqrt(1.5 - s.t), s.t)),  # no number early, late, never
        "falling": peak(-1 - s.t),
        "ise": integral(ca.sumsqr(s["error"])),
    }
    measures = Measures(
        s,
        named,
        lambda r, p: {
            "floor": ca.fmax(r["ise"], 0),
            "gain": p["arm.kp"],
            "three": ca.SX(3),
            "root": r["root"][1],
        },
    )
    return build_rollout(loop, **GRID, measures=measures, backend=request.param)


def test_a_peak_that_was_no_number_once_is_none(rollout):
    for measures in (rollout.run().measures, rollout.batch(("arm.kp",), [[4.0]]).measures):
        root = np.ravel(measures["root"])
        assert np.isnan(root[:2]).all()
        assert root[2] == pytest.approx(2.0)
        assert np.ravel(measures["falling"])[0] == pytest.approx(-1.0)
    assert np.isnan(rollout.value_and_gradient(wrt=("arm.kp",), costs=("root",)).costs["root"])


def test_costs_of_a_lost_rollout_are_no_numbers_whatever_they_are_made_of(rollout):
    assert rollout.run().costs["gain"] == 4.0
    lost = rollout.run(LOST)
    assert lost.status == "diverged"
    batch = rollout.batch(tuple(LOST), [list(LOST.values())])
    gradient = rollout.value_and_gradient(LOST, wrt=("arm.kp",))
    for costs in (lost.costs, batch.costs, gradient.costs, gradient.gradients):
        assert all(np.isnan(value).all() for value in costs.values())


def test_a_parameter_named_twice_is_told(rollout):
    twice = ("arm.kp", "arm.kd", "arm.kp")
    for ask in (
        lambda: rollout.batch(twice, np.ones((2, 3))),
        lambda: rollout.value_and_gradient(wrt=twice),
        lambda: rollout.jacobian(wrt=twice),
    ):
        with pytest.raises(SpaceRobotError, match=r"'arm\.kp' is named 2 times, allowed: once"):
            ask()


def test_no_rows(rollout):
    none = np.empty((0, 1))
    batch = rollout.batch(("arm.kp",), none, outputs=("error",), states=True)
    assert (batch.outputs["error"].shape, batch.state.shape) == ((0, 11, 2), (0, 11, 11))
    assert rollout.gradient_batch(("arm.kp",), none).gradients["floor"].shape == (0, 1)


def test_lost_gradients_in_lanes_leave_their_neighbours(rollout):
    rows = np.array([[4.0, 0.6]] * 3 + [list(LOST.values())] * 9 + [[4.0, 0.6]])
    found = rollout.gradient_batch(tuple(LOST), rows, costs=("floor",)).gradients["floor"]
    assert np.isnan(found[3:12]).all()
    np.testing.assert_array_equal(found[12], found[0])
    np.testing.assert_allclose(
        found[0], rollout.value_and_gradient(wrt=tuple(LOST), costs=("floor",)).gradients["floor"], rtol=1e-10
    )


def test_a_scene_without_target_and_grasps(monkeypatch):
    monkeypatch.setenv("SPACEROBOT_COMPILER_FLAGS", "-O0")
    scene = small_scene(PLANAR, {"target": None, "grasps": {}, "robots.two.base": {"joint": "planar"}})
    loop = build_closed_loop(scene)
    s = Signals.of(loop)
    measures = Measures(s, {"force": final(s["grasp_force"]), "most": peak(ca.fabs(s["grasp_force"]))})
    for backend in ("compiled", "interpreted"):
        rollout = build_rollout(loop, duration_s=0.02, step_s=0.01, measures=measures, backend=backend)
        one = rollout.run()
        assert (one.status, one.outputs["grasp_force"].shape, one.costs) == ("completed", (3, 0), {})
        batch = rollout.batch(loop.parameter_paths[:1], np.ones((3, 1)), outputs=("grasp_force",))
        assert batch.outputs["grasp_force"].shape == (3, 3, 0)
        assert batch.measures["most"].shape == (3, 0)
        slopes = rollout.jacobian(wrt=loop.parameter_paths[:2], outputs=("grasp_force",))
        assert slopes.outputs["grasp_force"].shape == (3, 0, 2)


@pytest.mark.parametrize(("step_s", "output_step_s", "steps", "samples"), [(5, None, 9, 2), (0.3, 9, 12, 2)])
def test_steps_longer_than_the_duration(rollout, step_s, output_step_s, steps, samples):
    other = build_rollout(
        rollout.loop, duration_s=2.0, step_s=step_s, output_step_s=output_step_s, backend=rollout.backend
    )
    found = other.run()  # eight to the jump at 1 s
    assert (found.steps, len(found.time), found.time[-1]) == (steps, samples, 2.0)


def test_rows_are_made_piece_by_piece(rollout, monkeypatch):
    sizes, fill = [], type(rollout)._filled
    monkeypatch.setattr(
        type(rollout),
        "_filled",
        lambda self, places, given: sizes.append(len(given)) or fill(self, places, given),
    )
    short = replace(rollout, grid=replace(rollout.grid, intervals=1, every=1))
    monkeypatch.setattr("spacerobot.rollout.batch.TASK_STEPS", 2)
    short.batch(("arm.kp",), np.linspace(1, 2, 100)[:, None])
    assert sum(sizes) == 100
    assert max(sizes) <= 16


@pytest.mark.parametrize("wrt", [("rate", "start"), ("rate",), ("start",)])
def test_derivatives_of_a_single_state_with_a_single_constant(wrt):
    laws = {
        "rates": lambda t, x, c: [-c[0] * x[0]],
        "guards": lambda t, x, c: [(1, 0.5 - x[0])],
        "updates": lambda t, x, c: [[x[0] + 1]],
    }
    start = {"rate": 1.3, "start": 1.0}
    made = Hybrid(start, lambda rate, start: ([start], [rate]), rules=[Rule("up")], **laws).loop()
    for events in (made.events, ()):
        made.events = events
        signals = Signals.of(made)
        measures = Measures(signals, {"end": final(signals.x)}, lambda r, p: {"end": r["end"]})
        rollout = build_rollout(
            made, duration_s=1.0, step_s=0.1, output_step_s=0.5, measures=measures, backend="interpreted"
        )
        adjoint, forward = rollout.value_and_gradient(wrt=wrt), rollout.jacobian(wrt=wrt)
        np.testing.assert_allclose(forward.measures["end"][0], adjoint.gradients["end"], rtol=1e-12)
        assert len(forward.trajectory.events) == len(events)
    closed = np.array([{"rate": -1.0, "start": 1.0}[name] for name in wrt]) * np.exp(-1.3)
    np.testing.assert_allclose(adjoint.gradients["end"], closed, rtol=1e-3)


def test_a_lost_rollout_names_what_was_lost(rollout, loop):
    assert rollout.run(LOST).cause.endswith("grows fastest")
    s = Signals.of(loop)
    broken = Measures(s, {"sink": integral(ca.sqrt(0.5 - s.t))})
    lost = build_rollout(loop, **GRID, measures=broken, backend=rollout.backend).run()
    assert lost.status == "diverged"
    assert lost.cause == "the integral 'sink': its rate is not a number"


class Half:
    """A closed loop one of whose outputs exists for the first of two labels only."""

    variables = (OutputVariable("load", ("tip", "axis"), "N", "load of tips", ("a", "b")),)

    def __init__(self, loop):
        self._loop = loop
        inputs = [ca.SX.sym(loop.outputs.name_in(k), loop.outputs.size_in(k)) for k in range(3)]
        load = ca.vertcat(inputs[1][:3], ca.SX.nan(3, 1))
        self.outputs = ca.Function("outputs", inputs, [load], loop.outputs.name_in(), ["load"])

    def __getattr__(self, name):
        return getattr(self._loop, name)


@pytest.mark.parametrize(
    ("named", "costs", "what"),
    [
        (lambda load: {"m": integral(ca.sumsqr(load))}, None, "the integral 'm'"),
        (lambda load: {"m": peak(ca.sumsqr(load))}, None, "the cost 'm'"),
        (lambda load: {"m": final(load)}, lambda r, p: {"J": ca.sum1(r["m"])}, "the cost 'J'"),
    ],
)
def test_a_measure_of_what_exists_for_other_labels_only_is_refused(loop, named, costs, what):
    half = Half(loop)
    s = Signals.of(half)
    words = f"{what} depends on 'load' where that does not exist; take the entries of a (0:3)"
    with pytest.raises(SpaceRobotError, match=re.escape(words)):
        build_rollout(half, **GRID, measures=Measures(s, named(s["load"]), costs), backend="interpreted")


def test_entries_that_exist_are_measured_and_peaks_of_all_are_no_numbers_where_there_are_none(loop):
    half = Half(loop)
    s = Signals.of(half)
    named = {"m": integral(ca.sumsqr(s["load"][:3])), "all": peak(s["load"])}
    found = build_rollout(half, **GRID, measures=Measures(s, named), backend="interpreted").run()
    assert found.status == "completed"
    assert np.isfinite(found.costs["m"])
    assert np.isfinite(found.measures["all"]).tolist() == [True] * 3 + [False] * 3
