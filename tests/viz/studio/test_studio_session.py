"""The session of a studio: what a page asks, and what it is told."""

import shlex
import threading
import time
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.cli.options import parse_changes
from spacerobot.common.errors import ScenarioError
from spacerobot.linear import margins
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.studio.jobs import Jobs
from viz.studio.messages import Request
from viz.studio.metric_slopes import differences
from viz.studio.parameters import Leaf, find_leaves
from viz.studio.prepared_design import Origin, PreparedDesign

PID = "robots.arm.tips.tip.pid"
KP, KI, STIFFNESS = f"{PID}.kp", f"{PID}.ki", "grasps.left.stiffness"
ZERO, WORD = "robots.arm.links.link_1.com.1", f"{PID}.feedback"


def _metric(page, message, key="tip_error_peak"):
    return message["metrics"][[metric["key"] for metric in page.hello["metrics"]].index(key)]


def test_a_page_is_told_every_number_with_what_the_schema_says(page):
    numbers = {number["path"]: number for number in page.hello["numbers"]}
    kp, zero, word = numbers[KP], numbers[ZERO], numbers[WORD]
    assert (kp["value"], kp["unit"], kp["low"], kp["free"]) == (150.0, "N s/m", 0.0, True)
    assert kp["text"] == "proportional gain K_p"
    assert kp["slider"] == [15.0, 1500.0, "log"]
    assert not zero["free"]  # a structural zero
    assert (word["kind"], word["choices"], word["free"]) == ("choice", ["base", "inertial"], False)
    assert KP in page.hello["suggested"]
    assert {metric["unit"] for metric in page.hello["metrics"]} == {"mm", "deg", "N m", "N"}


def test_a_changed_number_gives_another_motion(page, arm):
    page.ask("set", seq=1, values={KP: 300.0})
    told = page.take("rollout")
    assert (told["seq"], told["status"], told["trusted"]) == (1, "completed", True)
    assert _metric(page, told) < _metric(page, page.first)
    scene = load_scene(arm, {KP: 300.0})
    data, last = scene.model.createData(), simulate(scene).data.q.values[-1]
    pin.forwardKinematics(scene.model, data, last)
    expected = {tuple(np.round(data.oMi[j].translation, 5)) for j in range(1, scene.model.njoints)}
    found = {tuple(np.round(pose[:3].astype(float), 5)) for pose in told["arrays"]["run.poses"][-1]}
    assert found <= expected


def test_centres_of_mass_are_those_of_the_changed_masses(page, arm):
    values = {"target.links.body.mass": 90.0, "target.links.body.com.0": 0.05}
    page.ask("set", seq=1, values=values)
    found = page.take("rollout")["arrays"]["run.masses.centres"][0]
    scene = load_scene(arm, values)
    expected = pin.centerOfMass(scene.model, scene.model.createData(), scene.q)
    np.testing.assert_allclose(found[-1], expected, atol=1e-6)


def test_of_many_designs_only_the_newest_is_rolled_out(page):
    page.behind = True
    for k in range(500):
        page.ask("set", seq=k, values={KP: 150.0 + k})
    assert len(page.session._newest) == 1
    page.behind = False
    page.session.wake()
    assert page.take("rollout")["seq"] == 499


@pytest.mark.parametrize(
    ("values", "path", "words"),
    [
        ({KP: -1}, KP, "found -1, allowed: at least 0"),
        ({KP: 1e400}, KP, "allowed: a finite number"),
        ({"robots.arm.tips.tap.pid.kp": 3}, "change robots.arm.tips.tap.pid.kp", "did you mean tip"),
        ({KP: 10**400}, KP, "allowed: a finite number"),
        ({"robots.*.tips.tip.pid.kp": 3}, "robots.*.tips.tip.pid.kp", "a pattern"),
        ({"robots.arm.urdf": "/etc/passwd"}, "robots.arm.urdf", "allowed on a page: a URDF that ships"),
        ({"robots.arm": {"urdf": "../../x"}}, "robots.arm.urdf", "is in the scenario's folder"),
        ({f"{PID}.kind": [[]]}, f"{PID}.kind", "no kind of this section"),
        ({WORD: "bass"}, WORD, "'base' or 'inertial'"),
        ({"simulation.engine": "pinocchio"}, "simulation.engine", "allowed in the studio: casadi"),
    ],
)
def test_what_cannot_be_is_told_and_the_page_goes_on(page, values, path, words):
    page.ask("set", seq=7, values=values)
    told = page.take("failed")
    assert (told["seq"], told["path"]) == (7, path)
    assert words in told["message"]
    page.ask("set", seq=8, values={})
    # the first may be by the interpreter, this by compiled code: the last bits differ
    assert _metric(page, page.take("rollout")) == pytest.approx(_metric(page, page.first), rel=1e-9)


