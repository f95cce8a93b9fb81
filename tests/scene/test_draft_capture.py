"""Drafted dockings: they capture at the first run, and their plan section is one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.errors import ScenarioError
from spacerobot.scenario.load import to_document
from spacerobot.scene import load_scene
from spacerobot.scene.checks import gap
from spacerobot.scene.draft import DraftRequest, draft_capture, surface_point
from spacerobot.simulation import simulate

FLAT = DraftRequest(["short_arm.urdf"], "rectangle.urdf")
DEEP = DraftRequest(["panda_arm.urdf"], "satellite_box.urdf")


def drafted(order, file):
    """Scene of a draft, read back from its file."""
    text, _ = draft_capture(order, file)
    file.write_text(text)
    return load_scene(file)


def test_a_drafted_docking_captures_and_stops_at_the_first_run(tmp_path):
    scene = drafted(FLAT, tmp_path / "mine.yaml")
    assert not scene.warnings
    result = simulate(scene)
    assert result.summary["outcome"] == "captured"
    assert [e["kind"] for e in result.summary["events"]] == ["entered", "captured", "phase", "end"]
    assert result.summary["status"]["trusted"]


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
    document = to_document(scene.scenario)
    (free,), (holding,) = (
        [tip for robot in robots.values() for tip in robot["tips"].values()]
        for robots in (document["robots"], document["phases"]["stop"]["robots"])
    )
    for name in ("pid", "orientation_pid"):  # the arm alone is lighter than the arm with the object
        assert bool(free.get(name)) == (name in holding)
        assert name not in holding or holding[name]["kp"] > free[name]["kp"]


def test_a_point_of_the_surface_stands_in_for_a_mating_frame(tmp_path):
    file = tmp_path / "mine.yaml"
    name, text = surface_point("ball.urdf", (-0.1, 0.0, 0.0), file)
    (tmp_path / name).write_text(text)
    order = dataclasses.replace(FLAT, target=str(tmp_path / name), frames=["mate_point"])
    scene = drafted(order, file)
    assert scene.grasps[0].config.capture.axis == (1.0, 0.0, 0.0)
    with pytest.raises(ScenarioError, match="allowed: a point of the surface"):
        surface_point("ball.urdf", (0.0, 0.0, 0.0), file)


def test_what_cannot_be_drafted_is_refused(tmp_path):
    for order, told in (
        (dataclasses.replace(FLAT, target="ball.urdf"), "ball.urdf has no mating frame"),
        (dataclasses.replace(FLAT, robots=["short_arm.urdf"] * 2), "--robot: found 2 robots"),
    ):
        with pytest.raises(ScenarioError, match=told):
            draft_capture(order, tmp_path / "mine.yaml")
