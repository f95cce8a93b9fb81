"""The page tells grips from contacts: arrows, rings around tips that hold, and the moment of capture."""

import numpy as np
import pytest

from spacerobot.result.result import Result
from viz.figures.storyboard import chosen
from viz.page.animation import animation
from viz.page.page import animation_page
from viz.recording.record import frames

VIOLET = np.array([0xC7, 0x7D, 0xFF])
ORANGE = np.array([0xFF, 0x9D, 0x2E])
READY = "document.body?.dataset.ready === 'true'"


def _pictures(browser, path, result, times):
    """The scene, right of what is told, at each time."""
    path.write_text(animation_page(result), encoding="utf-8")
    browser.open(f"{path.as_uri()}#t=0&look=all&layers=names traces magnifier")
    browser.wait_for(READY)
    for time in times:
        browser.evaluate(f"location.hash = '#t={time:.3f}'")
        browser.wait_for(f"document.body.dataset.time === '{time:.3f}'")
        yield browser.picture()[60:500, 250:]
    assert browser.errors == []


def test_contact_forces_are_arrows_of_their_own(browser, bounce, tmp_path):
    pictures = _pictures(browser, tmp_path / "page.html", bounce, (1.0, 2.17))
    before, touching = ((np.abs(picture - VIOLET).max(axis=2) < 12).sum() for picture in pictures)
    assert before == 0
    assert touching > 60
    named = "[...document.querySelectorAll('label')].map((label) => label.textContent)"
    assert "contact forces" in browser.evaluate(named)
    assert "grip forces on the object" not in browser.evaluate(named)


def test_a_touch_between_two_frames_is_shown(bounce):
    begin = int(np.argmax(bounce.data.contact_normal_force.values[:, 0]))
    data = bounce.data.copy(deep=True)
    kept = np.arange(data.sizes["time"]) == begin
    data["contact_force"] = data.contact_force * kept[:, None, None]
    payload = animation(Result(bounce.scenario, data, bounce.summary))
    contacts = payload["runs"][0]["contacts"]
    greatest = np.linalg.norm(contacts["forces"], axis=-1).max()
    assert greatest == pytest.approx(np.linalg.norm(data.contact_force.values, axis=-1).max(), rel=1e-6)
    assert payload["greatest_force"] == pytest.approx(greatest, rel=1e-6)


def test_grasps_hold_from_capture_to_release(docked, paper):
    run = animation(docked)["runs"][0]
    (capture,), (release,) = (
        [event["time_s"] for event in docked.summary["events"] if event["kind"] == kind]
        for kind in ("captured", "released")
    )
    time, held = run["time"], run["grips"]["held"][:, 0]
    clear = np.minimum(np.abs(time - capture), np.abs(time - release)) > 1e-6
    np.testing.assert_array_equal(held[clear], ((time > capture) & (time < release))[clear])
    assert run["grips"]["captures"] == [[capture]]
    always = animation(paper)["runs"][0]["grips"]
    assert always["held"].all()
    assert always["captures"] == [[], []]


def test_the_moment_of_capture_flashes_and_then_the_tip_is_ringed(browser, docked, tmp_path):
    (capture,) = (event["time_s"] for event in docked.summary["events"] if event["kind"] == "captured")
    times = capture - 0.05, capture + 0.05, capture + 0.55
    shown = list(_pictures(browser, tmp_path / "page.html", docked, times))
    white = [(picture.min(axis=2) > 200).sum() for picture in shown]
    assert white[1] > white[0] + 20
    assert white[2] > white[0]
    struck = [(np.abs(picture - ORANGE).max(axis=2) < 12).sum() for picture in shown]  # the impulse
    assert (struck[0], struck[2]) == (0, 0)
    assert struck[1] > 40


def test_impulses_of_rigid_captures_are_those_of_the_summary(docked, paper):
    grips = animation(docked)["runs"][0]["grips"]
    (event,) = (event for event in docked.summary["events"] if event["kind"] == "captured")
    assert grips["impulses"] == [[[event["time_s"], *event["impulses_n_s"]["left"]]]]
    assert grips["greatest"] == pytest.approx(np.linalg.norm(event["impulses_n_s"]["left"]))
    assert animation(paper)["runs"][0]["grips"]["impulses"] == []


def test_a_recording_shows_contact_forces_and_says_so(bounce):
    film = frames(bounce, rate_hz=100, size_px=(480, 300))
    times = bounce.data.time.values[film.motion.rows]
    violet = [
        (
            np.abs(
                np.asarray(film.picture(int(np.searchsorted(times, time)))).astype(int) - (0x7B, 0x3F, 0xB5)
            ).max(axis=2)
            < 25
        ).sum()
        for time in (1.0, 2.17)
    ]
    assert violet[0] == 0
    assert violet[1] > 10


def test_the_camera_shows_the_grasp_when_it_is_captured(docked, bounce):
    assert animation(bounce)["shots"] == []
    (capture,) = (event["time_s"] for event in docked.summary["events"] if event["kind"] == "captured")
    data = animation(docked)
    times = [shot["time"] for shot in data["shots"]]
    assert times == sorted(times)
    assert times[0] == 0
    at = [shot for shot in data["shots"] if shot["time"] <= capture][-1]
    low, high = np.min(at["points"], axis=0), np.max(at["points"], axis=0)
    row = int(np.searchsorted(docked.array("time"), capture))
    mate = docked.array("tip_position")[row, 0]
    assert (low[:2] < mate[:2]).all()
    assert (mate[:2] < high[:2]).all()
    whole = np.ptp(data["reach"], axis=0)[:2]
    assert ((high - low)[:2] < whole.max()).all()


def test_a_storyboard_has_the_instants_of_events(docked):
    (capture,) = (event["time_s"] for event in docked.summary["events"] if event["kind"] == "captured")
    times, words = chosen(docked, 5)
    assert len(times) == 5
    assert times == sorted(times)
    assert words[times.index(capture)].endswith("captured")
    assert (times[0], times[-1]) == (0, docked.array("time")[-1])


def test_a_storyboard_says_that_a_grasp_broke_away(docked):
    (captured,) = (event for event in docked.summary["events"] if event["kind"] == "captured")
    lost = captured | {"time_s": docked.array("time")[-1] / 2, "kind": "slipped"}
    _, words = chosen(Result(docked.scenario, docked.data, docked.summary | {"events": [captured, lost]}), 4)
    assert words[1:3] == ["left captured", "left broke away"]
