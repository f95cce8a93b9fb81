"""Rollouts without compiling: which are done so, what they give, and scenes that once failed."""

from __future__ import annotations

import shlex

import casadi as ca
import numpy as np
import pytest

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import CompileError
from spacerobot.compiled import find_toolchain
from spacerobot.compiled.toolchain import SUFFIX
from spacerobot.rollout import Measures, Signals, build_rollout, integral, virtual_machine
from spacerobot.rollout.virtual_machine import Program
from tests.contacts.test_passing_through import flight
from tests.rollout.hybrid_loops import Hybrid, Rule

GRID = {"duration_s": 2.0, "step_s": 0.02, "output_step_s": 0.2}


def test_a_long_function_with_many_slots_is_what_casadi_evaluates():
    """More slots than short indices tell, products that are fused with sums, and chains of one kind."""
    x = ca.SX.sym("x", 40_000)
    chain = ca.SX(1.0)
    for k in range(200):
        chain = chain * x[k] + ca.sin(x[k + 1]) - x[k + 2] * x[k + 3]
    values = ca.vertcat(x * x[::-1] - 2 * x, chain, 1 / x[:3])
    function = ca.Function("f", [x], [values, ca.sumsqr(x)], ["x"], ["y", "z"])
    at = np.random.default_rng(0).uniform(0.5, 1.5, 40_000)
    for ours, casadis in zip(Program("f", function)(at), function(at), strict=True):
        np.testing.assert_allclose(ours, casadis.full().ravel(), rtol=1e-12, atol=1e-12)


def test_a_function_of_an_unknown_form_is_refused():
    x = ca.MX.sym("x", 2)
    with pytest.raises(CompileError, match="'f'"):
        Program("f", ca.Function("f", [x], [ca.solve(ca.MX.eye(2), x)], ["x"], ["y"]))


@pytest.mark.compiler
def test_few_rollouts_are_interpreted_and_many_compiled(loop):
    backends = [build_rollout(loop, **GRID, rollouts=rollouts).backend for rollouts in (1, 10_000_000, None)]
    assert backends == ["interpreted", "compiled", "compiled"]
    asked = [
        build_rollout(loop, **GRID, rollouts=1, backend=name).backend for name in ("compiled", "interpreted")
    ]
    assert asked == ["compiled", "interpreted"]


@pytest.mark.compiler
def test_what_is_in_the_cache_does_not_change_a_bit(loop, monkeypatch, tmp_path):
    monkeypatch.setenv("SPACEROBOT_CACHE_DIR", str(tmp_path))
    empty = build_rollout(loop, **GRID, rollouts=1).run()
    assert build_rollout(loop, **GRID).run().backend == "compiled"
    again = build_rollout(loop, **GRID, rollouts=1).run()
    assert empty.backend == again.backend == "interpreted"
    np.testing.assert_array_equal(empty.state, again.state)


@pytest.mark.compiler
def test_gradients_and_batches_of_both_backends_agree(loop):
    signals = Signals.of(loop)
    measures = Measures(
        signals, {"ise": integral(ca.sumsqr(signals["error"]))}, costs=lambda r, _: {"x": r["ise"]}
    )
    wrt, rows = ("arm.kp", "rotor.spin"), [[4.0, 0.9], [3.0, 0.5], [5.0, 0.7]]
    few, many = (build_rollout(loop, **GRID, measures=measures, rollouts=n) for n in (3, None))
    for ours, theirs in (
        (few.value_and_gradient(wrt=wrt), many.value_and_gradient(wrt=wrt)),
        (few.gradient_batch(wrt, rows), many.gradient_batch(wrt, rows)),
    ):
        assert (ours.backend, theirs.backend) == ("interpreted", "compiled")
        np.testing.assert_allclose(ours.gradients["x"], theirs.gradients["x"], rtol=1e-11)
    np.testing.assert_array_equal(
        few.batch(wrt, rows, threads=1).costs["x"], few.batch(wrt, rows, threads=2).costs["x"]
    )


@pytest.mark.parametrize("backend", ["auto", "interpreted"])
def test_one_simulation_of_a_shipped_scene_is_interpreted(backend):
    result = sr.simulate(sr.load_scene("paper", {"simulation.duration": 0.1}), backend=backend)
    assert "interpreted" in result.summary["engine"]["toolchain"]


