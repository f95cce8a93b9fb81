"""Events: where they are, what they change, in every engine; lanes that meet them at different times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from spacerobot.common.errors import DivergedError
from spacerobot.rollout import build_rollout, choose_step, step_choice
from spacerobot.rollout.methods import METHODS
from tests.rollout.hybrid_loops import Hybrid, Rule, bouncing_ball, dwell, latch, spring_wall, two_balls

BOTH = pytest.mark.parametrize("backend", ["compiled", "interpreted"])


def fired(trajectory, loop):
    """Names and times of what happened."""
    return [(loop.events[here.event].name, here.time_s) for here in trajectory.events]


def run(loop, duration_s, step_s=0.02, output_step_s=0.1, **options):
    parameters = options.pop("parameters", None)
    rollout = build_rollout(
        loop, duration_s=duration_s, step_s=step_s, output_step_s=output_step_s, **options
    )
    return rollout.run(parameters)


def bounces(count, height=1.0, restitution=0.7, gravity=9.81):
    """Times of a ball's bounces [s], and its speeds after them."""
    times, speed = [np.sqrt(2 * height / gravity)], np.sqrt(2 * height * gravity)
    speeds = [restitution * speed]
    for _ in range(count - 1):
        times.append(times[-1] + 2 * speeds[-1] / gravity)
        speeds.append(restitution * speeds[-1])
    return np.array(times), np.array(speeds)


@BOTH
def test_a_ball_bounces_where_its_closed_form_does(backend):
    found = run(bouncing_ball(), 2.2, backend=backend)
    times, speeds = bounces(len(found.events))
    assert len(found.events) == 5
    assert found.status == "completed"
    for here, when, speed in zip(found.events, times, speeds, strict=True):
        assert abs(here.time_s - when) < 1e-11
        assert here.before[0] == pytest.approx(0, abs=1e-11)
        assert here.before[1] == pytest.approx(-speed / 0.7, rel=1e-11)
        assert here.after[1] == pytest.approx(speed, rel=1e-11)
        assert here.after[2] == here.time_s
    k = np.searchsorted(times, found.time) - 1
    since = found.time - np.where(k < 0, 0, times[k])
    height = np.where(k < 0, 1.0, speeds[k] * since) - 9.81 / 2 * since**2
    np.testing.assert_allclose(found.state[:, 0], height, atol=1e-11)


@BOTH
def test_a_ball_that_comes_to_rest_chatters_and_is_kept_up_to_there(backend):
    found = run(bouncing_ball(), 3.0, backend=backend)
    rest = np.sqrt(2 / 9.81) * 1.7 / 0.3
    assert found.status == "chattering"
    assert found.diverged_at_s == pytest.approx(rest, abs=1e-8)
    assert found.time[-1] == pytest.approx(2.5)
    assert np.isfinite(found.state).all()
    assert len(found.events) > 100  # more than there is room for at first
    assert [here.event for here in found.events] == [0] * len(found.events)


@BOTH
def test_routine_events_are_recorded_by_single_rollouts_alone(backend):
    loop = two_balls(second=1.5)
    loop.events = [replace(loop.events[0], routine=True), *loop.events[1:]]
    rollout = build_rollout(loop, duration_s=1.9, step_s=0.02, output_step_s=0.1, backend=backend)
    alone = [here.event for here in rollout.run().events]
    path = loop.parameter_paths[0]
    value = rollout.values()[0]
    batch = rollout.batch([path], [[value], [value]]).events
    assert set(alone) == {0, 1}
    assert set(batch.event[:, : alone.count(1)].ravel()) == {1}
    np.testing.assert_array_equal(batch.count, alone.count(1))


@BOTH
def test_a_mass_touches_a_spring_wall_and_parts(backend):
    loop = spring_wall()
    found = run(loop, 3.0, method="dop853", backend=backend)
    names = [name for name, _ in fired(found, loop)]
    assert names == ["touch", "part"]
    touch, part = (here.time_s for here in found.events)
    assert touch == pytest.approx(np.arccos(-0.6) / 2, abs=1e-9)
    rate, speed = np.sqrt(94.0), 2 * np.sin(np.arccos(-0.6))

    def within(t):  # about where both springs balance
        rest = 90 * 0.6 / 94
        return rest + (0.6 - rest) * np.cos(rate * t) + speed / rate * np.sin(rate * t) - 0.6

    assert part - touch == pytest.approx(brentq(within, 0.2, 0.5, xtol=1e-13), abs=1e-9)
    x, v = found.state[:, 0], found.state[:, 1]
    energy = v**2 / 2 + 2 * x**2 + 45 * np.maximum(x - 0.6, 0) ** 2
    np.testing.assert_allclose(energy, 2.0, rtol=1e-9)
    assert [here.switches.tolist() for here in found.events] == [[1.0], [0.0]]


