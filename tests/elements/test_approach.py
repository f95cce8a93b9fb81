"""References for an approach: smooth, beginning where the tip is, ending where it is said."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine.mechanical_state import MechanicalState
from tests.oracles.hybrid import roll
from tests.oracles.motions import DesiredMotions
from tests.oracles.small_scenes import PLANAR, SPATIAL, random_x, small_scene

WAY = {
    "kind": "rendezvous",
    "standoff": 0.3,
    "axis": [0, 2, 0],
    "approach_time": 0.7,
    "wait": 0.4,
    "closing_speed": 0.5,
    "end_distance": 0.05,
}
BRAKE = {"kind": "brake", "deceleration": 0.02, "spin_deceleration_deg": 2.0}
CLOSING = 1.875 * 0.25 / 0.5
END = 1.1 + CLOSING
PATH = "robots.one.tips.tip.reference"
SCENES = {
    "planar": (PLANAR, {PATH: WAY | {"frame": "mate_2", "mated_deg": [0, 0, 30]}}),
    "spatial": (
        SPATIAL,
        {PATH: WAY | {"frame": "right", "mated_deg": [10, 20, 30]}, "target.joints.hinge": {"locked": True}},
    ),
}


def drifting(case, **more):
    """A scene in which nothing holds the target, which moves and spins."""
    text, changes = SCENES[case]
    spin = {"planar": [0, 0, 20], "spatial": [10, -15, 20]}[case]
    free = {"grasps": {}, "target.base.close_grasp": None, "robots.two.base.close_grasp": None}
    free |= {"target.base.position": [2, 0.3, 0], "robots.two.base.position": [8, 0, 0]}
    free |= {"target.base.velocity": [0.02, -0.03, 0], "target.base.spin_deg": spin}
    return small_scene(text, changes | free | more)


def asked(desired, t, x):
    return desired.at(t, x)["one/tip"]


def mechanics(scene, x):
    nq = scene.model.nq
    return MechanicalState(scene.model, x[:nq], x[nq : nq + scene.model.nv])


@pytest.mark.parametrize("case", SCENES)
@pytest.mark.parametrize("t", [0.3, 0.9, 1.1 + 0.4 * CLOSING, END + 0.1])
def test_velocity_and_acceleration_are_the_rates_of_what_is_asked_for(case, t):
    pull = {"planar": [0.3, -1.6, 0], "spatial": [0.2, 0.5, -3]}[case]
    scene, h = drifting(case, gravity=pull), 1e-5
    desired = DesiredMotions(scene)
    x = random_x(scene, np.random.default_rng(2), len(desired.x0))
    rate = desired.rate(t, x)
    behind, now, ahead = (
        asked(desired, t + s * h, desired.loop.normalise(x + s * h * rate).full().ravel()) for s in (-1, 0, 1)
    )

    def slope(name):
        return (getattr(ahead, name) - getattr(behind, name)) / (2 * h)

    np.testing.assert_allclose(now.velocity, slope("position"), atol=1e-7)
    np.testing.assert_allclose(now.acceleration, slope("velocity"), atol=1e-7)
    np.testing.assert_allclose(
        now.angular_velocity, pin.log3(ahead.rotation @ behind.rotation.T) / (2 * h), atol=1e-7
    )
    np.testing.assert_allclose(now.angular_acceleration, slope("angular_velocity"), atol=1e-7)


@pytest.mark.parametrize("case", SCENES)
def test_a_rendezvous_begins_where_the_tip_is_and_ends_where_it_is_said(case):
    scene = drifting(case)
    desired = DesiredMotions(scene)
    state = mechanics(scene, desired.x0)
    tip, first = state.frame(scene.tips[0].frame), asked(desired, 0.0, desired.x0)
    np.testing.assert_allclose(first.position, tip.position, atol=1e-12)
    np.testing.assert_allclose(first.velocity, tip.velocity[:3], atol=1e-12)
    np.testing.assert_allclose(first.rotation, tip.rotation, atol=1e-12)
    frame = scene.model.getFrameId(f"target/{scene.tips[0].reference.frame}", pin.FrameType.BODY)
    turn = pin.rpy.rpyToMatrix(np.radians(scene.tips[0].reference.mated_deg))
    for t, distance in ((0.7, 0.3), (1.1, 0.3), (END, 0.05)):
        mate, wanted = state.frame(frame), asked(desired, t, desired.x0)
        place = mate.position - distance * mate.rotation @ [0, 1, 0]
        np.testing.assert_allclose(wanted.position, place, atol=1e-12)
        np.testing.assert_allclose(wanted.rotation, mate.rotation @ turn, atol=1e-12)
        lever = np.cross(mate.velocity[3:], place - mate.position)
        np.testing.assert_allclose(wanted.velocity, mate.velocity[:3] + lever, atol=1e-12)
        np.testing.assert_allclose(wanted.angular_velocity, mate.velocity[3:], atol=1e-12)


def test_it_closes_in_at_the_speed_that_is_asked_for():
    scene = drifting("planar", **{"target.base.velocity": [0, 0, 0], "target.base.spin_deg": [0, 0, 0]})
    desired = DesiredMotions(scene)
    times = np.linspace(1.1, END, 201)
    speeds = [np.linalg.norm(asked(desired, t, desired.x0).velocity) for t in times]
    assert max(speeds) == pytest.approx(0.5, rel=1e-4)


@pytest.mark.parametrize("case", SCENES)
def test_brake_comes_to_rest_within_its_limits(case):
    scene = drifting(case, **{PATH: BRAKE, "robots.one.base.velocity": [0.1, -0.05, 0]})
    desired = DesiredMotions(scene)
    loop, tip = desired.loop, mechanics(scene, desired.x0).frame(scene.tips[0].frame)
    first = asked(desired, 0.0, desired.x0)
    np.testing.assert_allclose(first.velocity, tip.velocity[:3], atol=1e-12)
    np.testing.assert_allclose(first.angular_velocity, tip.velocity[3:], atol=1e-12)
    (end,) = {
        t for t in loop.breakpoints if t not in {s for tip in scene.tips for s in tip.reference.jumps()}
    }
    motions = [asked(desired, t, desired.x0) for t in np.linspace(0, end, 401)]
    found = [
        max(np.linalg.norm(m.acceleration) for m in motions) / 0.02,
        max(np.linalg.norm(m.angular_acceleration) for m in motions) / np.radians(2),
    ]
    assert max(found) == pytest.approx(1, rel=1e-4)
    assert not motions[-1].velocity.any()
    assert not motions[-1].angular_velocity.any()


@pytest.mark.parametrize("case", SCENES)
@pytest.mark.parametrize("begins_at", ["pose", "reference"])
def test_they_begin_with_their_phase(case, begins_at):
    ways = [{"kind": "line", "displacement": [0.1, 0, 0]}, SCENES[case][1][PATH], BRAKE]
    phases = {
        name: {
            "robots": {"one": {"tips": {"tip": {"reference": way}}}},
            "timeout": 0.3,
            "begins_at": begins_at,
        }
        for name, way in zip(("away", "meet", "rest"), ways, strict=True)
    }
    loop = build_closed_loop(drifting(case, phases=phases))
    run = roll(loop, 0.8, rtol=1e-8)
    changes = [event for event in run.events if event.name in ("away.timeout", "meet.timeout")]
    assert len(changes) == 2, run.names
    for event in changes:
        before = run.outputs(event.time, event.before, event.c_before)
        after = run.outputs(event.time, event.after, event.c_after)
        led = before["tip_position" if begins_at == "pose" else "tip_reference"]
        np.testing.assert_allclose(after["tip_reference"][:3], led[:3], atol=1e-10)


REFUSED = {
    "frame": ({"frame": "mate_9"}, "no link 'mate_9' in the target's URDF"),
    "axis": ({"axis": [0, 0, 0]}, "allowed: a direction"),
    "both": ({"duration": 3}, "not both"),
    "plane": ({"axis": [1, 0, 1]}, "leads out of the x-y plane"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_followed_is_refused(case):
    change, told = REFUSED[case]
    section = SCENES["planar"][1][PATH] | change
    with pytest.raises(ScenarioError, match=told):
        drifting("planar", **{PATH: section})


def test_the_target_does_not_follow_itself():
    with pytest.raises(ScenarioError, match="of tips and not of the target"):
        small_scene(PLANAR, {PATH: None, "target.reference": WAY | {"frame": "mate_2"}})
