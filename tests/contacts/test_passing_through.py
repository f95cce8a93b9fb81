"""Bodies neither miss each other, however fast they are for the step, nor pass into each other unnoticed."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import simulate as checked_by
from spacerobot.result.trust import least_between, warning
from spacerobot.rollout import build_rollout
from spacerobot.scene import Scene
from spacerobot.simulation import simulate
from tests.oracles.balls import body, scene

STIFF = {"stiffness": 1e7, "exponent": 1, "longest_step": 1e-4}
RADII = 0.2
SPEED, DISTANCE, OFFSET = "robots.one.base.velocity.0", "target.base.position.0", "target.base.position.1"


def flight(speed: float, distance: float, offset: float, step: float = 1.0, **contact: float) -> Scene:
    """A ball that flies past another for 1 s, or meets it."""
    return scene(
        {
            "robots": {"one": body("one", 2.0, {"velocity": [speed, 0, 0]})},
            "target": body("other", 3.0, {"position": [distance, offset, 0]}),
            "contacts": {"bump": {"between": ["one/body", "target/body"]} | STIFF | contact},
            "simulation": {"duration": 1, "output_step": step, "step": step},
        }
    )


def flights(count: int) -> np.ndarray:
    """Speeds, distances and offsets; half of the balls meet."""
    draws = np.random.default_rng(3)
    speed = 10 ** draws.uniform(0, 3, count)
    distance = RADII + draws.uniform(0.02, 0.95, count) * speed
    return np.column_stack([speed, distance, draws.uniform(0.01, 2 * RADII, count)])


def meets_at(row: np.ndarray) -> float | None:
    """When the balls meet: |d - v t| is the sum of the radii."""
    speed, distance, offset = row
    return None if offset >= RADII else float(distance - np.sqrt(RADII**2 - offset**2)) / speed


def agree(found: list[float | None], rows: np.ndarray) -> None:
    expected = [meets_at(row) for row in rows]
    assert [time is None for time in found] == [time is None for time in expected]
    for time, wanted in zip(found, expected, strict=True):
        assert time is None or time == pytest.approx(wanted, abs=1e-9)


@pytest.fixture(scope="module")
def loop():
    return build_closed_loop(flight(90.0, 45.0, 0.1), vary=[OFFSET])


@pytest.mark.compiler
def test_no_step_is_too_long_to_find_a_contact_in_lanes(loop):
    rows = flights(200)
    rollout = build_rollout(loop, duration_s=1.0, output_step_s=1.0, step_s=1.0)
    batch = rollout.batch([SPEED, DISTANCE, OFFSET], rows)
    first, kinds = batch.events.event[:, 0], [rule.kind for rule in loop.events]
    times = batch.events.time_s[:, 0]
    assert {kinds[event] for event in first if event >= 0} == {"touched"}
    agree([None if event < 0 else time for event, time in zip(first, times, strict=True)], rows)


def test_no_step_is_too_long_interpreted(loop):
    rows = flights(6)
    rollout = build_rollout(loop, duration_s=1.0, output_step_s=1.0, step_s=1.0, backend="interpreted")
    runs = [rollout.run(dict(zip([SPEED, DISTANCE, OFFSET], row, strict=True))) for row in rows]
    agree([run.events[0].time_s if run.events else None for run in runs], rows)


def test_no_step_is_too_long_for_the_second_engine():
    rows = flights(4)
    runs = [checked_by(flight(*row), output_step_s=1.0).happened for row in rows]
    agree([next((e.time_s for e in run if e.kind == "touched"), None) for run in runs], rows)


@pytest.mark.parametrize(("stiffness", "trusted"), [(1e5, True), (1e3, False)])
def test_a_contact_that_is_too_soft_is_not_trusted(stiffness, trusted):
    met = flight(2.0, 0.3, 0.0, step=5e-3, stiffness=stiffness)
    status = simulate(met, backend="interpreted").summary["status"]
    assert (status["state"], status["open"], status["trusted"]) == ("completed", [], trusted)
    if trusted:
        assert warning(status) is None
    else:
        assert "contact bump is 6" in warning(status)
        assert "smaller shape has 100 mm" in warning(status)
        assert "take a stiffer contact" in warning(status)


def test_the_depth_between_samples_is_found():
    """A parabola is met exactly; at an end, or where time stands still, the sample is taken."""
    time = np.array([0.0, 0.4, 1.0, 1.3, 2.0])
    assert least_between(2 * (time - 0.9) ** 2 - 0.3, time) == pytest.approx(-0.3, abs=1e-14)
    assert least_between(time - 1, time) == -1
    assert least_between(np.array([1.0, -1.0, -1.0, 3.0]), np.array([0.0, 1.0, 1.0, 2.0])) == -1


@pytest.mark.parametrize("offset", [0.05, 0.13])
def test_derivatives_through_steps_that_were_shortened(offset):
    """One step would pass both balls by each other, and no guard shows it; how they part depends on it."""
    loop = build_closed_loop(flight(400.0, 320.0, offset))
    rollout = build_rollout(loop, duration_s=1.0, step_s=1.0, output_step_s=1.0, backend="interpreted")
    at = {OFFSET: offset}
    found = rollout.jacobian(at, wrt=[OFFSET], outputs=["body_position"], accuracy=False)
    assert [loop.events[one.event].kind for one in found.trajectory.events] == ["touched", "parted"]
    slope = found.outputs["body_position"][-1, ..., 0]
    wide, narrow = (
        np.subtract(*(rollout.run({OFFSET: offset + s * h}).outputs["body_position"][-1] for s in (1, -1)))
        / (2 * h)
        for h in (2e-5, 1e-5)
    )
    difference = (4 * narrow - wide) / 3
    assert np.abs(difference).max() > 10  # m per m
    np.testing.assert_allclose(slope, difference, atol=1e-5 * np.abs(difference).max())
