"""Thin shapes that cross within one step, by turning fast: no contact is missed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import build_rollout
from spacerobot.scene import Scene
from tests.oracles.balls import body, scene

STEP, STEPS = 0.05, 4
LENGTH, RADII = 1.0, 0.005
CLEAR = 2e-4
"""Depth or gap from which a case counts [m]: what the steps integrate is wrong by less."""
PATHS = [
    *(f"robots.one.base.{key}.{i}" for key in ("velocity", "spin_deg", "rotation_deg") for i in range(3)),
    *(f"target.base.position.{i}" for i in range(3)),
]


def drawn(count: int) -> np.ndarray:
    """Velocities [m/s], spins and attitudes [deg] of a rod, and a ball in its way or just aside of it [m]."""
    rng = np.random.default_rng(7)
    velocity, spin = 3 * rng.normal(size=(2, count, 3))
    spin *= (rng.uniform(2, 12, count) / np.linalg.norm(spin, axis=1))[:, None]
    turn, when = rng.uniform(-1.5, 1.5, (count, 3)), rng.uniform(0.01, STEP * STEPS - 0.01, count)
    along = (Rotation.from_rotvec(spin * when[:, None]) * Rotation.from_euler("xyz", turn)).apply([0, 0, 1])
    place = velocity * when[:, None] + along * LENGTH * rng.uniform(-0.5, 0.5, (count, 1))
    aside = RADII * rng.normal(size=(count, 3))
    return np.hstack([velocity, np.rad2deg(spin), np.rad2deg(turn), place + aside])


def crossing(row: np.ndarray) -> Scene:
    """A rod of 2 mm, which turns freely, and a ball of 3 mm at rest; a touch hardly acts on them."""
    base = {
        key: row[3 * i : 3 * i + 3].tolist() for i, key in enumerate(("velocity", "spin_deg", "rotation_deg"))
    }
    return scene(
        {
            "robots": {"one": body("one", 2.0, base)},
            "target": body("other", 3.0, {"position": row[9:].tolist()}),
            "pads": {
                "rod": {"link": "one/body", "kind": "capsule", "radius": 0.002, "length": LENGTH},
                "ball": {"link": "target/body", "kind": "sphere", "radius": 0.003},
            },
            "contacts": {"bump": {"between": ["rod", "ball"], "stiffness": 1e-3, "exponent": 1}},
            "simulation": {"duration": STEP * STEPS, "output_step": STEP, "step": STEP},
        }
    )


def gap(row: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Of the rod's line and the ball's centre, less both radii; a ball's inertia keeps its spin constant."""
    velocity, spin, turn, place = row.reshape(4, 3)
    start = Rotation.from_euler("xyz", turn, degrees=True)
    turned = Rotation.from_rotvec(np.outer(time, np.deg2rad(spin))) * start
    along, centre = turned.apply([0, 0, 1]), np.outer(time, velocity)
    beside = np.clip(np.sum((place - centre) * along, axis=1), -LENGTH / 2, LENGTH / 2)
    return np.linalg.norm(centre + beside[:, None] * along - place, axis=1) - RADII


def first_touch(row: np.ndarray) -> tuple[float, float]:
    """The least gap, and when the first touch is."""
    time = np.linspace(0, STEP * STEPS, 801)
    coarse = gap(row, time)
    k = int(np.argmin(coarse))
    fine = np.linspace(time[max(k - 1, 0)], time[min(k + 1, 800)], 101)
    own = gap(row, fine)
    time, found = (time, coarse) if coarse.min() < 0 else (fine, own)
    return float(min(own.min(), coarse.min())), float(time[np.argmax(found < 0)])


def compare(rows: np.ndarray, found: list[float | None]) -> int:
    """How many rods touch; each of them is found, and no other."""
    touches = 0
    for row, time in zip(rows, found, strict=True):
        least, when = first_touch(row)
        if gap(row, np.zeros(1))[0] <= 0 or abs(least) < CLEAR:
            continue
        assert (time is not None) == (least < 0), (row.tolist(), least)
        if time is not None:
            assert time == pytest.approx(when, abs=3 * STEP * STEPS / 800)
            touches += 1
    return touches


@pytest.mark.compiler
def test_no_crossing_of_a_thin_rod_is_missed_in_lanes():
    rows = drawn(600)
    loop = build_closed_loop(crossing(rows[0]))
    rollout = build_rollout(loop, duration_s=STEP * STEPS, output_step_s=STEP, step_s=STEP, many=True)
    events = rollout.batch(PATHS, rows).events
    pairs = zip(events.count, events.time_s, strict=True)
    times = [float(when[0]) if count else None for count, when in pairs]
    assert compare(rows, times) > 300


def test_nor_by_the_interpreted_engine_nor_by_pinocchios():
    """Of crossings of which neither the guards' cubics show anything nor looks each hundredth of a second."""
    rows = drawn(600)[[291, 372, 407, 508]]
    loop = build_closed_loop(crossing(rows[0]))
    steps = {"duration_s": STEP * STEPS, "output_step_s": STEP, "step_s": STEP}
    rollout = build_rollout(loop, **steps, backend="interpreted")
    runs = [rollout.run(dict(zip(PATHS, row, strict=True))).events for row in rows]
    assert compare(rows, [run[0].time_s if run else None for run in runs]) == len(rows)
    told = [simulate(crossing(row), rtol=1e-8, atol=1e-10).happened for row in rows[:2]]
    times = [next((event.time_s for event in events if event.kind == "touched"), None) for events in told]
    assert compare(rows[:2], times) == 2