COARSE = (0.3, 0.15, 0.075)
STEPS = {"rk4": (0.1, 0.05, 0.025), "tanaka6": COARSE, "verner7": COARSE, "dop853": (0.3, 0.15)}


@BOTH
@pytest.mark.parametrize("name", METHODS)
def test_every_method_keeps_its_order_through_events(name, backend):
    loop = spring_wall(wall=9.0)

    def end(step_s, method=name):
        return run(loop, 4.2, step_s, 0.6, method=method, backend=backend)

    exact = run(loop, 4.2, 0.01, 0.6, method="dop853").state[-1]
    found = [end(h) for h in STEPS[name]]
    assert all(len(trajectory.events) >= 3 for trajectory in found)
    errors = [np.abs(trajectory.state[-1] - exact).max() for trajectory in found]
    slope = np.polyfit(np.log(STEPS[name]), np.log(errors), 1)[0]
    assert METHODS[name].order - 0.6 < slope < METHODS[name].order + 2.5


@BOTH
def test_a_latch_takes_energy_and_is_released_so_long_afterwards(backend):
    loop = latch()
    found = run(loop, 6.0, backend=backend, method="dop853")
    assert [name for name, _ in fired(found, loop)] == ["caught", "released", "back"]
    caught, released, back = found.events
    assert released.time_s - caught.time_s == pytest.approx(0.4, abs=2e-12)
    assert caught.after[3] == caught.time_s
    before, after = caught.before, caught.after
    assert after[1] * 0.8 == pytest.approx(before[1] * 0.5, rel=1e-14)
    lost = 0.5 * 0.5 * before[1] ** 2 - 0.5 * 0.8 * after[1] ** 2
    assert after[4] == pytest.approx(lost, rel=1e-12)
    energy = 0.5 * 0.5 * before[1] ** 2 + 2 * (1 - np.cos(before[0]))
    assert energy == pytest.approx(2 * (1 - np.cos(1.2)), rel=1e-9)
    assert [here.switches.tolist() for here in found.events] == [[1, 0], [0, 1], [0, 1]]
    assert found.status == "completed"
    assert found.ended_at_s == back.time_s
    assert found.time[-1] < back.time_s < found.time[-1] + 0.1
    assert found.diverged_at_s is None


@BOTH
def test_what_is_reached_for_long_enough_is_captured(backend):
    loop = dwell()
    found = run(loop, 6.0, backend=backend, method="dop853")
    names = [name for name, _ in fired(found, loop)]
    assert names[-2:] == ["entered", "captured"]
    assert names.count("captured") == 1
    assert names[: 2 * names.count("left")] == ["entered", "left"] * names.count("left")
    assert names.count("left") > 0
    assert found.events[-1].time_s - found.events[-2].time_s == pytest.approx(0.5, abs=2e-12)
    for here in found.events[:-1]:
        assert abs(here.before[0]) == pytest.approx(0.3, abs=1e-11)


@BOTH
def test_balls_that_bounce_at_once_both_bounce(backend):
    loop = two_balls()
    found = run(loop, 1.9, backend=backend)
    assert [here.event for here in found.events] == [0, 1] * 3
    # a compiler may fuse other products of the second ball: 100 steps round speeds below 5 m/s, an ulp each
    np.testing.assert_allclose(found.state[:, :2], found.state[:, 2:], rtol=0, atol=100 * np.spacing(5.0))
    apart = run(two_balls(second=1.0 + 1e-6), 1.9, backend=backend)
    assert [here.event for here in apart.events] == [0, 1] * 3
    times, _ = bounces(3, 1.0 + 1e-6, 0.8)
    np.testing.assert_allclose([here.time_s for here in apart.events[1::2]], times, atol=1e-11)


