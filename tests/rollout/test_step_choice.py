"""Choosing a step, and the implicit integrator for stiff loops."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from spacerobot.common.errors import DivergedError
from spacerobot.rollout import build_rollout, choose_step, step_choice

GRID = {"duration_s": 2.0, "output_step_s": 0.1}
STIFF = {"arm.kd": 2000.0}  # an eigenvalue of -2000 / 1.3 1/s


def error_of(rollout, exact):
    scale = np.maximum(1.0, np.abs(exact.state).max(axis=0))
    return (np.abs(rollout.run().state - exact.state) / scale).max()


@pytest.mark.parametrize(("method", "tolerance"), [("rk4", 1e-5), ("rk4", 1e-8), ("tanaka6", 1e-9)])
def test_the_chosen_step_keeps_to_the_tolerance_and_wastes_little(loop, method, tolerance):
    exact = build_rollout(loop, **GRID, step_s=0.002, method="dop853").run()
    rollout = build_rollout(loop, **GRID, tolerance=tolerance, method=method)
    choice = rollout.choice
    assert choice.error <= tolerance
    assert error_of(rollout, exact) == pytest.approx(choice.error, rel=0.05, abs=1e-12)
    assert rollout.grid.step_s == pytest.approx(choice.step_s)
    if choice.step_s < 0.1:
        longer = build_rollout(loop, **GRID, step_s=2.1 * choice.step_s, method=method)
        assert error_of(longer, exact) > tolerance


def test_the_stability_limit_is_recognised(loop):
    choice = choose_step(loop, **GRID, tolerance=1e-3, parameters=STIFF, method="rk4")
    limit = 2.785 / (2000 / 1.3)  # where the real axis leaves the method's region of stability
    assert choice.step_s < limit
    assert limit < choice.unstable_s < 4 * limit
    assert build_rollout(loop, **GRID, step_s=1.3 * limit, method="rk4").run(STIFF).status == "diverged"
    assert build_rollout(loop, **GRID, step_s=0.9 * limit, method="rk4").run(STIFF).status == "completed"


def test_what_is_over_between_two_samples_is_not_certified(loop):
    """A torque of 2 ms halfway between samples, seen by few stages, without a trace at the samples."""
    jumps = replace_dynamics(loop)
    choice = choose_step(jumps, **GRID, tolerance=1e-6)
    coarse = build_rollout(jumps, **GRID, step_s=0.05)
    assert coarse.run(estimate=True).step_error > 1e-4
    assert choice.step_s < 0.01
    for backend in ("compiled", "interpreted"):
        found = build_rollout(jumps, **GRID, step_s=0.02, backend=backend).run(estimate=True)
        assert found.step_error == pytest.approx(
            build_rollout(jumps, **GRID, step_s=0.02).run(estimate=True).step_error, rel=1e-9
        )


def replace_dynamics(loop):
    """The loop with a pulse of 30 rad/s^2 and its opposite around 0.55 s."""
    t, x, c = loop.dynamics.sx_in()
    rate = ca.SX(loop.dynamics(t, x, c))
    pulse = 30 * (t - 0.55) / 0.004 * ca.exp(-(((t - 0.55) / 0.004) ** 2))
    rate[6] += pulse
    dynamics = ca.Function("dynamics", [t, x, c], [rate], ["t", "x", "c"], ["xdot"])
    return SimpleNamespace(**{**vars(loop), "dynamics": dynamics})


def test_a_hopeless_loop_is_told(loop):
    with pytest.raises(DivergedError, match="even with that one the rollout diverged, after"):
        choose_step(loop, **GRID, parameters={"arm.kp": -1e4, "arm.kd": -1e4})


@pytest.mark.parametrize(("most", "halvings"), [(1000, 5), (6000, 7)])
def test_what_is_tried_is_bounded_and_told(loop, monkeypatch, most, halvings):
    """Twenty intervals of two seconds: 20, 40, 80, ... steps, until their sum would be above the bound."""
    monkeypatch.setattr(step_choice, "MOST_STEPS", most)
    rollout, told = build_rollout(loop, **GRID, step_s=0.1), []
    finest = 0.1 / 2**halvings
    with pytest.raises(DivergedError, match=rf"no step down to {finest:.3g} s reaches .* of 1e-30: an error"):
        rollout.choose_step(1e-30, progress=told.append)
    assert told == [f"choosing a step: trying {0.1 / 2**n:.3g} s" for n in range(halvings + 1)]
    assert 20 * (2 ** (halvings + 1) - 1) <= max(most, 20 * 2**6)


def test_a_long_rollout_gets_its_first_halvings_all_the_same(loop, monkeypatch):
    monkeypatch.setattr(step_choice, "MOST_STEPS", 1)
    assert choose_step(loop, **GRID, tolerance=1e-5).error < 1e-5


def test_without_a_compiler_it_interprets_and_says_so(loop, monkeypatch):
    monkeypatch.setenv("SPACEROBOT_COMPILER", "none")
    rollout = build_rollout(loop, **GRID, step_s=0.01)
    assert rollout.backend == rollout.run().backend == "interpreted"
    assert "interpreted" in rollout.summary


def test_a_compiler_that_fails_is_named_in_the_summary(loop, monkeypatch, tmp_path):
    broken = tmp_path / "broken"
    broken.write_text('#!/bin/sh\n[ "$1" = --version ] && echo broken 1.0 && exit 0\nexit 3\n')
    broken.chmod(0o755)
    monkeypatch.setenv("SPACEROBOT_COMPILER", str(broken))
    rollout = build_rollout(loop, **GRID, step_s=0.01)
    assert rollout.backend == "interpreted"
    assert "broken failed with 3" in rollout.summary


@pytest.mark.parametrize("flags", ["-O0", "-O1"])
def test_methods_in_one_process_keep_their_own_tables(loop, monkeypatch, flags):
    """Without optimisation a library reads its tableau from memory, and must find its own there."""
    monkeypatch.setenv("SPACEROBOT_COMPILER_FLAGS", flags)
    found = {}
    for method in ("dop853", "rk4", "tanaka6"):
        for backend in ("compiled", "interpreted"):
            rollout = build_rollout(loop, **GRID, step_s=0.02, method=method, backend=backend)
            found[method, backend] = rollout.run(estimate=True)
    for method in ("dop853", "rk4", "tanaka6"):
        compiled, other = found[method, "compiled"], found[method, "interpreted"]
        np.testing.assert_allclose(compiled.state, other.state, rtol=1e-12, atol=1e-12)
        assert compiled.step_error == pytest.approx(other.step_error, rel=1e-3, abs=1e-13)
