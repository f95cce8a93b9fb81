"""Derivatives through events: their times move with the parameters, in every engine and both directions."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import Measures, Signals, build_rollout, final, integral, peak
from spacerobot.scene import build_scene
from tests.oracles.small_scenes import PLANAR, small_scene
from tests.rollout.hybrid_loops import Hybrid, Rule, bouncing_ball, dwell, latch, spring_wall, two_balls

GRID = {"step_s": 0.05, "output_step_s": 0.1}


def moved_force():
    """A force that begins at a moving time pushes a mass against a stop, which holds it for a while."""
    return Hybrid(
        {"jump": 0.6, "wall": 0.3, "hold": 0.25, "speed": 0.4},
        lambda jump, wall, hold, speed: ([0, speed, 0], [jump, jump, 0, wall, hold]),
        lambda t, x, c: [
            x[1] * (1 - c[2]),
            ((t < c[0]) * 0.2 + (t >= c[0]) * (1 + t - c[1])) * (1 - c[2]),
            0,
        ],
        lambda t, x, c: [(1 - c[2], x[0] - c[3] - 0.5 * (x[2] > 0)), (c[2], t - x[2] - c[4])],
        lambda t, x, c: [(x[0], -0.5 * x[1], t), (x[0], x[1], x[2])],
        [Rule("stopped", ((0, True),)), Rule("freed", ((0, False),))],
        switches=(2,),
        jumps=(0,),
    ).loop()


def clocks(**changes):
    """Two events at times of their own, and a third that they arm together and that keeps the later time."""
    return Hybrid(
        {"first": 0.5, "second": 0.5, "rate": 0.7, "gain": 1.0, "shift": 0.0} | changes,
        lambda first, second, rate, gain, shift: (
            [1, 0, 0, 0],
            [0, 0, 0, first, second, rate, gain, shift],
        ),
        lambda t, x, c: [c[5] * (1 - c[0] * (1 - c[6])) * x[0], 1 - 0.5 * c[1], 0, 0],
        lambda t, x, c: [(1 - c[0], t - c[3]), (1 - c[1], t - c[4]), (c[0] * c[1] * (1 - c[2]), 1)],
        lambda t, x, c: [
            (c[6] * x[0], x[1], x[2], x[3]),
            (x[0] + c[7], x[1] + 1, x[2], x[3]),
            (x[0], x[1], c[5] * t, x[3]),
        ],
        [Rule("first", ((0, True),)), Rule("second", ((1, True),)), Rule("both", ((2, True),))],
        switches=(0, 1, 2),
    ).loop()


def pulses():
    """Two thrusters on one mass that are cut off at one instant, each by an on-time of its own."""
    return Hybrid(
        {"left": 0.43, "right": 0.43, "push": 2.0, "pull": 1.2, "drag": 0.3},
        lambda left, right, push, pull, drag: ([0, 0.1, 0], [1, 1, left, right, push, pull, drag]),
        lambda t, x, c: [x[1], c[0] * c[4] * (1 - x[0]) - c[1] * c[5] - c[6] * x[1], c[0] + 2 * c[1]],
        lambda t, x, c: [(c[0], t - c[2] * (1 + 0.1 * c[4])), (c[1], t - c[3] * (1 + 0.1 * c[4]))],
        lambda t, x, c: [(x[0], x[1], x[2]), (x[0], x[1], x[2])],
        [Rule("left", ((0, False),)), Rule("right", ((1, False),))],
        switches=(0, 1),
    ).loop()


def graded(loop):
    """A closed loop whose steps grow and shrink again while its first switch is on."""
    loop.fine = ((0, GRID["step_s"], 3),)
    return loop


CASES = {
    "ball": (bouncing_ball, 2.0),
    "wall": (lambda: graded(spring_wall()), 4.0),
    "latch": (latch, 2.0),
    "ended": (latch, 6.0),
    "dwell": (dwell, 6.0),
    "jump": (moved_force, 2.0),
    "balls": (two_balls, 1.9),
}


def measured(loop):
    s = Signals.of(loop)
    named = {
        "sum": integral(s.x[0] ** 2 + s.t * s.x[0]),
        "end": final(ca.vertcat(s.x, s.t * s.x[0])),
        "worst": peak(s.x[1] + 0.1 * s.t),
    }

    def costs(r, p):
        ends = {f"end{k}": r["end"][k] for k in range(r["end"].numel())}
        return {"sum": r["sum"], "worst": r["worst"], **ends}

    return Measures(s, named, costs)


@pytest.fixture(scope="module", params=CASES)
def case(request):
    make, duration_s = CASES[request.param]
    loop = make()
    options = {"duration_s": duration_s, **GRID, "measures": measured(loop)}
    return [build_rollout(loop, **options, backend=backend) for backend in ("compiled", "interpreted")]


def differences(rollout, wrt):
    """Central differences of every cost, extrapolated once to the fourth order, each of shape (k,)."""
    base, columns = rollout.values(), rollout.indices(wrt)
    scale = np.maximum(np.abs(base[columns]), 0.1)

    def slopes(relative):
        rows = np.repeat(base[None, :], 2 * len(wrt), axis=0)
        for i, column in enumerate(columns):
            rows[2 * i, column] += relative * scale[i]
            rows[2 * i + 1, column] -= relative * scale[i]
        batch = rollout.batch(rollout.loop.parameter_paths, rows)
        assert len(set(batch.events.count)) == 1
        return {k: (v[0::2] - v[1::2]) / (2 * relative * scale) for k, v in batch.costs.items()}

    coarse, fine = slopes(2e-4), slopes(1e-4)
    return {name: (4 * fine[name] - coarse[name]) / 3 for name in fine}


def test_adjoint_equals_differences_and_forward_in_both_engines(case):
    fast, slow = case
    wrt = fast.loop.parameter_paths
    expected = differences(fast, wrt)
    for rollout in (fast, slow):
        adjoint, forward = rollout.value_and_gradient(wrt=wrt), rollout.jacobian(wrt=wrt)
        smooth = [name for name in adjoint.gradients if name != "worst"]  # whose peak is between steps
        assert rollout.value_and_gradient(wrt=wrt, costs=smooth).status == ("exact",)
        assert forward.status == "exact" or "the derivative of 'worst'" in forward.status
        assert adjoint.status == (forward.status,)
        assert len(forward.trajectory.events) > 1
        for name, gradient in adjoint.gradients.items():
            np.testing.assert_allclose(gradient, expected[name], rtol=1e-6, atol=1e-7)
        ends = np.array([adjoint.gradients[f"end{k}"] for k in range(len(forward.measures["end"]))])
        for found, name in ((ends, "end"), (adjoint.gradients["sum"][None], "sum")):
            np.testing.assert_allclose(found, forward.measures[name], rtol=1e-9, atol=1e-11)


def test_times_and_impulses_of_a_ball_have_their_closed_forms():
    loop = bouncing_ball()
    s = Signals.of(loop)
    measures = Measures(s, {"time": final(s.x[2]), "impulse": final(s.x[3])})
    rollout = build_rollout(loop, duration_s=2.0, **GRID, measures=measures)
    found = rollout.value_and_gradient(wrt=("height", "restitution", "gravity"))
    h, e, g = loop.parameter_values
    fall, powers = np.sqrt(2 * h / g), 1 + 2 * (e + e**2 + e**3)
    time = np.array([fall / (2 * h) * powers, fall * (2 + 4 * e + 6 * e**2), -fall / (2 * g) * powers])
    np.testing.assert_allclose(found.costs["time"], fall * powers, rtol=1e-11)
    np.testing.assert_allclose(found.gradients["time"], time, rtol=1e-9)
    sums, slope = 1 + e + e**2 + e**3, 1 + 2 * e + 3 * e**2
    speed = np.sqrt(2 * g * h)
    impulse = speed * (1 + e) * sums * np.array([1 / (2 * h), 0, 1 / (2 * g)])
    impulse[1] = speed * (sums + (1 + e) * slope)
    np.testing.assert_allclose(found.gradients["impulse"], impulse, rtol=1e-9)


def test_gradients_in_lanes_are_those_of_single_rollouts_whatever_the_neighbours():
    loop = graded(latch())
    rollout = build_rollout(loop, duration_s=5.0, **GRID, measures=measured(loop))
    rows = np.random.default_rng(5).uniform([0.5, 0.1], [1.5, 1.5], (11, 2))
    wrt = ("start", "inertia", "delay")
    whole = rollout.gradient_batch(("start", "delay"), rows, wrt=wrt, accuracy=False)
    slopes = rollout.slope_batch(("start", "delay"), rows, wrt=wrt, accuracy=False)
    assert set(whole.status) == set(slopes.status) == {"unchecked"}
    for i in (0, 4, 7, 10):
        alone = rollout.gradient_batch(("start", "delay"), rows[i : i + 1], wrt=wrt, accuracy=False)
        start, delay = rows[i]
        single = rollout.value_and_gradient({"start": start, "delay": delay}, wrt=wrt, accuracy=False)
        for name, gradient in whole.gradients.items():
            np.testing.assert_array_equal(alone.gradients[name][0], gradient[i])
            np.testing.assert_allclose(single.gradients[name], gradient[i], rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(slopes.slopes["sum"][i, 0], single.gradients["sum"], rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("steps", [1, 7, 60])
def test_checkpoints_change_no_bit_of_gradients_through_events(steps, many):
    loop = graded(moved_force())
    rollout = build_rollout(loop, duration_s=2.0, **GRID, measures=measured(loop))
    rows = np.linspace(0.5, 0.9, 5)[:, None]
    wrt, places = ("jump", "wall", "hold"), (0, 1, 2)

    def found():
        if many:
            return rollout.gradient_batch(("jump",), rows, wrt=wrt)
        return rollout.value_and_gradient(wrt=wrt)

    whole = found()
    engine = rollout.engines.adjoint(places, many=many)
    short = replace(engine, whole_bytes=0, segment_bytes=steps * engine.bytes_per_step)
    rollout.engines._made["adjoint", places, engine.lanes] = short
    again = found()
    for name, gradient in whole.gradients.items():
        np.testing.assert_array_equal(again.gradients[name], gradient)


def marked(loop):
    """A closed loop whose events only mark where its law is not smooth."""
    loop.events = [replace(rule, kink=True) for rule in loop.events]
    return loop


@pytest.mark.parametrize("backend", ["compiled", "interpreted"])
def test_what_grazes_or_coincides_is_told(backend):
    many = backend == "compiled"  # so that the code is that of the cases above

    def made(loop):
        signals = Signals.of(loop)
        measures = measured(loop) if many else Measures(signals, {"end": final(signals.x[0])})
        return build_rollout(loop, duration_s=1.9, **GRID, measures=measures, backend=backend)

    def status(rollout, **changes):
        wrt = rollout.loop.parameter_paths[: None if many else 2]
        found = rollout.value_and_gradient(changes, wrt=wrt, accuracy=False)
        assert rollout.jacobian(changes, wrt=wrt, accuracy=False).status == found.status[0]
        return found.status[0].split(":")[0].replace("unchecked", "exact")

    wall, balls = made(spring_wall()), made(two_balls())
    assert status(wall) == "exact"
    assert status(wall, start=-0.6 - 1e-11) == "grazing"
    assert status(wall, start=-0.6 + 1e-11) == "grazing"
    assert status(wall, start=-0.601) == "exact"
    assert status(wall, start=-0.599) == "exact"
    assert status(balls, second=1.01) == "exact"
    assert status(balls) == "exact"  # either may bounce first
    assert status(balls, second=1.0 + 1e-10) == "exact"
    assert status(made(bouncing_ball()), height=0.05) == "lost"
    assert status(made(marked(spring_wall())), start=-0.6 - 1e-11) == "exact"
    assert status(made(marked(two_balls()))) == "exact"


def told(rollout, costs, wrt, **changes):
    """Whether a gradient of some costs holds."""
    return rollout.value_and_gradient(changes, wrt=wrt, costs=costs).status[0].split(":")[0]


def clocked(backend, **changes):
    loop = clocks(**changes)
    s = Signals.of(loop)
    named = {"grown": final(s.x[0]), "summed": final(s.x[1]), "later": final(s.x[2])}
    measures = Measures(s, named, lambda r, _: {name: r[name] for name in named})
    return build_rollout(loop, duration_s=1.0, **GRID, measures=measures, backend=backend)


TIMES = ("first", "second")


@pytest.mark.parametrize("backend", ["compiled", "interpreted"])
def test_a_gradient_is_doubted_only_where_the_order_of_events_counts(backend):
    """The later of two times has no derivative where both are the same; what each does alone has one."""
    plain = clocked(backend)
    assert told(plain, ("grown", "summed"), TIMES) == "exact"
    assert told(plain, ("grown", "summed"), TIMES, second=0.5 + 4e-10) == "exact"
    assert told(plain, ("later",), TIMES) == "coincident"
    assert told(plain, ("later",), TIMES, second=0.501) == "exact"
    assert told(plain, ("later",), ("rate",)) == "exact"  # nothing moves
    turned = clocked(backend, gain=2.0, shift=0.3)  # twice and then more is not more and then twice
    assert told(turned, ("grown",), TIMES) == "coincident"
    assert told(turned, ("summed",), TIMES) == "exact"


@pytest.mark.parametrize("backend", ["compiled", "interpreted"])
def test_an_event_at_a_given_time_does_not_move_with_the_event_before_it(backend):
    """Its guard depends on time itself, and its step begins where the other event was."""
    found = clocked(backend, first=0.52, second=0.56).value_and_gradient(wrt=TIMES, costs=("summed",))
    np.testing.assert_allclose(found.gradients["summed"], [0, 0.5], atol=1e-9)


def test_two_references_that_end_at_one_instant_are_doubted_where_their_order_counts():
    """Between the ends only one of them asks for torque: a peak there depends on which end comes first."""
    given, together = small_scene(PLANAR), 0.1213
    ends = tuple(f"robots.{robot}.tips.tip.reference.duration" for robot in ("one", "two"))

    def told(cost, **changes):
        found = rollout.value_and_gradient(changes, wrt=ends, costs=(cost,), accuracy=False)
        return found.status[0].split(":")[0].replace("unchecked", "exact")

    loop = build_closed_loop(build_scene(given.scenario, dict.fromkeys(ends, together), source=given.source))
    s = Signals.of(loop)
    named = {"torque": peak(ca.fabs(s["joint_torque"])), "error": integral(ca.sumsqr(s["tip_error"]))}
    measures = Measures(s, named, lambda r, _: {name: ca.sumsqr(r[name]) for name in named})
    rollout = build_rollout(loop, duration_s=0.2, step_s=0.01, measures=measures, backend="interpreted")
    assert (told("torque"), told("error")) == ("coincident", "exact")
    assert told("torque", **{ends[0]: 0.1214}) == "exact"
    assert rollout.jacobian(wrt=ends).status.startswith("coincident")
    gain = ("robots.one.tips.tip.pid.kp",)
    gains = rollout.value_and_gradient(wrt=gain, costs=("torque",), accuracy=False)
    assert gains.status == ("unchecked",)  # neither end moves


def test_sensitivities_and_gradients_of_many_know_as_well_where_the_order_counts():
    plain, both = clocked("compiled"), [[0.5, 0.5], [0.5, 0.6], [0.71, 0.71 - 4e-10]]
    assert plain.jacobian(wrt=("rate",)).status == "exact"
    assert plain.jacobian(wrt=TIMES).status.startswith("coincident")
    for found in (plain.slope_batch(TIMES, both), plain.gradient_batch(TIMES, both)):
        assert [status.split(":")[0] for status in found.status] == ["coincident", "exact", "coincident"]
    each = ("grown", "summed")
    assert plain.gradient_batch(TIMES, both, costs=each).status == ("exact",) * 3
    quick = plain.gradient_batch(TIMES, both, costs=each, orders=False).status
    assert [status.split(":")[0] for status in quick] == ["coincident", "unchecked", "coincident"]


def test_thrusters_cut_off_at_one_instant_have_exact_derivatives():
    loop = pulses()
    rollout = build_rollout(loop, duration_s=1.0, **GRID, measures=measured(loop))
    wrt, smooth = loop.parameter_paths, ("sum", "end0", "end1", "end2", "end3")
    found, expected = rollout.value_and_gradient(wrt=wrt, costs=smooth), differences(rollout, wrt)
    assert [here.event for here in rollout.run().events] == [0, 1]
    assert found.status == ("exact",)
    for name in smooth:
        np.testing.assert_allclose(found.gradients[name], expected[name], rtol=1e-6, atol=1e-7)
    assert told(rollout, ("worst",), wrt) == "coincident"  # the speed peaks at the earlier of both


@pytest.mark.parametrize("backend", ["compiled", "interpreted"])
@pytest.mark.parametrize("first", [1.0, 1.0 - 4e-10, 1.0 + 4e-10])
def test_an_event_at_the_rollouts_end_is_doubted_where_parameters_move_it(backend, first):
    """On one side of the end it fires and changes the state, on the other it does not."""
    rollout = clocked(backend, first=first)
    assert told(rollout, ("grown",), TIMES) == "at the end"
    assert rollout.jacobian(wrt=TIMES).status.startswith("at the end: a small change may move the event")
    assert told(rollout, ("grown",), ("rate",)) == "exact"  # the time stays
    assert told(rollout, ("grown",), TIMES, first=0.99) == "exact"
    assert told(rollout, ("grown",), TIMES, first=1.01) == "exact"


def periodic(**changes):
    """A clock that is set at each tick, and counts; a rate that grows with each."""
    return Hybrid(
        {"period": 0.25, "rate": 1.0} | changes,
        lambda period, rate: ([0, 0, 0], [period, rate]),
        lambda t, x, c: [0, 0, c[1] * x[1]],
        lambda t, x, c: [(1, t - x[0] - c[0])],
        lambda t, x, c: [(t, x[1] + 1, x[2])],
        [Rule("tick")],
    ).loop()


def test_a_clocks_events_move_with_its_period_alone():
    loop = periodic()
    measures = Measures(s := Signals.of(loop), {"end": final(s.x[2])}, lambda r, _: {"end": r["end"]})
    rollout = build_rollout(loop, duration_s=1.0, **GRID, measures=measures, backend="interpreted")
    assert rollout.value_and_gradient(wrt=("rate",)).status == ("exact",)
    assert rollout.value_and_gradient(wrt=("period",)).status[0].startswith("at the end")