def test_a_rollout_that_diverges_is_told_as_far_as_it_went(page):
    page.ask("set", seq=1, values={KP: 1e7})
    told = page.take("rollout")
    assert (told["status"], told["words"]) == ("diverged", "the rollout diverged")
    assert told["metrics"][0] is None
    assert "shown up to there" in told["warnings"][0]


def test_a_design_that_run_refuses_is_told_when_the_hand_rests(page, monkeypatch):
    def refuse(*_):
        raise ScenarioError("the chain cannot close", where="grasps.left")

    monkeypatch.setattr(Origin, "build", refuse)
    page.ask("set", seq=3, values={KP: 200.0})
    assert page.take("rollout")["seq"] == 3
    told = page.take("failed")
    assert (told["what"], told["seq"], told["path"]) == ("check", 3, "grasps.left")


def test_masses_that_no_body_has_are_told(page):
    page.ask("set", seq=3, values={"target.links.body.inertia.2": -0.01})
    told = page.take("failed")
    assert (told["what"], told["seq"]) == ("set", 3)
    assert "inertia" in told["message"]


def test_numbers_shown_are_those_of_the_command_line(page, arm):
    values = {KP: 211.3, STIFFNESS: 140.0}
    page.ask("set", seq=1, values=values)
    shown = page.take("rollout")
    page.ask("command", values=values)
    words = shlex.split(page.take("command")["text"])
    assert words[:3] == ["spacerobot", "run", str(arm)]
    result = simulate(load_scene(arm, parse_changes(words[4::2])))
    plant, numbers = page.session.plants.find(values)
    studied, _ = plant.roll(plant.drawn(numbers), numbers)
    np.testing.assert_allclose(studied.data.q.values, result.data.q.values, rtol=0, atol=1e-12)
    tips = result.summary["tip_error"]["arm/tip"]
    peak = max(abs(tips[axis][end]) for axis in "xy" for end in ("min_m", "max_m"))
    assert _metric(page, shown) == pytest.approx(1e3 * peak, rel=1e-12)
    assert shown["ledger"]["energy"]["actuator_work_j"] == pytest.approx(
        result.summary["ledger"]["energy"]["actuator_work_j"], rel=1e-9
    )


def test_another_structure_is_compiled_and_then_follows(page, arm):
    values = {WORD: "inertial", ZERO: 0.01}
    page.ask("set", seq=1, values=values)
    assert page.take("compiling")["why"]
    hello = page.take("hello")
    told = {number["path"]: number for number in hello["numbers"]}
    assert hello["seq"] == 1
    assert (told[ZERO]["free"], told[ZERO]["value"], told[WORD]["value"]) == (True, 0.0, "base")
    first = _metric(page, page.take("rollout"))
    page.ask("set", seq=2, values=values | {ZERO: 0.02})
    # gradients may still be compiled in the background
    again = page.take("rollout", "hello", "compiling", until=lambda m: m.get("what") != "gradients")
    assert again["type"] == "rollout"
    assert _metric(page, again) != first
    result = simulate(load_scene(arm, values | {ZERO: 0.02}), backend="interpreted")
    tips = result.summary["tip_error"]["arm/tip"]
    peak = max(abs(tips[axis][end]) for axis in "xy" for end in ("min_m", "max_m"))
    assert _metric(page, again) == pytest.approx(1e3 * peak, rel=1e-9)


def test_every_number_that_is_said_to_follow_does(page, monkeypatch):
    """Whatever part of the scenario it stands in."""
    monkeypatch.setattr("viz.studio.prepared_design.PLACES", ())
    plants = page.session.plants
    assert all(plants.find({path: plants.base.nominal[path]}) for path in plants.base.free)


def test_gradients_are_those_of_differences(page):
    nominal, h = {KP: 150.0, STIFFNESS: 100.0}, 1e-3
    page.ask("gradient", seq=4, values=nominal, metric="tip_error_rms", paths=[KP, STIFFNESS, "no.such"])
    told = page.take("gradient", until=lambda gradient: gradient["status"] != "differences")
    assert (told["seq"], told["status"], told["d"]["no.such"]) == (4, "exact", None)
    for path in (KP, STIFFNESS):
        found = []
        for sign in (1, -1):
            page.ask("set", seq=1, values=nominal | {path: nominal[path] + sign * h})
            found.append(_metric(page, page.take("rollout"), "tip_error_rms"))
        assert told["d"][path] == pytest.approx((found[0] - found[1]) / (2 * h), rel=1e-4)


