"""Drafted scenarios: they load, run, and their numbers suit the arm."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.common.errors import SpaceRobotError
from spacerobot.description.find import find_urdf
from spacerobot.drafting import DraftRequest, draft_capture, draft_scenario
from spacerobot.scene import load_scene
from spacerobot.scene.overlaps import overlaps
from spacerobot.simulation import simulate

PLANAR = DraftRequest(["planar_arm.urdf"], "rectangle.urdf")


def test_a_drafted_scenario_runs_and_follows_its_reference(tmp_path):
    text, scene = draft_scenario(PLANAR, tmp_path / "mine.yaml")
    (tmp_path / "mine.yaml").write_text(text)
    assert scene.planar
    assert not scene.warnings
    loaded = load_scene(tmp_path / "mine.yaml")
    assert loaded.scenario.tuning is not None
    assert loaded.scenario.campaign is not None
    result = simulate(loaded)
    assert result.completed
    distance = np.linalg.norm(loaded.scenario.target.reference.displacement)
    assert result.summary["tip_error"]["planar_arm/tip"]["norm"]["max_m"] < 1e-3 * distance


def test_gains_of_several_arms_stand_within_their_bounds_and_grow_with_the_target(tmp_path):
    two = dataclasses.replace(PLANAR, robots=["planar_arm.urdf"] * 2)
    _, light = draft_scenario(two, tmp_path / "a.yaml")
    _, heavy = draft_scenario(dataclasses.replace(two, target="satellite_box.urdf"), tmp_path / "b.yaml")
    gains = [s.scenario.robots["planar_arm"].tips["tip"].pid.kp for s in (light, heavy)]
    assert gains[0] < gains[1]
    bounds = light.scenario.tuning.variables["kp_planar_arm"]
    assert bounds.lower < gains[0] < bounds.upper


def test_two_robots_hold_one_frame_each(tmp_path):
    order = dataclasses.replace(PLANAR, robots=["planar_arm.urdf", "planar_arm.urdf"])
    _, scene = draft_scenario(order, tmp_path / "two.yaml")
    assert [grasp.config.frame for grasp in scene.grasps] == ["mate_1", "mate_2"]
    assert scene.robots[1].base.close_grasp == "hold_2"
    assert overlaps(scene) == []


def test_the_target_lies_away_from_the_arm(tmp_path):
    for target in ("rectangle.urdf", "satellite_box.urdf"):
        _, scene = draft_scenario(dataclasses.replace(PLANAR, target=target), tmp_path / "x.yaml")
        assert overlaps(scene) == []


@pytest.mark.parametrize("link", ["panda_link5", "panda_link7"])
def test_a_flange_on_the_last_joint_holds_the_target_away_from_the_arm(link, tmp_path):
    """The last joint is then equally far from the target in all orientations, also across the arm."""
    order = DraftRequest(["panda_arm.urdf"], "satellite_box.urdf", [link])
    _, scene = draft_scenario(order, tmp_path / "x.yaml")
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    origins = np.array([data.oMi[joint].translation for joint in scene.robots[0].joints])
    tip, box = data.oMf[scene.tips[0].frame].translation, data.oMf[scene.target.root_frame].translation
    np.testing.assert_allclose(tip, origins[-1], atol=1e-9)
    axes = data.oMf[scene.tips[0].frame].rotation.T
    places = [tip + sign * np.linalg.norm(box - tip) * axis for axis in axes for sign in (1, -1)]
    distances = [np.linalg.norm(origins - place, axis=1).mean() for place in places]
    assert np.linalg.norm(origins - box, axis=1).mean() == pytest.approx(max(distances), abs=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tips": ["tpi"]}, "--tip: no link 'tpi' in planar_arm.urdf; did you mean tip"),
        ({"tips": ["tip", "tip"]}, "found 2 for 1 robots"),
        ({"frames": ["mate1"]}, "--frame: no link 'mate1' in rectangle.urdf; did you mean mate_1"),
        ({"robots": ["planer_arm.urdf"]}, "did you mean planar_arm.urdf"),
        ({"robots": ["planar_arm.urdf"] * 3}, "one link of rectangle.urdf for each of the 3 robots"),
        ({"robots": ["servicer.urdf"]}, "its ends: left_tip, right_tip"),  # from the base, which is no palm
        ({"base": "planr"}, "--base: found 'planr'; did you mean planar"),
    ],
)
def test_what_cannot_be_drafted_is_refused_by_name(tmp_path, change, words):
    with pytest.raises(SpaceRobotError) as refused:
        draft_scenario(dataclasses.replace(PLANAR, **change), tmp_path / "x.yaml")
    assert words in str(refused.value)


def test_a_robot_in_a_file_of_a_generic_name_has_the_name_of_the_urdf(tmp_path):
    (tmp_path / "model.urdf").write_text(find_urdf("short_arm.urdf").read_text(encoding="utf-8"))
    (tmp_path / "mine.urdf").write_text(find_urdf("short_arm.urdf").read_text(encoding="utf-8"))
    for file, name in (("model.urdf", "short_arm"), ("mine.urdf", "mine")):
        request = dataclasses.replace(PLANAR, robots=[str(tmp_path / file)])
        _, scene = draft_scenario(request, tmp_path / "x.yaml")
        assert [robot.name for robot in scene.robots] == [name]


def test_panels_that_are_fixed_to_the_base_are_no_tips(tmp_path):
    arm = find_urdf("short_arm.urdf").read_text(encoding="utf-8")
    joint = '<joint name="hold" type="fixed"><parent link="base"/><child link="panel"/></joint>'
    file = tmp_path / "with_panel.urdf"
    file.write_text(arm.replace("</robot>", f'<link name="panel"/>{joint}</robot>'))
    _, scene = draft_scenario(dataclasses.replace(PLANAR, robots=[str(file)]), tmp_path / "x.yaml")
    assert [tip.label for tip in scene.tips] == ["with_panel/tip"]


def test_the_message_on_several_ends_names_the_palm_that_they_branch_from(tmp_path):
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><mass value="1"/>{inertia}</inertial>'
    links = "".join(f'<link name="{name}">{inertial}</link>' for name in ("base", "palm", "left", "right"))
    joints = "".join(
        f'<joint name="j{child}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for parent, child in (("base", "palm"), ("palm", "left"), ("palm", "right"))
    )
    hand = tmp_path / "hand.urdf"
    hand.write_text(f'<robot name="hand">{links}{joints}</robot>')
    with pytest.raises(SpaceRobotError, match=r"its ends: left, right; they branch from palm$"):
        draft_scenario(dataclasses.replace(PLANAR, robots=[str(hand)]), tmp_path / "x.yaml")


def test_messages_list_every_link(tmp_path):
    """Ends of an arm, and links of an object, however many there are."""
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    parts = [
        f'<link name="finger_{i:02}"><inertial><mass value="1"/>{inertia}</inertial></link>'
        for i in range(15)
    ]
    parts += [
        f'<joint name="j{i}" type="fixed"><parent link="finger_00"/><child link="finger_{i:02}"/></joint>'
        for i in range(1, 15)
    ]
    hand = str(tmp_path / "hand.urdf")
    Path(hand).write_text(f'<robot name="hand">{"".join(parts)}</robot>')
    for change, first in (({"robots": [hand]}, 1), ({"robots": ["planar_arm.urdf"] * 3, "target": hand}, 0)):
        with pytest.raises(SpaceRobotError) as refused:
            draft_scenario(dataclasses.replace(PLANAR, **change), tmp_path / "x.yaml")
        assert ", ".join(f"finger_{i:02}" for i in range(first, 15)) in str(refused.value)


def test_progress_counts_the_postures_that_are_compared(tmp_path, monkeypatch):
    """Each is a scene of its own, which takes a while for meshes."""
    monkeypatch.setattr("spacerobot.drafting.held.overlaps", lambda scene: ["overlap"])
    words = []
    draft_scenario(PLANAR, tmp_path / "mine.yaml", progress=words.append)
    assert words[:2] == ["choosing a posture", "placing the object"]
    assert words[2].startswith("choosing a posture in which nothing overlaps: 1 of ")
    assert len(words) == 2 + int(words[-1].split()[-1])


def test_joints_of_the_object_are_locked_in_their_range(tmp_path):
    """They have no controller: an antenna would swing beyond its range."""
    antenna = (
        '<link name="dish"><inertial><mass value="2"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="hinge" type="revolute"><parent link="body"/><child link="dish"/><axis xyz="0 0 1"/>'
        '<limit lower="0.5" upper="1" effort="1" velocity="1"/></joint>'
        '<joint name="free" type="continuous"><parent link="body"/><child link="wheel"/></joint>'
        '<link name="wheel"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    file = tmp_path / "object.urdf"
    text = find_urdf("rectangle.urdf").read_text(encoding="utf-8")
    file.write_text(text.replace("</robot>", f"{antenna}</robot>"))
    request = dataclasses.replace(PLANAR, target=str(file), frames=["mate_1"])
    for write in (draft_scenario, draft_capture):
        text, scene = write(request, tmp_path / "x.yaml")
        assert f"hinge: {{angle_deg: {np.degrees(0.75):g}, locked: true}}" in text
        assert "free: {locked: true}" in text
        assert not [name for name in scene.model.names if "hinge" in name or "free" in name]


def test_an_error_of_an_arm_names_its_urdf_not_a_scenario(tmp_path):
    file = tmp_path / "bad.urdf"
    text = find_urdf("short_arm.urdf").read_text(encoding="utf-8")
    file.write_text(re.sub(r'ixx="[^"]*"', 'ixx="-1"', text))
    with pytest.raises(SpaceRobotError) as refused:
        draft_scenario(dataclasses.replace(PLANAR, robots=[str(file)]), tmp_path / "x.yaml")
    assert str(file) in str(refused.value)
    assert "trial" not in str(refused.value)
    assert "x.yaml" not in str(refused.value)
