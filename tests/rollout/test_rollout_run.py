"""One rollout: order of the method, engines, time, divergence."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from spacerobot.common.errors import SpaceRobotError
from spacerobot.compiled.numeric_function import NumericFunction
from spacerobot.rollout import build_rollout, time_grid
from spacerobot.rollout.methods import METHODS


@pytest.fixture(scope="module")
def pair(loop):
    kwargs = {"duration_s": 5.0, "step_s": 0.01, "output_step_s": 0.05}
    return build_rollout(loop, **kwargs), build_rollout(loop, **kwargs, backend="interpreted")


STEPS = {"rk4": (0.1, 0.05, 0.025), "tanaka6": (0.2, 0.1, 0.05), "verner7": (0.2, 0.1), "dop853": (0.4, 0.2)}


@pytest.mark.parametrize("backend", ["compiled", "interpreted"])
@pytest.mark.parametrize("turn", [0.8, 0.6413, 1.93])
@pytest.mark.parametrize("name", METHODS)
def test_every_method_has_its_order_wherever_the_reference_jumps(loop, name, turn, backend):
    def run(step_s, method=name):
        grid = {"duration_s": 2.0, "step_s": step_s, "output_step_s": 0.4}
        return build_rollout(loop, **grid, method=method, backend=backend).run({"reference.turn": turn})

    exact, steps = run(0.01, "dop853").state[-1], np.array(STEPS[name])
    found = [run(h) for h in steps]
    taken = [2.0 / trajectory.steps for trajectory in found]
    errors = [np.abs(trajectory.state[-1] - exact).max() for trajectory in found]
    slope = np.polyfit(np.log(taken), np.log(errors), 1)[0]
    assert METHODS[name].order - 0.6 < slope < METHODS[name].order + 2.5


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_tableaus_are_consistent(method):
    a, b, c = method.a, np.array(method.b), np.array(method.nodes)
    np.testing.assert_allclose(a.sum(axis=1), c, atol=1e-13)
    assert (np.triu(a) == 0).all()
    n = method.stages
    for power in range(method.order):  # quadrature
        assert b @ c[:n] ** power == pytest.approx(1 / (power + 1), rel=1e-13)
    assert b @ (a[:n, :n] @ c[:n]) == pytest.approx(1 / 6, rel=1e-13)
    weights = np.array([*b, *[0.0] * (len(c) - n)]) - method.error
    for power in range(method.error_order):
        assert weights @ c**power == pytest.approx(1 / (power + 1), rel=1e-12)
    for s in range(n):  # a shared place is not overwritten while it is needed
        readers = [i for i in range(s + 1, n) if a[i, s] != 0]
        last = n if b[s] != 0 else max(readers, default=s)
        assert all(method.places[i] != method.places[s] for i in range(s + 1, last))


def test_compiled_equals_interpreted(pair):
    fast, slow = (rollout.run({"arm.kp": 3.0, "rotor.spin": 1.4}) for rollout in pair)
    assert (fast.backend, slow.backend) == ("compiled", "interpreted")
    np.testing.assert_allclose(fast.state, slow.state, rtol=1e-12, atol=1e-13)
    for name, values in fast.outputs.items():
        np.testing.assert_allclose(values, slow.outputs[name], rtol=1e-12, atol=1e-12)


def test_unit_vectors_stay_unit_and_start_is_the_setup(pair, loop):
    trajectory = pair[0].run()
    np.testing.assert_allclose(np.linalg.norm(trajectory.state[:, 0:2], axis=1), 1, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(trajectory.state[:, 2:6], axis=1), 1, atol=1e-15)
    # the start is compiled too, with sines of its own
    start = loop.setup(loop.parameter_values)[0].full().ravel()
    np.testing.assert_allclose(trajectory.state[0], start, rtol=4e-15, atol=5e-324)


def test_outputs_belong_to_their_sample(pair, loop):
    trajectory, p = pair[0].run(), loop.parameter_values
    c = loop.setup(p)[1]
    for k in (0, 37, -1):
        torque = float(loop.outputs(trajectory.time[k], trajectory.state[k], c)[1])
        assert trajectory.outputs["torque"][k, 0] == pytest.approx(torque, rel=1e-11)


def test_values_by_path_and_in_order_agree(pair, loop):
    values = loop.parameter_values.copy()
    values[1] = 0.9
    by_path, in_order = pair[0].run({"arm.kd": 0.9}), pair[0].run(values)
    np.testing.assert_array_equal(by_path.state, in_order.state)
    with pytest.raises(SpaceRobotError, match=r"no parameter 'arm.kq', did you mean .*arm.kp"):
        pair[0].run({"arm.kq": 1.0})
    with pytest.raises(SpaceRobotError, match=r"shape \(3,\), allowed: \(7,\)"):
        pair[0].run([1.0, 2.0, 3.0])


def test_divergence_is_a_status_and_keeps_what_was_good(pair):
    fast, slow = (rollout.run({"arm.kp": -300.0, "arm.kd": -300.0}) for rollout in pair)
    for trajectory in (fast, slow):
        assert trajectory.status == "diverged"
        assert np.isfinite(trajectory.state).all()
        assert len(trajectory.time) == len(trajectory.state) == len(trajectory.outputs["torque"])
        assert trajectory.time[-1] <= trajectory.diverged_at_s < 5.0
    assert fast.steps == slow.steps


def test_a_motion_of_its_own_is_stepped_onto_however_short(loop):
    """SciPy's integrator is begun again where the reference turns."""
    grid = {"duration_s": 2.0, "output_step_s": 0.1}
    times, rate = np.linspace(0, 2, 21), NumericFunction(loop.dynamics)
    for turn in (1e-4, 0.55 + 1e-7, 1e-12):
        x, c = (value.full().ravel() for value in loop.setup([*loop.parameter_values[:-1], turn]))
        exact = [x]
        for begin, end, side in ((0.0, turn, np.inf), (turn, 2.0, -np.inf)):
            c[list(loop.jumps)] = side
            inside = times[(times > begin) & (times <= end)]
            options = {"method": "DOP853", "t_eval": np.union1d(inside, end), "rtol": 1e-11, "atol": 1e-12}
            run = solve_ivp(lambda t, x, c: rate(t, x, c)[0], (begin, end), x, args=(c,), **options)
            exact += [*run.y.T[: len(inside)]]
            x = run.y[:, -1]
        for backend in ("compiled", "interpreted"):
            found = build_rollout(loop, **grid, step_s=0.05, backend=backend).run({"reference.turn": turn})
            np.testing.assert_allclose(found.state, exact, atol=3e-7)