def test_slopes_are_there_before_exact_ones_are_compiled(page, monkeypatch):
    plant = page.session.plants.base
    exact = plant.gradient({}, plant.metrics["tip_error_rms"])[1]
    monkeypatch.setattr(PreparedDesign, "has_gradients", property(lambda plant: not plant.waits))
    monkeypatch.setattr(PreparedDesign, "waits", True, raising=False)
    ready = threading.Event()

    def prepare(plant):
        assert ready.wait(60)
        plant.__dict__["waits"] = False

    monkeypatch.setattr(PreparedDesign, "prepare_gradients", prepare)
    page.ask("gradient", seq=5, values={}, metric="tip_error_rms", paths=[KP, STIFFNESS])
    quick = page.take("gradient")
    while len(quick["d"]) < 2:  # a slow computer tells them one by one
        quick["d"] |= page.take("gradient")["d"]
    assert quick["status"] == "differences"
    for path in (KP, STIFFNESS):
        assert quick["d"][path] == pytest.approx(exact[path], rel=1e-5)
    page.ask("set", seq=6, values={KP: 301.0})
    page.take("rollout")
    ready.set()
    told = page.take("gradient")
    plant.__dict__.pop("waits")
    assert (told["seq"], told["status"], told["d"][KP]) == (5, "exact", exact[KP])


def test_differences_keep_to_what_is_allowed_and_give_way(page):
    plant = page.session.plants.base
    metric, damping = plant.metrics["tip_error_rms"], "grasps.left.damping"
    (at_its_end,) = differences(plant, {damping: 0.0}, metric, [damping, "no.such"])
    assert list(at_its_end) == [damping]
    assert at_its_end[damping] == pytest.approx(plant.gradient({damping: 0.0}, metric)[1][damping], rel=1e-2)
    assert list(differences(plant, {}, metric, [KP], lambda: True)) == []


def test_where_events_leave_no_exact_slopes_differences_stand_in(page, monkeypatch):
    plant, told = page.session.plants.base, PreparedDesign.gradient
    exact = plant.gradient({}, plant.metrics["tip_error_rms"])[1]

    def without(plant, numbers, metric, shown=None):
        assert shown in (None, [KP])  # a notice covers what is shown alone
        value, slopes, _ = told(plant, numbers, metric, shown)
        return value, dict.fromkeys(slopes), "coincident"

    monkeypatch.setattr(PreparedDesign, "gradient", without)
    page.ask("gradient", seq=5, values={}, metric="tip_error_rms", paths=[KP])
    found = [page.take("gradient") for _ in range(2)]
    assert [part["status"] for part in found] == ["coincident", "coincident"]
    assert [part["d"][KP] for part in found] == [None, pytest.approx(exact[KP], rel=1e-5)]
    page.ask("improve", values={}, metric="tip_error_rms", bounds={KP: [100, 180]})
    done = page.take("job", until=lambda job: job["state"] != "running")
    assert done["best"]["objective"] < 0.999 * done["start"]


def test_improving_goes_down_within_the_bounds(page):
    page.ask("improve", values={}, metric="tip_error_rms", bounds={KP: [100, 180], KI: [10, 100]})
    done = page.take("job", until=lambda job: job["state"] != "running")
    best = done["best"]
    assert done["state"] == "done"
    assert best["objective"] < done["start"] == pytest.approx(_metric(page, page.first, "tip_error_rms"))
    assert all(
        low - 1e-9 <= best["values"][p] <= high + 1e-9 for p, low, high in ((KP, 100, 180), (KI, 10, 100))
    )
    page.ask("set", seq=1, values=best["values"])
    assert _metric(page, page.take("rollout"), "tip_error_rms") == pytest.approx(best["objective"], rel=1e-9)


def test_a_search_is_told_as_it_goes_and_can_be_stopped(page):
    asked = {"values": {}, "metric": "tip_error_peak", "method": "ga", "bounds": {KP: [50, 500]}}
    page.ask("tune", budget=100_000, **asked)
    running = page.take("job", until=lambda job: job.get("curve"))
    page.ask("tune", **asked)
    assert "another job is running" in page.take("failed")["message"]
    page.ask("stop", job=running["id"])
    ended = page.take("job", until=lambda job: job["state"] != "running")
    assert ended["state"] == "stopped"
    assert ended["best"]["objective"] <= running["curve"][0][1]
    assert 50 <= ended["best"]["values"][KP] <= 500


