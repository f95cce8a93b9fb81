"""Adjoint and forward derivatives: against central differences, against each other, in every engine."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from spacerobot.common.errors import SpaceRobotError
from spacerobot.rollout import Measures, Signals, build_rollout, final, integral, peak

WRT = ("arm.kp", "arm.kd", "arm.inertia", "arm.start", "rotor.spin", "rotor.offset", "reference.turn")
GRID = {"duration_s": 3.0, "step_s": 0.02, "output_step_s": 0.1}
POINT = {"arm.kp": 5.0, "arm.start": -0.3, "rotor.spin": 1.2, "reference.turn": 1.5213}


@pytest.fixture(scope="module")
def measures(loop):
    signals = Signals.of(loop)
    error, torque, gain = signals["error"], signals["torque"], signals.parameters["arm.kp"]
    named = {
        "ise": integral(ca.sumsqr(error) + 1e-3 * gain * torque**2),
        "itae": integral(signals.t * ca.sqrt(error[0] ** 2 + 1e-4)),
        "worst": peak(ca.vertcat(error[0], -error[1], torque)),
        "end": final(ca.vertcat(signals["omega"], signals.x[0])),
    }

    def costs(r, p):
        mixed = r["ise"] + 0.1 * r["itae"] * p["arm.kd"] + ca.sumsqr(r["end"]) + p["arm.start"] ** 2
        return {"mixed": mixed, "torque": r["worst"][2] + 0.2 * r["worst"][0], "last": r["end"][3]}

    return Measures(signals, named, costs)


@pytest.fixture(scope="module")
def compiled(loop, measures):
    return build_rollout(loop, **GRID, measures=measures)


@pytest.fixture(scope="module")
def interpreted(loop, measures):
    return build_rollout(loop, **GRID, measures=measures, backend="interpreted")


@pytest.fixture(scope="module")
def differences(compiled):
    """Central differences of every cost and measure, extrapolated once to the fourth order."""
    base = compiled.values(POINT)
    columns = compiled.indices(WRT)
    scale = np.maximum(np.abs(base[columns]), 0.1)

    def slopes(relative):
        rows = np.repeat(base[None, :], 2 * len(WRT), axis=0)
        for i, column in enumerate(columns):
            rows[2 * i, column] += relative * scale[i]
            rows[2 * i + 1, column] -= relative * scale[i]
        batch = compiled.batch(compiled.loop.parameter_paths, rows)
        both = {**{f"cost {k}": v[:, None] for k, v in batch.costs.items()}, **batch.measures}
        return {k: ((v[0::2] - v[1::2]) / (2 * relative * scale[:, None])).T for k, v in both.items()}

    coarse, fine = slopes(2e-4), slopes(1e-4)
    return {name: (4 * fine[name] - coarse[name]) / 3 for name in fine}


def test_adjoint_equals_central_differences(compiled, differences):
    found = compiled.value_and_gradient(POINT, wrt=WRT)
    assert found.backend == "compiled"
    for name, gradient in found.gradients.items():
        np.testing.assert_allclose(gradient, differences[f"cost {name}"][0], rtol=1e-6, atol=1e-8)


def test_many_forward_slopes_are_those_of_each_row(compiled):
    kp, kd = [5.0, 2.0, 9.0], [1.5, 2.5, 0.7]
    found = compiled.slope_batch(("arm.kp", "arm.kd"), np.column_stack([kp, kd]), wrt=WRT)
    assert compiled.slope_batch(("arm.kp",), [[5.0]]).paths == ("arm.kp",)
    for i in range(3):
        alone = compiled.jacobian({"arm.kp": kp[i], "arm.kd": kd[i]}, wrt=WRT)
        for name in alone.measures:
            assert np.array_equal(found.slopes[name][i], alone.measures[name])
            np.testing.assert_allclose(found.measures[name][i], alone.trajectory.measures[name], rtol=1e-12)


def test_forward_equals_central_differences(compiled, differences):
    found = compiled.jacobian(POINT, wrt=WRT)
    for name, jacobian in found.measures.items():
        np.testing.assert_allclose(jacobian, differences[name], rtol=1e-6, atol=1e-8)


def test_forward_equals_adjoint_to_rounding(compiled, measures):
    forward = compiled.jacobian(POINT, wrt=WRT)
    adjoint = compiled.value_and_gradient(POINT, wrt=WRT)
    np.testing.assert_allclose(forward.measures["end"][3], adjoint.gradients["last"], rtol=1e-11, atol=1e-13)
    worst = forward.measures["worst"][2] + 0.2 * forward.measures["worst"][0]
    np.testing.assert_allclose(worst, adjoint.gradients["torque"], rtol=1e-11, atol=1e-13)


def test_sampled_outputs_have_their_derivatives(compiled):
    step = 1e-5
    found = compiled.jacobian(POINT, wrt=("arm.kd",), outputs=("omega", "error"))
    kd = compiled.values(POINT)[1]
    high, low = (compiled.run({**POINT, "arm.kd": kd + s}) for s in (step, -step))
    for name, slope in found.outputs.items():
        difference = (high.outputs[name] - low.outputs[name]) / (2 * step)
        np.testing.assert_allclose(slope[:, :, 0], difference, rtol=1e-5, atol=1e-7)


def test_a_peak_at_the_end_is_the_final_value(loop):
    signals = Signals.of(loop)
    rising = ca.vertcat(signals.t + 0.1 * signals["error"][0], -signals.t + signals["torque"])
    named = {"late": peak(rising), "end": final(rising)}
    measures = Measures(
        signals, named, lambda r, p: {"late": r["late"][0], "end": r["end"][0], "early": r["late"][1]}
    )
    for backend in ("compiled", "interpreted"):
        rollout = build_rollout(loop, **GRID, measures=measures, backend=backend)
        found = rollout.value_and_gradient(wrt=WRT)
        assert found.costs["late"] == pytest.approx(found.costs["end"], rel=1e-14)
        assert found.costs["late"] > 2.9
        np.testing.assert_allclose(found.gradients["late"], found.gradients["end"], rtol=1e-12)
        forward = rollout.jacobian(wrt=WRT)
        np.testing.assert_allclose(
            forward.measures["late"][0], found.gradients["late"], rtol=1e-10, atol=1e-13
        )
        np.testing.assert_allclose(
            forward.measures["late"][1], found.gradients["early"], rtol=1e-10, atol=1e-13
        )
        assert np.abs(found.gradients["early"][:2]).max() > 0


def test_interpreted_gives_the_same_derivatives(compiled, interpreted):
    pair, costs = (compiled, interpreted), ("torque", "mixed")
    fast, slow = (rollout.value_and_gradient(POINT, wrt=WRT, costs=costs) for rollout in pair)
    assert slow.backend == "interpreted"
    assert tuple(slow.gradients) == ("torque", "mixed")
    for name in slow.gradients:
        np.testing.assert_allclose(fast.costs[name], slow.costs[name], rtol=1e-12)
        np.testing.assert_allclose(fast.gradients[name], slow.gradients[name], rtol=1e-9, atol=1e-11)
    fast, slow = (rollout.jacobian(POINT, wrt=WRT[:2]) for rollout in pair)
    for name in slow.measures:
        np.testing.assert_allclose(fast.measures[name], slow.measures[name], rtol=1e-9, atol=1e-11)


def test_gradients_in_lanes_equal_the_single_one_and_a_lost_lane_harms_nobody(compiled):
    rows = np.random.default_rng(3).uniform(0.5, 4.0, (11, 2))
    rows[4] = -1e9
    many = compiled.gradient_batch(("arm.kp", "arm.kd"), rows, wrt=WRT)
    for i in (0, 3, 5, 10):
        single = compiled.value_and_gradient({"arm.kp": rows[i, 0], "arm.kd": rows[i, 1]}, wrt=WRT)
        for name, gradient in single.gradients.items():
            np.testing.assert_allclose(many.gradients[name][i], gradient, rtol=1e-10, atol=1e-12)
            np.testing.assert_allclose(many.costs[name][i], single.costs[name], rtol=1e-12)
    assert np.isnan(many.gradients["mixed"][4]).all()
    assert np.isnan(many.costs["mixed"][4])
    assert np.isfinite(many.diverged_at_s[4])
    assert np.isnan(many.diverged_at_s[[0, 3, 5, 10]]).all()


def test_checkpoints_change_nothing_but_memory(compiled):
    indices = tuple(compiled.indices(WRT))
    engine = compiled.engines.adjoint(indices, many=False)
    whole = compiled.value_and_gradient(POINT, wrt=WRT)
    per_step = engine.bytes_per_step
    for steps in (1, 7, 149):  # of 150
        short = replace(engine, whole_bytes=0, segment_bytes=steps * per_step)
        compiled.engines._made["adjoint", indices, 1] = short
        again = compiled.value_and_gradient(POINT, wrt=WRT)
        for name, gradient in whole.gradients.items():
            np.testing.assert_array_equal(again.gradients[name], gradient)
    compiled.engines._made["adjoint", indices, 1] = engine


def test_checkpoints_change_nothing_in_lanes_either(compiled):
    indices = tuple(compiled.indices(WRT))
    engine = compiled.engines.adjoint(indices, many=True)
    rows = np.linspace(0.5, 4.0, 5)[:, None]
    whole = compiled.gradient_batch(("arm.kp",), rows, wrt=WRT)
    short = replace(engine, whole_bytes=0, segment_bytes=7 * engine.bytes_per_step)
    compiled.engines._made["adjoint", indices, engine.lanes] = short
    again = compiled.gradient_batch(("arm.kp",), rows, wrt=WRT)
    compiled.engines._made["adjoint", indices, engine.lanes] = engine
    for name, gradient in whole.gradients.items():
        np.testing.assert_array_equal(again.gradients[name], gradient)


def test_wrong_names_are_told(loop, compiled):
    with pytest.raises(SpaceRobotError, match="no cost 'mixd', did you mean mixed"):
        compiled.value_and_gradient(POINT, wrt=WRT, costs=("mixd",))
    with pytest.raises(SpaceRobotError, match="no parameter"):
        compiled.value_and_gradient(POINT, wrt=("arm.k",))
    with pytest.raises(SpaceRobotError, match="without a cost"):
        build_rollout(loop, **GRID).value_and_gradient(POINT, wrt=WRT)
