"""Many rollouts: lanes, threads, batch sizes, lost lanes, progress and cancellation."""

from __future__ import annotations

import heapq
import threading
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spacerobot.common.errors import SpaceRobotError
from spacerobot.rollout import Measures, Signals, build_rollout, final, integral, peak
from spacerobot.rollout.batch import Control, Samples, fair_pieces, run_batch, run_gradients

PATHS = ("arm.kp", "arm.kd", "rotor.spin")
GRID = {"duration_s": 2.0, "step_s": 0.01, "output_step_s": 0.2}
LOST = 5


@pytest.fixture(scope="module")
def measures(loop):
    s = Signals.of(loop)
    named = {
        "ise": integral(ca.sumsqr(s["error"])),
        "worst": peak(ca.fabs(s["torque"])),
        "end": final(s["omega"]),
    }
    return Measures(s, named, lambda r, p: {"sum": r["ise"] + 0.1 * r["worst"] + p["arm.kp"]})


@pytest.fixture(scope="module")
def rollout(loop, measures):
    return build_rollout(loop, **GRID, measures=measures)


@pytest.fixture(scope="module")
def values():
    rows = np.random.default_rng(1).uniform(0.5, 4.0, (21, 3))
    rows[LOST, :2] = -1e9
    return rows


@pytest.fixture(scope="module")
def whole(rollout, values):
    return rollout.batch(PATHS, values, outputs=("torque", "error"), states=True, threads=2)


def same(batch, other, rows):
    np.testing.assert_array_equal(batch.state, other.state[rows])
    np.testing.assert_array_equal(batch.costs["sum"], other.costs["sum"][rows])
    for name, measure in batch.measures.items():
        np.testing.assert_array_equal(measure, other.measures[name][rows])


def test_where_many_are_wanted_lanes_alone_are_compiled(loop, values, monkeypatch, tmp_path):
    monkeypatch.setenv("SPACEROBOT_CACHE_DIR", str(tmp_path))
    many = build_rollout(loop, **GRID, many=True, backend="compiled")
    many.batch(PATHS, values)
    (library,) = (tmp_path / "compiled").iterdir()
    assert library == many.engines.batch.loops.library.path
    assert many.engines.batch.lanes == many.engines.toolchain.lanes > 1


