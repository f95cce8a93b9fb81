"""One rollout: order of the method, engines, time, divergence."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.errors import SpaceRobotError
from spacerobot.rollout import build_rollout, time_grid


@pytest.fixture(scope="module")
def pair(loop):
    kwargs = {"duration_s": 5.0, "step_s": 0.01, "output_step_s": 0.05}
    return build_rollout(loop, **kwargs), build_rollout(loop, **kwargs, backend="interpreted")


def test_the_method_has_order_four(loop):
    # The kink of the reference at t = 1 is met by a step boundary, so it does not spoil the order.
    def end(step_s):
        return build_rollout(loop, duration_s=2.0, step_s=step_s, output_step_s=2.0).run().state[-1]

    exact = end(0.001)
    steps = np.array([0.1, 0.05, 0.025])
    errors = [np.abs(end(h) - exact).max() for h in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 3.7 < slope < 4.3


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
    np.testing.assert_array_equal(trajectory.state[0], loop.setup(loop.parameter_values)[0].full().ravel())


def test_outputs_belong_to_their_sample(pair, loop):
    trajectory, p = pair[0].run(), loop.parameter_values
    c = loop.setup(p)[1]
    for k in (0, 37, -1):
        torque = float(loop.outputs(trajectory.time[k] - 1e-9 * trajectory.step_s, trajectory.state[k], c)[1])
        assert trajectory.outputs["torque"][k, 0] == pytest.approx(torque, rel=1e-11)


def test_values_by_path_and_in_order_agree(pair, loop):
    values = loop.parameter_values.copy()
    values[1] = 0.9
    by_path, in_order = pair[0].run({"arm.kd": 0.9}), pair[0].run(values)
    np.testing.assert_array_equal(by_path.state, in_order.state)
    with pytest.raises(SpaceRobotError, match=r"no parameter 'arm.kq', did you mean .*arm.kp"):
        pair[0].run({"arm.kq": 1.0})
    with pytest.raises(SpaceRobotError, match=r"shape \(3,\), allowed: \(6,\)"):
        pair[0].run([1.0, 2.0, 3.0])


def test_divergence_is_a_status_and_keeps_what_was_good(pair):
    fast, slow = (rollout.run({"arm.kp": -300.0, "arm.kd": -300.0}) for rollout in pair)
    for trajectory in (fast, slow):
        assert trajectory.status == "diverged"
        assert np.isfinite(trajectory.state).all()
        assert len(trajectory.time) == len(trajectory.state) == len(trajectory.outputs["torque"])
        assert trajectory.time[-1] <= trajectory.diverged_at_s < 5.0
    assert fast.steps == slow.steps


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