def test_a_campaign_grows_and_ends(page):
    spreads = {KP: {"kind": "normal", "std": 10.0}, STIFFNESS: {"kind": "uniform", "lower": 80, "upper": 120}}
    page.ask("campaign", values={KI: 70.0}, metric="tip_error_peak", spreads=spreads, samples=96)
    first = page.take("job", until=lambda job: "done" in job)
    last = page.take("job", until=lambda job: job["state"] == "done")
    assert (first["done"], last["done"], last["lost"]) == (64, 96, 0)
    arrays = last["arrays"]
    np.testing.assert_array_equal(first["arrays"]["values"], arrays["values"][:64])
    assert ["tip error", "arm/tip"] in last["signals"]
    assert any(title == "joint torque" for title, _ in last["signals"])
    assert arrays["bands"].shape == (len(last["signals"]), 5, len(arrays["time"]))
    assert (np.diff(arrays["bands"], axis=1) >= 0).all()
    assert arrays["paths"].shape == (96, len(arrays["time"]), 1, 3)
    page.ask("campaign", values={}, metric="tip_error_peak", spreads={KP: {"kind": "normal", "std": 1e3}})
    assert "at least 0" in page.take("job", until=lambda job: job["state"] == "failed")["message"]


def test_who_hears_of_a_jobs_end_may_begin_another_at_once():
    heard = []

    def again(_, message):
        heard.append(message.get("message", ""))
        if message.get("state") == "failed" and len(heard) < 5:
            jobs.begin(None, Request("campaign"))

    plants = SimpleNamespace(find=lambda _: None, make=lambda _: 1 / 0)
    jobs = Jobs(plants, again)
    jobs.begin(None, Request("campaign"))
    end = time.monotonic() + 10
    while len(heard) < 6 and time.monotonic() < end:
        time.sleep(0.001)
    assert heard == ["building the closed loop", "", "division by zero"] * 2


def test_a_slider_has_room_on_both_sides_of_its_number():
    def ends(value, *given):
        leaf = Leaf("gain", value, "number", "", "", low=0.0)
        return leaf.plain(given, free=True)["slider"]

    assert ends(300.0, 8.67, 400.0, "linear") == [8.67, 400.0, "linear"]
    assert ends(300.0, 8.67, 285.89, "linear") == [8.67, 3000.0, "log"]
    assert ends(100.0, 100.0, 150.0, "linear") == [10.0, 1000.0, "log"]
    assert ends(0.0, 0.0, 100.0, "linear") == [0.0, 100.0, "linear"]  # there is nothing below


def test_initial_joint_positions_have_sliders_within_the_limits_of_the_urdf(page):
    numbers = {number["path"]: number for number in page.hello["numbers"]}
    joints = {path for path, number in numbers.items() if number.get("joint")}
    assert joints == {f"robots.arm.joints.joint_{k}.angle_deg" for k in (1, 2, 3)}
    assert all(numbers[path]["free"] for path in joints)  # no compilation while one is dragged
    scene = load_scene("servicer")
    leaves, limited = find_leaves(scene), 0
    for body in scene.bodies:
        for joint in body.description.joints:
            leaf = leaves.get(f"{body.path}.joints.{joint.name}.angle_deg")
            if leaf is not None and np.isfinite([joint.lower, joint.upper]).all():
                limited += 1
                assert leaf.slider == (
                    pytest.approx(np.degrees(joint.lower)),
                    pytest.approx(np.degrees(joint.upper)),
                    "linear",
                )
    assert limited > 0


def test_margins_are_those_of_the_linear_analysis_the_worst_loop_first(page, arm):
    values = {KP: 300.0}
    page.ask("margins", values=values, at=0.5)
    done = page.take("job", until=lambda job: job["state"] != "running")
    assert (done["state"], done["at"], done["units"]["delay"]) == ("done", "0.5 s", "s")
    expected = {one.name: one for one in margins(load_scene(arm, values), [0.5]).loops[0]}
    assert {loop["name"] for loop in done["loops"]} == set(expected)
    for loop in done["loops"]:
        for name in done["units"]:
            value = getattr(expected[loop["name"]], name)
            assert loop[name] == (pytest.approx(value, rel=1e-6) if np.isfinite(value) else None)
    disks = [loop["disk"] for loop in done["loops"] if not loop["varies"]]
    assert disks == sorted(disks)
    assert disks[0] < 2
    page.ask("margins", values={}, at=9.0)
    assert "allowed: from 0 to 1 s" in page.take("job", until=lambda job: job["state"] == "failed")["message"]
