"""The list of events and the outcome, as a summary tells them."""

from dataclasses import dataclass

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.result.events import HEADINGS, build_events, event_rows, outcome_of
from tests.oracles.free_bodies import DEEP, FLAT, free_bodies
from tests.oracles.hybrid import roll


@dataclass
class Fired:
    time_s: float
    event: int
    before: np.ndarray
    after: np.ndarray
    switches: np.ndarray


def told(scene, duration):
    loop = build_closed_loop(scene)
    run = roll(loop, duration)
    names = [rule.name for rule in loop.events]
    fired = [
        Fired(one.time, names.index(one.name), one.before, one.after, one.c_after[list(loop.switches)])
        for one in run.events
    ]
    return build_events(scene, loop, fired)


@pytest.mark.parametrize("bases", [FLAT, DEEP], ids=["planar", "spatial"])
def test_a_capture_is_told_with_what_it_took(tmp_path, bases):
    phases = {"approach": {"until": {"captured": ["left"]}}, "carry": {"until": {"time": 0.2}, "next": "end"}}
    scene = free_bodies(tmp_path, bases, {"kind": "weld", "capture": {"distance": 0.05}}, phases=phases)
    events = told(scene, 3.0)
    assert [event["kind"] for event in events] == ["captured", "phase", "end"]
    captured = events[0]
    assert captured["who"] == "left"
    assert captured["energy_lost_j"] > 0
    assert list(captured["impulses_n_s"]) == ["left"]
    assert all(event["momentum_change"] < 1e-12 for event in events)
    assert np.linalg.norm(captured["relative_velocity_m_s"]) > 0.01
    assert np.linalg.norm(captured["relative_spin_rad_s"]) > 0.1
    assert outcome_of(scene, events) == "captured"
    rows = event_rows(events)
    assert rows[0][1] == "left captured"
    assert [row[1] for row in rows[1:]] == ["carry begins", "carry ends the simulation"]
    assert all(len(row) == len(HEADINGS) for row in rows)


def test_outcomes(tmp_path):
    grasp = {"kind": "compliant", "capture": {"distance": 1e-3}}
    scene = free_bodies(tmp_path, FLAT, grasp)
    assert outcome_of(scene, told(scene, 2.0)) == "missed"
    assert outcome_of(scene, [{"kind": "touched", "who": "pads"}]) == "collided"
    grasp = {"kind": "compliant", "capture": {"at": 0.2}, "release": {"force": 0.2}}
    scene = free_bodies(tmp_path, FLAT, grasp)
    events = told(scene, 3.0)
    assert [event["kind"] for event in events] == ["captured", "slipped"]
    assert events[1]["energy_lost_j"] > 0
    assert outcome_of(scene, events) == "broke away"
    grasp = {"kind": "weld", "begins": "closed"}
    scene = free_bodies(tmp_path, FLAT, grasp)
    assert outcome_of(scene, ()) is None
