"""Drafted spacecraft: arms mounted on a bus, and equipment of its base."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from spacerobot.common.errors import ScenarioError
from spacerobot.drafting import DraftRequest, draft, draft_capture
from spacerobot.scene.overlaps import overlaps

ARM = "arm=panda_arm.urdf@0.6,0.1,0,0,90,0"
MISSION = DraftRequest([], "satellite_box.urdf", bus="bus.urdf", mounts=[ARM], include=["wheels", "filters"])


def test_arms_are_mounted_with_their_names_as_prefix(tmp_path):
    mounts = [ARM, "panda_arm.urdf@0.6,-0.5,0"]
    _, scene = draft_capture(dataclasses.replace(MISSION, mounts=mounts), tmp_path / "m.yaml")
    robot = scene.scenario.robots["bus"]
    assert robot.mounts["arm"].position == (0.6, 0.1, 0.0)
    assert robot.mounts["arm"].rotation_deg == (0.0, 90.0, 0.0)
    assert robot.mounts["panda_arm"].position == (0.6, -0.5, 0.0)
    assert scene.tips[0].label == "bus/arm_tip"
    moving = [name for name, state in robot.joints.items() if not state.locked]
    assert moving == [f"arm_panda_joint{i}" for i in range(1, 8)]
    # the second arm of the same make has the same posture, locked
    postures = [
        [robot.joints[f"{arm}_panda_joint{i}"].angle_deg for i in range(1, 8)] for arm in robot.mounts
    ]
    assert postures[0] == postures[1]


def test_the_object_does_not_begin_inside_the_bus(tmp_path):
    """The best posture alone put it there."""
    _, scene = draft_capture(
        dataclasses.replace(MISSION, mounts=["panda_arm.urdf@0.6,0,0,0,90,0"]), tmp_path / "m.yaml"
    )
    assert overlaps(scene) == []


def test_equipment_fits_the_spacecraft(tmp_path):
    """Wheels, and a pair of nozzles, give the whole robot the accelerations that the module states."""
    include = ["wheels", "thrusters", "filters"]
    _, scene = draft_capture(dataclasses.replace(MISSION, include=include), tmp_path / "m.yaml")
    robot = scene.scenario.robots["bus"]
    attitude, position = robot.controllers["attitude"], robot.controllers["position"]
    moment = attitude.kd / (2 * 0.7 * 0.1)
    assert attitude.kp == pytest.approx(moment * 0.1**2, rel=1e-2)
    assert robot.actuators["wheels"].torque_limit == pytest.approx(5e-3 * moment, rel=0.05)
    mass = sum(link.mass for link in robot.links.values())
    assert position.kp == pytest.approx(mass * 0.05**2, rel=1e-2)
    jets = robot.actuators["jets"]
    assert jets.thrust == pytest.approx(2e-3 * mass, rel=0.05)
    wrenches = np.array(
        [np.concatenate([n.direction, np.cross(n.position, n.direction)]) for n in jets.nozzles.values()]
    )
    for column in wrenches.T:  # as much in one sense as in the other, of every force and torque
        assert column.max() > 0
        np.testing.assert_allclose(np.sort(column), np.sort(-column), atol=1e-12)
    assert np.linalg.matrix_rank(wrenches) == 6
    assert set(robot.estimators) == {"object", "attitude"}


def test_a_spacecraft_from_two_urdfs_captures_by_its_filters(tmp_path, interpreted):
    drafted = draft(MISSION, tmp_path / "mission.yaml", capture=True)
    assert drafted.is_verified
    assert "between samples (`spacerobot margins` includes" in drafted.text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mounts": []}, "--mount: found --bus without an arm"),
        ({"mounts": ["panda_arm.urdf@1,2"]}, "--mount: found 'panda_arm.urdf@1,2', allowed:"),
        ({"mounts": ["a=panda_arm.urdf", "a=panda_arm.urdf"]}, "a name of letters and digits that no other"),
        ({"bus": None, "robots": ["panda_arm.urdf"]}, "--mount: found --mount without --bus"),
        ({"include": ["wheel"]}, "--with: found 'wheel'; did you mean wheels"),
        ({"base": "fixed"}, "--with: found a fixed base"),
        ({"tips": ["tpi"]}, "--tip: no link 'tpi' in panda_arm.urdf; did you mean tip"),
        ({"robots": ["panda_arm.urdf"]}, "found 2 robots"),
    ],
)
def test_what_cannot_be_built_is_refused_by_name(tmp_path, change, words):
    with pytest.raises(ScenarioError) as refused:
        draft_capture(dataclasses.replace(MISSION, **change), tmp_path / "x.yaml")
    assert words in str(refused.value)
