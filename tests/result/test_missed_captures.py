"""Why a docking was missed, of two bodies that drift past each other."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.result.events import outcome_of
from spacerobot.scene.envelope_checks import mating_warnings
from tests.oracles.free_bodies import DEEP, FLAT, free_bodies
from viz.page.events import event_data

WIDE = {"distance": 0.2, "misalignment_deg": 90, "closing_speed": 1, "lateral_speed": 1, "spin_deg": 90}


def missed(folder, bases, **capture):
    """Result of a grasp with an envelope, and why it was missed."""
    simulation = {"duration": 3.0, "step": 0.01, "output_step": 0.01}
    scene = free_bodies(folder, bases, {"kind": "compliant", "capture": capture}, simulation=simulation)
    result = sr.simulate(scene, backend="interpreted")
    return result, result.summary["missed"]["left"]


@pytest.mark.parametrize("bases", [FLAT, DEEP], ids=["planar", "spatial"])
def test_a_tip_that_never_comes_near_is_told_by_its_closest_approach(tmp_path, bases):
    result, why = missed(tmp_path, bases, distance=1e-4)
    gaps = np.linalg.norm(result.data.grasp_gap.sel(grasp="left"), axis=1)
    closest = why["closest"]
    assert closest["distance"] == pytest.approx(gaps.min())
    assert closest["time_s"] == pytest.approx(result.data.time.values[gaps.argmin()])
    angle = np.linalg.norm(result.data.grasp_misalignment.sel(grasp="left")[gaps.argmin()])
    assert closest["misalignment_deg"] == pytest.approx(np.degrees(angle))
    (violated,) = why["violated"]
    assert violated == {
        "limit": "distance",
        "allowed": 1e-4,
        "value": pytest.approx(gaps.min()),
        "from_s": 0.0,
        "for_s": pytest.approx(3.0),
    }
    assert why["words"].startswith("never within 0.1 mm in 3 s; closest approach ")
    assert ("missed left", why["words"]) in result.headline()
    assert [closest["time_s"], f"left missed: {why['words']}", "slipped"] in event_data(result)["marks"]


@pytest.mark.parametrize("bases", [FLAT, DEEP], ids=["planar", "spatial"])
def test_relative_speeds_are_those_of_the_gap_in_the_mating_frame(tmp_path, bases):
    """Rate of the gap as the target sees it, by differences of samples along its axes."""
    result, why = missed(tmp_path, bases, **{**WIDE, "distance": 1e-4})
    data = result.data
    k = int(np.linalg.norm(data.grasp_gap.sel(grasp="left"), axis=1).argmin())
    turns = [pin.Quaternion(*np.roll(q, 1)).matrix() for q in data.body_orientation.sel(body="target").values]
    seen = np.array([r.T @ g for r, g in zip(turns, data.grasp_gap.sel(grasp="left").values, strict=True)])
    rate = (seen[k + 1] - seen[k - 1]) / (data.time.values[k + 1] - data.time.values[k - 1])
    assert why["closest"]["closing_speed"] == pytest.approx(abs(rate[0]), abs=1e-4)
    assert why["closest"]["lateral_speed"] == pytest.approx(np.linalg.norm(rate[1:]), abs=1e-4)


@pytest.mark.parametrize("limit", ["closing_speed", "lateral_speed", "spin_deg"])
def test_the_limit_that_was_violated_is_named(tmp_path, limit):
    allowed = {"closing_speed": 1e-3, "lateral_speed": 1e-4, "spin_deg": 1.0}[limit]
    result, why = missed(tmp_path, DEEP, **WIDE | {limit: allowed})
    assert result.summary["outcome"] == "missed"
    assert [one["limit"] for one in why["violated"]] == [limit]
    assert why["violated"][0]["value"] > allowed
    assert why["violated"][0]["from_s"] == 0.0


def test_a_limit_violated_for_a_part_of_the_way_says_how_long_and_how_long_the_stay_inside_was(tmp_path):
    """The lateral speed by differences of the gap along the target's axes; the limit is between values."""
    data = missed(tmp_path, DEEP, **{**WIDE, "distance": 1e-4})[0].data
    turns = [pin.Quaternion(*np.roll(q, 1)).matrix() for q in data.body_orientation.sel(body="target").values]
    seen = np.array([r.T @ g for r, g in zip(turns, data.grasp_gap.sel(grasp="left").values, strict=True)])
    speed = np.linalg.norm(np.gradient(seen, data.time.values, axis=0)[:, 1:], axis=1)
    allowed = float(speed.min() + 0.6 * np.ptp(speed))
    over = 0.01 * np.count_nonzero(speed > allowed)
    assert 0.3 < over < 2.7
    wide = {**WIDE, "distance": 10, "lateral_speed": allowed, "dwell": 30}
    _, never = missed(tmp_path, DEEP, **{**wide, "spin_deg": 1e-3})
    lateral = next(one for one in never["violated"] if one["limit"] == "lateral_speed")
    assert (lateral["from_s"], lateral["for_s"]) == (0.0, pytest.approx(over, abs=0.05))
    _, why = missed(tmp_path, DEEP, **wide)
    assert why["inside_s"] == pytest.approx(3 - over, abs=0.05)
    assert why["violated"] == []
    assert "the simulation ended before the dwell was over" in why["words"]


def test_a_dwell_that_is_too_long_names_what_ended_the_stay(tmp_path):
    _, why = missed(tmp_path, FLAT, distance=0.06, dwell=30.0)
    assert 0.5 < why["inside_s"] < 3
    assert "of the dwell of 30 s" in why["words"]
    assert [one["limit"] for one in why["violated"]] in (["distance"], [])


def test_what_is_captured_is_not_missed_and_what_is_let_go_at_once_is_told(tmp_path):
    scene = free_bodies(tmp_path, FLAT, {"kind": "compliant", "capture": {"at": 0.2}})
    assert "missed" not in sr.simulate(scene, backend="interpreted").summary
    kinds = [("captured", 1.0), ("released", 1.0)]
    events = [{"kind": kind, "who": "left", "time_s": time} for kind, time in kinds]
    assert outcome_of(scene, events) == "released at once"
    events[1]["time_s"] = 1.5
    assert outcome_of(scene, events) == "captured"


@pytest.mark.parametrize(("turned", "warns"), [(0.0, False), (3.0, False), (180.0, True)])
def test_a_reference_that_contradicts_the_envelope_is_warned_of(tmp_path, turned, warns):
    grasp = {"kind": "compliant", "capture": {"distance": 0.01, "misalignment_deg": 5}}
    scene = free_bodies(tmp_path, DEEP, grasp)
    led = {
        "robots.one.tips.tip.reference": {"kind": "rendezvous", "frame": "mate", "mated_deg": [0, 0, turned]}
    }
    found = mating_warnings(sr.load_scene(scene.source, led))
    assert bool(found) == warns
    assert not found or "180 deg from grasps.left.capture.mated_deg [0, 0, 0]" in found[0]
