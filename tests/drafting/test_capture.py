"""Drafted dockings: geometry of the approach, and the object as payload."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from optim.planning.search.make_plan import make_plan
from spacerobot.common.errors import ScenarioError
from spacerobot.description.find import find_urdf
from spacerobot.drafting import DraftRequest, draft, draft_capture, surface_point
from spacerobot.drafting.capture import plan_costs
from spacerobot.scene import load_scene
from spacerobot.scene.checks import gap

FLAT = DraftRequest(["short_arm.urdf"], "rectangle.urdf")
DEEP = DraftRequest(["panda_arm.urdf"], "satellite_box.urdf")


def drafted(order, file):
    """Scene of a draft, read back from its file."""
    text, _ = draft_capture(order, file)
    file.write_text(text)
    return load_scene(file)


@pytest.mark.parametrize("order", [FLAT, DEEP], ids=["planar", "spatial"])
def test_the_object_begins_ahead_of_the_tip_along_the_axis_of_the_capture(tmp_path, order):
    """The tip's way ends inside the envelope by geometry alone: no turn, no motion sideways."""
    scene = drafted(order, tmp_path / "mine.yaml")
    (grasp,), plan = scene.grasps, scene.scenario.plan
    (goal,) = plan.goals.values()
    capture = grasp.config.capture
    reference = next(one for one in scene.tips[0].references if one.config.kind == "rendezvous").config
    assert (reference.frame, goal.frame) == (grasp.config.frame,) * 2
    assert reference.mated_deg == goal.mated_deg == capture.mated_deg
    away = gap(scene.model, grasp, np.array(scene.q))
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, np.array(scene.q))
    along = data.oMf[grasp.frame].rotation @ np.array(capture.axis)
    np.testing.assert_allclose(away, -np.linalg.norm(away) * along, atol=2e-4)
    assert reference.standoff < np.linalg.norm(away) <= 20 * capture.distance
    mated = pin.rpy.rpyToMatrix(np.radians(capture.mated_deg))
    turned = (data.oMf[grasp.frame].rotation @ mated).T @ data.oMf[grasp.tip.frame].rotation
    assert np.degrees(np.linalg.norm(pin.log3(turned))) < 0.1


@pytest.mark.parametrize("order", [FLAT, DEEP], ids=["planar", "spatial"])
def test_the_payload_is_the_object_where_it_is_mated(tmp_path, order):
    """Centre of mass and inertia in the tip's axes, from those of the object in its mating frame."""
    scene = drafted(order, tmp_path / "mine.yaml")
    (grasp,), (controller,) = scene.grasps, scene.scenario.robots[scene.robots[0].name].controllers.values()
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, np.array(scene.q))
    joint = scene.bodies[-1].root_joint
    inertia = data.oMf[grasp.frame].actInv(data.oMi[joint]).act(scene.model.inertias[joint])
    mated = pin.SE3(pin.rpy.rpyToMatrix(np.radians(grasp.config.capture.mated_deg)), np.zeros(3))
    inertia = mated.actInv(inertia)
    assert controller.payload_mass == pytest.approx(inertia.mass, rel=1e-3)
    np.testing.assert_allclose(controller.payload_com, inertia.lever, atol=2e-4)
    about = controller.payload_inertia
    np.testing.assert_allclose(about[:3], np.diag(inertia.inertia), rtol=2e-3, atol=1e-3)


def test_a_plan_requires_only_limits_that_the_urdf_has(tmp_path):
    """With an effort limit of zero, which counts as none, the drafted plan can be solved."""
    arm = tmp_path / "weak.urdf"
    text = find_urdf("short_arm.urdf").read_text(encoding="utf-8")
    arm.write_text(text.replace('effort="1000"', 'effort="0"'))
    scene = drafted(dataclasses.replace(FLAT, robots=[str(arm)]), tmp_path / "weak.yaml")
    assert scene.scenario.plan.limits["urdf"].required == ("position", "rate")
    assert not make_plan(scene, backend="interpreted").verification.failures()
    complete = drafted(FLAT, tmp_path / "complete.yaml")
    assert complete.scenario.plan.limits["urdf"].required == ("position", "rate", "torque")


def test_slower_drafts_take_longer_at_lower_gains(tmp_path):
    from spacerobot.drafting.capture import CaptureGeometry

    geometry = CaptureGeometry.of(FLAT, tmp_path / "mine.yaml")
    first, slow = (geometry.scenario(s)[1].scenario for s in (1.0, 2.0))
    (one,), (two,) = (s.robots["short_arm"].controllers.values() for s in (first, slow))
    assert (two.gain, two.rate_gain) == (one.gain / 2, one.rate_gain / 2)
    times = [s.phases["approach"].robots["short_arm"]["tips"]["tip"]["reference"] for s in (first, slow)]
    assert times[1]["approach_time"] == 2 * times[0]["approach_time"]
    assert times[1]["closing_speed"] == pytest.approx(times[0]["closing_speed"] / 2, rel=0.05)