def test_lanes_have_their_own_jumps_and_their_own_bits(loop):
    rollout = build_rollout(loop, duration_s=2.0, step_s=0.05, output_step_s=0.2)
    turns = np.array([0.3, 0.6413, 1.0, 5.0, 1.93, 0.2, 0.7, 1.1, 0.0, -1.0, 1.9999])
    whole = rollout.batch(("reference.turn",), turns[:, None], states=True)
    for i, turn in enumerate(turns):
        alone = rollout.batch(("reference.turn",), [[turn]], states=True)
        np.testing.assert_array_equal(whole.state[i], alone.state[0])
        single = rollout.run({"reference.turn": turn})
        np.testing.assert_allclose(whole.state[i], single.state, rtol=1e-11, atol=1e-12)


def test_arrays_are_read_only(pair):
    with pytest.raises(ValueError, match="read-only"):
        pair[0].run().state[0, 0] = 1.0


def test_time_comes_from_whole_numbers():
    grid = time_grid(10.0, 0.003, 0.1)
    assert grid.intervals == 100
    assert grid.every == 34
    assert grid.step_s == pytest.approx(0.1 / 34, rel=1e-15)
    assert grid.time[-1] == pytest.approx(10.0, rel=1e-15)
    assert time_grid(0.3, 0.1).steps == 3  # 0.3 / 0.1 is a little below three in binary
    assert time_grid(1.0, 0.3).step_s == 0.25
    with pytest.raises(SpaceRobotError, match=r"output step .* is -1"):
        time_grid(1.0, 0.1, -1.0)


def test_what_is_compiled_holds_up_nothing_else(loop):
    """A rollout goes on while gradients are compiled in another thread, and these are compiled once."""
    engines = build_rollout(loop, duration_s=1.0, step_s=0.1, output_step_s=0.5).engines
    begun, free, made = threading.Event(), threading.Event(), []

    def slow():
        begun.set()
        assert free.wait(60)
        made.append(object())
        return made[-1]

    threads = [threading.Thread(target=engines._once, args=(("slow",), slow)) for _ in range(2)]
    for thread in threads:
        thread.start()
    assert begun.wait(60)
    quick = threading.Thread(target=engines._once, args=(("quick",), object))
    quick.start()
    quick.join(60)
    alive = quick.is_alive()
    free.set()
    for thread in threads:
        thread.join(60)
    assert not alive
    assert len(made) == 1