def chain(ends: int) -> Hybrid:
    """Events that arm one another: the second holds already when it is armed, the third an instant later."""
    return Hybrid(
        {"when": 0.37, "later": 0.1},
        lambda when, later: ([0, 0], [0, 0, when, later]),
        lambda t, x, c: [1, 0],
        lambda t, x, c: [
            ((1 - c[0]) * (1 - c[1]), x[0] - c[2]),
            (c[0] * (1 - c[1]), x[0] - 0.2),
            (c[1], t - x[1] - c[3]),
        ],
        lambda t, x, c: [(x[0], t), (x[0], x[1]), (x[0], x[1])],
        [
            Rule("first", ((0, True),)),
            Rule("second", ((1, True),)),
            Rule("third", ((1, False),), ends=bool(ends)),
        ],
        switches=(0, 1),
    )


@BOTH
def test_what_holds_when_it_is_armed_fires_at_once(backend):
    loop = chain(ends=1).loop()
    found = run(loop, 1.0, backend=backend)
    first, second, third = found.events
    assert (first.event, second.event, third.event) == (0, 1, 2)
    assert first.time_s == second.time_s == pytest.approx(0.37, abs=1e-12)
    assert third.time_s == pytest.approx(0.47, abs=2e-12)
    assert found.ended_at_s == third.time_s
    at_start = run(loop, 1.0, backend=backend, parameters={"when": -1.0})
    assert [here.time_s for here in at_start.events] == pytest.approx([0, 0.2, 0.2], abs=1e-12)


@BOTH
def test_events_that_arm_each_other_at_one_instant_chatter(backend):
    loop = Hybrid(
        {"when": 0.55},
        lambda when: ([0], [0, when]),
        lambda t, x, c: [1],
        lambda t, x, c: [(1 - c[0], x[0] - c[1]), (c[0], x[0] - c[1] + 0.1)],
        lambda t, x, c: [(x[0],), (x[0],)],
        [Rule("there", ((0, True),)), Rule("back", ((0, False),))],
        switches=(0,),
    ).loop()
    found = run(loop, 1.0, backend=backend)
    assert found.status == "chattering"
    assert found.diverged_at_s == pytest.approx(0.55, abs=1e-11)
    assert len(found.events) == 101


@BOTH
@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-8])
def test_a_short_touch_is_not_stepped_over(backend, depth):
    """The mass turns back just within the wall, and has left it where its step ends."""
    for start in (-0.6 - depth, -0.6 + depth):
        loop = spring_wall(start=start, wall=4.0)
        found = run(loop, 2.0, 0.3, 0.9, backend=backend, method="dop853")
        assert [here.event for here in found.events] == ([0, 1] if start < -0.6 else [])
        if start < -0.6:
            touch = np.arccos(0.6 / start) / 2
            assert found.events[0].time_s == pytest.approx(touch, abs=1e-6 / np.sqrt(depth))


@BOTH
def test_steps_are_finer_while_a_switch_is_on(backend):
    loop = spring_wall()
    coarse = run(loop, 3.0, 0.1, backend=backend)
    loop.fine = ((0, 0.005, 0.0),)
    fine = run(loop, 3.0, 0.1, backend=backend)
    touch, part = (here.time_s for here in fine.events)
    added = (part - touch) / 0.005 - (part - touch) / 0.1
    assert fine.steps - coarse.steps == pytest.approx(added, abs=8)
    touching = spring_wall(start=0.6, speed=0.5)
    touching.setup = type(touching.setup)("setup", touching.setup.sx_in(), started(touching))
    touching.fine = ((0, 0.005, 0.0),)
    assert run(touching, 0.3, 0.1, backend=backend).steps >= 40


def started(loop):
    """Start of a loop whose first switch is on."""
    x0, c = loop.setup(loop.setup.sx_in(0))
    c[0] = 1
    return [x0, c]


@BOTH
def test_jumps_and_events_meet(backend):
    """A force that begins at a given time, and a switch so long after the mass was met."""
    loop = Hybrid(
        {"jump": 0.9, "wall": 0.3},
        lambda jump, wall: ([0, 0], [jump, 0, wall]),
        lambda t, x, c: [x[1], ca_if(t < c[0], 1, -2) * (1 - c[1])],
        lambda t, x, c: [(1 - c[1], x[0] - c[2])],
        lambda t, x, c: [(x[0], 0)],
        [Rule("stops", ((0, True),))],
        switches=(1,),
        jumps=(0,),
    ).loop()
    for jump, when in ((0.9, np.sqrt(0.6)), (np.sqrt(0.6), np.sqrt(0.6)), (0.3, None)):
        found = run(loop, 2.0, 0.1, 0.5, backend=backend, parameters={"jump": jump})
        assert len(found.events) == (when is not None)
        if when:
            assert found.events[0].time_s == pytest.approx(when, abs=1e-12)
            assert found.state[-1, 0] == pytest.approx(0.3, abs=1e-12)


