"""Drafts are simulated and linearised before they are written, and say what was found."""

from __future__ import annotations

import re

import numpy as np

from spacerobot.closedloop import build_closed_loop
from spacerobot.closedloop.stiffness import find_poles
from spacerobot.drafting import DraftRequest, draft
from spacerobot.drafting import verified as module
from spacerobot.drafting.verified import Verification, verify_capture
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

FLAT = DraftRequest(["short_arm.urdf"], "rectangle.urdf")


def test_a_drafted_docking_captures_and_stops_at_the_first_run(tmp_path):
    file = tmp_path / "mine.yaml"
    drafted = draft(FLAT, file, capture=True)
    assert drafted.is_verified
    file.write_text(drafted.text)
    scene = load_scene(file)
    assert not scene.warnings
    result = simulate(scene)
    assert result.summary["outcome"] == "captured"
    assert [e["kind"] for e in result.summary["events"]] == ["entered", "captured", "phase", "end"]
    assert result.summary["status"]["trusted"]
    assert "# Simulated and linearised before it was written:\n#   captured after" in drafted.text
    limits, poles = drafted.text.split("Units are SI")[0].splitlines()[3:5]
    assert re.fullmatch(
        r"#   joints use at most this share of the URDF's limits: torque [\d.]+ % \(joint_\d\), .*", limits
    )
    assert re.match(r"#   linearised at the start, just after the capture, at [\d.]+ s: fastest pole ", poles)


def test_a_draft_is_slowed_down_until_it_works(tmp_path, monkeypatch):
    answers = [Verification(("missed: too fast",)), Verification((), ("captured after 3 s.",))]
    monkeypatch.setattr(module, "verify_capture", lambda *_: answers.pop(0))
    drafted = draft(FLAT, tmp_path / "mine.yaml", capture=True)
    assert drafted.is_verified
    assert "# As first drafted: missed: too fast.\n# Slowed down by 2:" in drafted.text
    assert drafted.scene.scenario.robots["short_arm"].controllers["guidance"].gain == 1.0


def test_a_draft_that_never_works_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "verify_capture", lambda *_: Verification(("missed: out of reach",)))
    drafted = draft(FLAT, tmp_path / "mine.yaml", capture=True)
    assert not drafted.is_verified
    assert "# The draft did not pass its verification" in drafted.text
    assert "Slowed down by 8: missed: out of reach" in drafted.problems[-1]


def test_what_is_not_simulated_is_not_called_verified(tmp_path):
    drafted = draft(FLAT, tmp_path / "mine.yaml", capture=True, simulate=False)
    assert not drafted.is_verified
    assert "# Not simulated yet." in drafted.text


def test_margins_of_the_capture_count(tmp_path):
    """The same capture with an envelope just wide enough is refused."""
    file = tmp_path / "mine.yaml"
    drafted = draft(FLAT, file, capture=True, simulate=False)
    speed = drafted.scene.grasps[0].config.capture.closing_speed
    tight = drafted.text.replace(f"closing_speed: {speed:g}, lat", f"closing_speed: {speed * 0.55:g}, lat")
    assert tight != drafted.text
    file.write_text(tight)
    found = verify_capture(load_scene(file))
    assert [problem for problem in found.problems if "closing speed at the capture" in problem]


def test_poles_of_resolved_rates_are_their_gains(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(draft(FLAT, file, capture=True, simulate=False).text)
    scene = load_scene(file)
    loop, guidance = build_closed_loop(scene), scene.scenario.robots["short_arm"].controllers["guidance"]
    x, c = (part.full().ravel() for part in loop.setup(loop.parameter_values))
    found = find_poles(loop, 0.0, x, c)
    fast = found[np.abs(found) > 0.5]
    apart = np.abs(fast[:, None] + [guidance.gain, guidance.rate_gain])
    assert (apart.argmin(axis=1) == 0).sum() == (apart.argmin(axis=1) == 1).sum() == 3
    assert apart.min(axis=1).max() < 0.02 * guidance.gain