@pytest.mark.parametrize("slowdown", [1.0, 8.0])
def test_the_brake_takes_two_time_constants_of_the_guidance(tmp_path, slowdown):
    """A shorter pulse of its loads lay between two steps, and the largest torque of a result missed it."""
    from spacerobot.drafting.capture import CaptureGeometry

    scenario = CaptureGeometry.of(FLAT, tmp_path / "mine.yaml").scenario(slowdown)[1].scenario
    (guidance,) = scenario.robots["short_arm"].controllers.values()
    approach, brake = (
        scenario.phases[name].robots["short_arm"]["tips"]["tip"]["reference"] for name in ("approach", "stop")
    )
    duration = 1.5 * approach["closing_speed"] / brake["deceleration"]  # from the closing speed to rest
    assert duration >= 0.95 * max(2.0, 2 / guidance.gain)  # with two digits


def test_a_point_of_the_surface_stands_in_for_a_mating_frame(tmp_path):
    file = tmp_path / "mine.yaml"
    ball = dataclasses.replace(FLAT, target="ball.urdf", point=(-0.1, 0.0, 0.0))
    order, urdf, text = surface_point(ball, file)
    urdf.write_text(text)
    scene = drafted(order, file)
    assert scene.grasps[0].config.capture.axis == (1.0, 0.0, 0.0)
    for change, message in (
        ({"point": (0.0, 0.0, 0.0)}, "allowed: a point of the surface"),
        ({"point": (0.1, 0.2)}, "found '0.1,0.2', allowed: x,y,z"),
        ({"frames": ["mate"]}, "without --frame"),
    ):
        with pytest.raises(ScenarioError, match=message):
            surface_point(dataclasses.replace(ball, **change), file)


def test_a_draft_for_a_point_writes_the_object_and_removes_it_if_it_fails(tmp_path, monkeypatch):
    file, urdf = tmp_path / "mine.yaml", tmp_path / "mine_target.urdf"
    ball = dataclasses.replace(FLAT, target="ball.urdf", point=(-0.1, 0.0, 0.0))
    with pytest.raises(ScenarioError, match="needs --capture"):
        draft(ball, file, simulate=False)
    with pytest.raises(ScenarioError, match="no link 'nowhere'"):
        draft(dataclasses.replace(ball, tips=["nowhere"]), file, capture=True, simulate=False)
    assert not list(tmp_path.iterdir())
    assert draft(ball, file, capture=True, simulate=False).save() == file
    assert {path.name for path in tmp_path.iterdir()} == {file.name, urdf.name}
    for existing in (file, urdf):
        with pytest.raises(ScenarioError, match=f"{existing.name}: exists already"):
            draft(ball, file, capture=True, simulate=False)
        existing.unlink()
    with pytest.raises(ScenarioError, match="--robot: found none"):
        draft(dataclasses.replace(FLAT, robots=()), file)
    monkeypatch.chdir(tmp_path)
    assert draft(FLAT, simulate=False).file.name == "short_arm.yaml"


def test_what_cannot_be_drafted_is_refused(tmp_path):
    for order, told in (
        (dataclasses.replace(FLAT, target="ball.urdf"), "ball.urdf has no mating frame"),
        (dataclasses.replace(FLAT, robots=["short_arm.urdf"] * 2), "--robot: found 2 robots"),
    ):
        with pytest.raises(ScenarioError, match=told):
            draft_capture(order, tmp_path / "mine.yaml")


@pytest.mark.parametrize("damping", [100.0, 10_000.0])
def test_the_plan_of_a_damped_arm_needs_no_finer_mesh_at_its_ends(tmp_path, damping):
    """With weights that ignore damping, rates change within a part of an interval: 60 and 48 intervals."""
    text = (
        (find_urdf("short_arm.urdf", tmp_path))
        .read_text()
        .replace('damping="0.1"', f'damping="{damping}"', 1)
    )
    (tmp_path / "damped.urdf").write_text(text)
    order = dataclasses.replace(FLAT, robots=[str(tmp_path / "damped.urdf")])
    plan = make_plan(drafted(order, tmp_path / "mine.yaml"), backend="interpreted")
    assert not plan.verification.failures()
    assert plan.motion.intervals <= 12


def test_a_radian_of_a_joint_costs_a_plan_as_much_as_one_of_the_base():
    """The cubic q(t) = 3 (t/T)^2 - 2 (t/T)^3, from rest to rest, has accelerations up to 6/T^2."""
    duration = 20.0
    weights = plan_costs(duration, [0.0])
    assert weights["joint_acceleration"] * (6 / duration**2) ** 2 == pytest.approx(1, rel=0.1)
    assert weights["torque"] == pytest.approx(1e-3 * weights["joint_acceleration"], rel=0.1)
    # damping torques at the largest rate, 1.5/T, cost no more
    damped = plan_costs(duration, [0.5, 300.0])
    assert damped["joint_acceleration"] == weights["joint_acceleration"]
    assert damped["torque"] * (300 * 1.5 / duration) ** 2 == pytest.approx(1, rel=0.1)