def ca_if(condition, yes, no):
    return condition * yes + (1 - condition) * no


@pytest.fixture(scope="module")
def many():
    loop = latch()
    rollout = build_rollout(loop, duration_s=5.0, step_s=0.05, output_step_s=0.25)
    rows = np.random.default_rng(4).uniform([0.5, 0.1], [1.5, 1.5], (19, 2))
    rows[5] = (0.05, 0.4)  # caught at once, and never back
    return rollout, rows, rollout.batch(("start", "delay"), rows, states=True, outputs=("state",), threads=2)


def same(found, whole, rows):
    np.testing.assert_array_equal(found.state, whole.state[rows])
    np.testing.assert_array_equal(found.outputs["state"], whole.outputs["state"][rows])
    for name in ("count", "event", "time_s", "ended_at_s", "chattering"):
        np.testing.assert_array_equal(getattr(found.events, name), getattr(whole.events, name)[rows])


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("rows", [slice(0, 19), slice(5, 6), slice(2, 13), slice(18, 19)])
def test_no_bit_depends_on_neighbours_that_meet_their_events_at_other_times(many, rows, threads):
    rollout, values, whole = many
    same(rollout.batch(("start", "delay"), values[rows], states=True, outputs=("state",), threads=threads),
         whole, rows)  # fmt: skip


def test_lanes_meet_the_events_of_single_rollouts(many):
    rollout, values, whole = many
    for i in (0, 5, 9, 18):
        one = rollout.run(dict(zip(("start", "delay"), values[i], strict=True)))
        n = len(one.events)
        assert whole.events.count[i] == n
        assert whole.events.event[i, :n].tolist() == [here.event for here in one.events]
        assert (whole.events.event[i, n:] == -1).all()
        np.testing.assert_allclose(whole.events.time_s[i, :n], [h.time_s for h in one.events], rtol=1e-12)
        np.testing.assert_allclose(whole.state[i, : len(one.time)], one.state, rtol=1e-11, atol=1e-12)
        assert np.isnan(whole.state[i, len(one.time) :]).all()
    assert np.flatnonzero(whole.events.count != 3).tolist() == [5]
    assert np.flatnonzero(np.isnan(whole.events.ended_at_s)).tolist() == [5]
    assert np.isnan(whole.diverged_at_s).all()


def test_a_lane_that_chatters_leaves_its_neighbours(many):
    rollout = build_rollout(bouncing_ball(), duration_s=2.0, step_s=0.05, output_step_s=0.2)
    heights = np.array([1.0, 0.05, 0.7, 2.0, 1.5, 0.9, 0.02, 1.1, 1.2])
    whole = rollout.batch(("height",), heights[:, None], states=True)
    assert np.flatnonzero(whole.events.chattering).tolist() == [1, 6]
    assert np.flatnonzero(np.isfinite(whole.diverged_at_s)).tolist() == [1, 6]
    assert whole.events.count[1] > whole.events.event.shape[1]  # all are counted, the first ones told
    for i, height in enumerate(heights):
        alone = rollout.batch(("height",), [[height]], states=True)
        np.testing.assert_array_equal(alone.state[0], whole.state[i])


def test_a_loop_without_events_has_none(loop):
    rollout = build_rollout(loop, duration_s=1.0, step_s=0.05)
    assert rollout.run().events == ()
    assert rollout.batch(("arm.kp",), [[4.0]]).events is None


def test_a_step_is_chosen_though_an_event_ends_rollouts_about_a_sample(monkeypatch):
    loop = latch()
    ended = run(loop, 6.0, 0.001).ended_at_s
    choice = choose_step(loop, duration_s=6.0, output_step_s=ended / 5, tolerance=1e-6)
    assert choice.error < 1e-6
    monkeypatch.setattr(step_choice, "HALVINGS", 4)  # each of them chatters as the first one
    with pytest.raises(DivergedError, match="too many events come in too short a time, after"):
        choose_step(bouncing_ball(), duration_s=3.0)