def hybrid(rate, guard):
    """A state that runs away, the sooner the larger the rate, and an event that ends the rollout."""
    return Hybrid(
        {"rate": rate},
        lambda rate: ((ca.SX(1.0),), (rate,)),
        lambda _t, x, c: (c[0] * x[0] ** 3,),
        lambda _t, x, _c: ((ca.SX(1), guard(x[0])),),
        lambda _t, x, _c: ((x[0],),),
        (Rule("end", ends=True),),
    ).loop()


LOOPS = {
    "diverges within its first step": (lambda: hybrid(1e200, lambda x: x - 2e300), "diverged"),
    "ends before its first step": (lambda: hybrid(0.1, lambda _: ca.SX(1.0)), "completed"),
    "diverges within its first step in a contact that is too stiff": (
        lambda: build_closed_loop(
            flight(5.0, 0.15, 0.0, step=1.0, longest_step=None, stiffness=1e14, may_overlap=True)
        ),
        "diverged",
    ),
}


@pytest.mark.parametrize("name", LOOPS)
def test_a_rollout_without_a_step_is_a_result(name):
    build, status = LOOPS[name]
    rollout = build_rollout(build(), duration_s=1.0, step_s=1.0, output_step_s=1.0, backend="interpreted")
    for estimate in (False, True):
        run = rollout.run(estimate=estimate)
        assert (run.status, run.steps, len(run.state)) == (status, 0, 1)
        assert np.isfinite(run.state).all()


@pytest.mark.compiler
def test_what_is_compiled_in_the_background_serves_later_rollouts(loop):
    rollout = build_rollout(loop, **GRID, in_background=True)
    first = rollout.run()
    rollout.engines._background.join()
    later = rollout.run()
    assert (first.backend, later.backend) in (("interpreted", "compiled"), ("compiled", "compiled"))
    np.testing.assert_allclose(first.state, later.state, rtol=1e-10, atol=1e-12)


def write_broken_compiler(folder):
    """Path of a compiler that has a version and compiles nothing."""
    broken = folder / "broken"
    broken.write_text('#!/bin/sh\n[ "$1" = --version ] && echo broken 1.0 && exit 0\nexit 3\n')
    broken.chmod(0o755)
    return broken


def test_a_compiler_that_fails_in_the_background_leaves_it_interpreted(loop, monkeypatch, tmp_path):
    monkeypatch.setenv("SPACEROBOT_COMPILER", str(write_broken_compiler(tmp_path)))
    rollout = build_rollout(loop, **GRID, in_background=True)
    rollout.engines._background.join()
    assert rollout.run().backend == "interpreted"
    assert "broken failed with 3" in rollout.summary


def test_each_compiler_has_loops_of_its_own_and_without_one_the_earlier_ones_serve(monkeypatch, tmp_path):
    """The cache's files, one for each version and command line; no test of what they compute."""
    compiler, folder = find_toolchain(), tmp_path / "compiled"
    if compiler is None:
        pytest.skip("no C++ compiler")
    monkeypatch.setenv("SPACEROBOT_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(virtual_machine, "built_file", lambda *_: tmp_path / "none")
    load = virtual_machine.load_loops.__wrapped__
    command = shlex.join(compiler.command)
    monkeypatch.setenv("SPACEROBOT_COMPILER", command)
    first, again = load()._name, load()._name
    monkeypatch.setenv("SPACEROBOT_COMPILER", f"{command} -DANOTHER_COMPILER")
    other = load()._name
    assert first == again != other
    assert len(list(folder.glob(f"*{SUFFIX}"))) == 2
    for named in ("none", "no-such-compiler", write_broken_compiler(tmp_path)):
        monkeypatch.setenv("SPACEROBOT_COMPILER", str(named))
        assert load()._name in (first, other)
    monkeypatch.setenv("SPACEROBOT_CACHE_DIR", str(tmp_path / "empty"))
    for named, told in (("none", "no compiled loops"), (tmp_path / "broken", "broken failed with 3")):
        monkeypatch.setenv("SPACEROBOT_COMPILER", str(named))
        with pytest.raises(CompileError, match=told):
            load()