def test_lanes_equal_single_rollouts(rollout, values, whole):
    assert whole.lanes == rollout.engines.toolchain.lanes
    for i in (0, 1, 7, 8, 20):
        one = rollout.run(dict(zip(PATHS, values[i], strict=True)))
        np.testing.assert_allclose(whole.state[i], one.state, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(whole.outputs["error"][i], one.outputs["error"], rtol=1e-12, atol=1e-12)
        for name in one.measures:
            np.testing.assert_allclose(whole.measures[name][i], one.measures[name], rtol=1e-12)
        assert whole.costs["sum"][i] == pytest.approx(one.costs["sum"], rel=1e-12)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("rows", [slice(0, 21), slice(3, 4), slice(2, 11), slice(20, 21)])
def test_no_bit_depends_on_lane_threads_or_size(rollout, values, whole, threads, rows):
    same(rollout.batch(PATHS, values[rows], states=True, threads=threads), whole, rows)


def test_order_of_rows_does_not_matter(rollout, values, whole):
    order = np.random.default_rng(2).permutation(len(values))
    same(rollout.batch(PATHS, values[order], states=True), whole, order)


def test_a_lost_lane_leaves_its_neighbours_untouched(rollout, values, whole):
    healthy = values.copy()
    healthy[LOST] = 1.0
    others = np.arange(len(values)) != LOST
    without = rollout.batch(PATHS, healthy, states=True)
    np.testing.assert_array_equal(without.state[others], whole.state[others])
    np.testing.assert_array_equal(without.costs["sum"][others], whole.costs["sum"][others])
    assert np.flatnonzero(np.isfinite(whole.diverged_at_s)).tolist() == [LOST]
    assert np.isnan(whole.costs["sum"][LOST])
    assert np.isnan(whole.measures["end"][LOST]).all()
    assert np.isfinite(whole.state[LOST, 0]).all()
    assert np.isnan(whole.state[LOST, -1]).all()


def test_a_divergence_on_the_way_stops_where_the_single_rollout_stops(rollout, values):
    rows = values[:5].copy()
    rows[2] = (-200.0, -200.0, 1.0)
    many, one = rollout.batch(PATHS, rows, states=True), rollout.run(dict(zip(PATHS, rows[2], strict=True)))
    assert one.status == "diverged"
    assert 0 < one.diverged_at_s < 2.0
    assert many.diverged_at_s[2] == one.diverged_at_s
    assert np.isfinite(many.state[2]).all(axis=1).sum() == len(one.time)


def test_interpreted_batch_gives_the_same(loop, measures, values, whole):
    slow = build_rollout(loop, **GRID, measures=measures, backend="interpreted").batch(PATHS, values[3:7])
    assert (slow.backend, slow.lanes, slow.threads) == ("interpreted", 1, slow.threads)
    np.testing.assert_allclose(slow.costs["sum"], whole.costs["sum"][3:7], rtol=1e-11)
    np.testing.assert_array_equal(slow.diverged_at_s, whole.diverged_at_s[3:7])


def test_progress_is_told_and_can_cancel(rollout, values):
    many, reports = np.tile(values[:1], (3000, 1)), []
    batch = rollout.batch(PATHS, many, threads=1, progress=lambda report: reports.append(report))
    assert not batch.cancelled
    assert reports[-1].done == reports[-1].total == 3000
    assert [r.done for r in reports] == sorted(r.done for r in reports)
    assert reports[-1].rate > 0
    batch = rollout.batch(PATHS, many, threads=1, progress=lambda _: False)
    assert batch.cancelled
    assert 0 < batch.done.sum() < 3000
    assert np.isfinite(batch.costs["sum"][batch.done]).all()
    assert np.isnan(batch.costs["sum"][~batch.done]).all()


@settings(deadline=None, max_examples=200, derandomize=True)
@given(
    total=st.integers(0, 700),
    lanes=st.sampled_from([1, 4, 8]),
    longest=st.integers(1, 90),
    threads=st.integers(1, 9),
)
def test_pieces_are_whole_groups_and_no_thread_waits_for_more_than_one(total, lanes, longest, threads):
    pieces = list(fair_pieces(total, lanes, longest, threads))
    assert [i for piece in pieces for i in range(piece.start, piece.stop)] == list(range(total))
    assert all((piece.stop - piece.start) % lanes == 0 for piece in pieces[:-1])
    groups, busy = -(-total // lanes), [0] * threads
    for piece in pieces:  # whichever thread is free first takes the next one
        mine = -(-(piece.stop - piece.start) // lanes)
        assert mine <= min(longest, -(-groups // threads))
        heapq.heapreplace(busy, busy[0] + mine)
    assert max(busy) == -(-groups // threads)
    assert max(busy) - min(busy) <= 1


@dataclass(frozen=True)
class Meeting:
    """An engine whose first calls wait until every thread has one."""

    engine: object
    met: threading.Barrier
    kernel: object
    lanes: int
    sizes: list
    backend: str = "compiled"

    def rollouts(self, p, *arguments):
        self.sizes.append(len(p))
        if len(self.sizes) <= self.met.parties:
            self.met.wait()
        self.engine.rollouts(p, *arguments)

    def gradients(self, p, *arguments):
        self.sizes.append(len(p))
        if len(self.sizes) <= self.met.parties:
            self.met.wait()
        self.engine.gradients(p, *arguments)


@pytest.mark.parametrize(("rows", "threads"), [(48, 2), (50, 2), (48, 6), (17, 3)])
def test_a_population_keeps_every_thread_busy(rollout, values, rows, threads):
    if rollout.engines.batch.lanes * threads > 48:
        pytest.skip("wider vectors than this population is for")
    engine, p = rollout.engines.batch, rollout.rows(PATHS, np.resize(values, (rows, 3)))
    meeting = Meeting(engine, threading.Barrier(threads, timeout=30), engine.kernel, engine.lanes, [])
    done = run_batch(meeting, rollout.grid, p.__getitem__, rows, Samples(), Control(threads))
    assert sum(meeting.sizes) == rows
    assert max(meeting.sizes) <= engine.lanes * -(-rows // (engine.lanes * threads))
    again = rollout.batch(PATHS, np.resize(values, (rows, 3)), threads=1)
    np.testing.assert_array_equal(done.raw.cost[:, 0], again.costs["sum"])


@pytest.mark.parametrize("rows", [1, 16, 17, 23])
def test_gradients_keep_every_thread_busy_and_no_bit_depends_on_it(rollout, values, rows):
    engine, p = rollout.engines.adjoint((0, 1), many=True), rollout.rows(PATHS, np.resize(values, (rows, 3)))
    threads = min(2, -(-rows // engine.lanes))
    meeting = Meeting(engine, threading.Barrier(threads, timeout=30), engine.kernel, engine.lanes, [])
    seed = np.ones((rows, 1))
    _, found = run_gradients(meeting, rollout.grid, p, seed, Control(threads))
    assert sum(meeting.sizes) == rows
    one = rollout.gradient_batch(PATHS, np.resize(values, (rows, 3)), wrt=PATHS[:2], threads=1)
    np.testing.assert_array_equal(found, one.gradients["sum"])


def test_an_error_in_a_thread_is_raised_and_the_rest_left_out(rollout, values):
    class Broken(Meeting):
        def rollouts(self, p, *arguments):
            self.sizes.append(len(p))
            raise OSError("no memory")

    engine = rollout.engines.batch
    broken = Broken(engine, threading.Barrier(1), engine.kernel, engine.lanes, [])
    p = rollout.rows(PATHS, np.tile(values[:1], (20_000, 1)))
    with pytest.raises(OSError, match="no memory"):
        run_batch(broken, rollout.grid, p.__getitem__, len(p), Samples(), Control(2))
    assert len(broken.sizes) < 20


def test_an_event_cancels(rollout, values):
    event = threading.Event()
    event.set()
    batch = rollout.batch(PATHS, np.tile(values[:1], (5000, 1)), stop=event)
    assert batch.cancelled
    assert batch.done.sum() < 5000


def test_wrong_shapes_and_names_are_told(rollout):
    with pytest.raises(SpaceRobotError, match=r"shape \(1, 2\), allowed: \(N, 3\)"):
        rollout.batch(PATHS, [[1.0, 2.0]])
    with pytest.raises(SpaceRobotError, match="no output 'eror', did you mean error"):
        rollout.batch(PATHS, np.ones((2, 3)), outputs=("eror",))
    assert rollout.batch(PATHS, np.empty((0, 3))).costs["sum"].shape == (0,)
