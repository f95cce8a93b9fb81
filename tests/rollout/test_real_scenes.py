"""Rollouts and derivatives of real closed loops, planar and spatial: engines, lanes and gradients agree."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.compiled import pieces
from spacerobot.rollout import Measures, Signals, build_rollout, final, integral, peak
from spacerobot.scene import load_scene
from tests.oracles.small_scenes import ONE_SPATIAL_ARM, PLANAR, small_scene

GRID = {"duration_s": 0.4, "step_s": 0.004, "output_step_s": 0.1}


def choose(paths):
    """Parameters of every sort: a gain, a stiffness, a mass, the start, a velocity."""
    wanted = ("pid.kp", "amnesia.ge", "grasps.left.stiffness", "mass", "base.velocity", "angle", "damping")
    found = [next((path for path in paths if want in path), None) for want in wanted]
    return tuple(dict.fromkeys(path for path in found if path))


@pytest.fixture(scope="module", autouse=True)
def _compile_in_a_hurry():
    """Spatial loops have thousands of operations; how fast they run is not asked here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPACEROBOT_COMPILER_FLAGS", "-O0")
        patch.setattr(pieces, "LONGEST", 500)
        patch.setattr(pieces, "PIECE", 500)
        yield


@pytest.fixture(scope="module", params=[PLANAR, ONE_SPATIAL_ARM], ids=["planar", "spatial"])
def scene(request):
    loop = build_closed_loop(small_scene(request.param))
    s = Signals.of(loop)
    measures = Measures(
        s,
        {
            "ise": integral(ca.sumsqr(s["tip_error"])),
            "torque": peak(ca.fabs(s["joint_torque"])),
            "spin": final(ca.sumsqr(s["momentum_angular"])),
        },
        lambda r, p: {"all": 1e3 * r["ise"] + 1e-2 * ca.sumsqr(r["torque"]) + r["spin"]},
    )
    return loop, measures, build_rollout(loop, **GRID, measures=measures)


def test_engines_and_lanes_agree(scene):
    loop, measures, compiled = scene
    one = compiled.run()
    assert one.status == "completed"
    slow = build_rollout(loop, **GRID, measures=measures, backend="interpreted").run()
    many = compiled.batch(loop.parameter_paths, np.tile(loop.parameter_values, (3, 1)), states=True)
    scale = np.maximum(1.0, np.abs(one.state).max(axis=0))
    assert (np.abs(one.state - slow.state) / scale).max() < 1e-12
    assert (np.abs(one.state - many.state[1]) / scale).max() < 1e-12
    assert one.costs["all"] == pytest.approx(slow.costs["all"], rel=1e-11)
    assert one.costs["all"] == pytest.approx(many.costs["all"][2], rel=1e-11)


def test_adjoint_forward_and_differences_agree(scene):
    loop, _, rollout = scene
    wrt = choose(loop.parameter_paths)
    assert len(wrt) >= 5
    adjoint = rollout.value_and_gradient(wrt=wrt)
    forward = rollout.jacobian(wrt=wrt)
    r = forward.trajectory.measures
    chained = 1e3 * forward.measures["ise"][0] + forward.measures["spin"][0]
    chained += 2e-2 * r["torque"] @ forward.measures["torque"]
    size = np.abs(adjoint.gradients["all"]).max()
    np.testing.assert_allclose(chained, adjoint.gradients["all"], rtol=1e-8, atol=1e-11 * size)

    base = rollout.values()[rollout.indices(wrt)]
    step = 1e-5 * np.maximum(np.abs(base), 0.1)
    rows = np.concatenate([base + np.diag(step), base - np.diag(step)])
    cost = rollout.batch(wrt, rows).costs["all"]
    differences = (cost[: len(wrt)] - cost[len(wrt) :]) / (2 * step)
    np.testing.assert_allclose(adjoint.gradients["all"], differences, rtol=2e-5, atol=1e-6 * size)


def test_gradients_by_ends_that_fit_no_step_and_coincide():
    """Two references end at the same time, each by a parameter of its own."""
    ends = tuple(f"robots.{name}.tips.tip.reference.duration" for name in ("rpr1", "rpr2"))
    loop = build_closed_loop(load_scene("paper", dict.fromkeys(ends, 0.2413)))
    s = Signals.of(loop)
    named = {"ise": integral(1e4 * ca.sumsqr(s["tip_error"])), "peak": peak(ca.fabs(s["joint_torque"]))}
    measures = Measures(s, named, lambda r, p: {"all": r["ise"] + 1e-3 * ca.sumsqr(r["peak"])})
    rollout = build_rollout(loop, duration_s=0.4, step_s=0.004, output_step_s=0.02, measures=measures)
    adjoint = rollout.value_and_gradient(wrt=ends).gradients["all"]
    forward = rollout.jacobian(wrt=ends)
    chained = forward.measures["ise"][0]
    chained = chained + 2e-3 * forward.trajectory.measures["peak"] @ forward.measures["peak"]
    np.testing.assert_allclose(chained, adjoint, rtol=1e-10)
    moved = np.eye(2) * 2e-5
    coarse, fine = (
        (rollout.batch(ends, 0.2413 + h).costs["all"] - rollout.batch(ends, 0.2413 - h).costs["all"])
        / (2 * h.sum(axis=1))
        for h in (moved, moved / 2)
    )
    np.testing.assert_allclose(adjoint, (4 * fine - coarse) / 3, rtol=1e-6)
