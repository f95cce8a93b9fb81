"""Resolving: URDF values filled in, changes made in order, the result written out and read back."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import PinocchioLoop
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.load import to_document, to_yaml, validate
from spacerobot.scenario.paths import get
from spacerobot.scene import build_scene, load_scene
from tests.oracles.small_scenes import PLANAR, SPATIAL, folder, small_scene


def assert_same(one, other):
    np.testing.assert_array_equal(one.q, other.q)
    np.testing.assert_array_equal(one.v, other.v)
    assert one.scenario == other.scenario
    first, second = PinocchioLoop(one), PinocchioLoop(other)
    np.testing.assert_array_equal(first.derivative(0.7, first.x0), second.derivative(0.7, second.x0))


@pytest.mark.parametrize("name", ["paper", "servicer"])
def test_resolved_scenario_reads_back_to_the_same_result(name, tmp_path):
    scene = load_scene(name, {"robots.*.joints.*.damping": 0.3})
    file = tmp_path / "resolved.yaml"
    file.write_text(to_yaml(scene.scenario), encoding="utf-8")
    assert_same(load_scene(file), scene)


@pytest.mark.parametrize("text", [PLANAR, SPATIAL])
def test_resolved_scenario_with_own_urdfs_reads_back_anywhere(text, tmp_path):
    scene = small_scene(text, {"robots.one.links.base.mass": 44})
    file = tmp_path / "resolved.yaml"
    file.write_text(to_yaml(scene.scenario), encoding="utf-8")
    again = load_scene(file)
    assert_same(again, scene)
    assert build_scene(again.scenario).scenario == scene.scenario  # nothing is left to resolve


def test_what_the_urdf_says_is_filled_in_and_what_the_scenario_says_wins():
    document = to_document(small_scene(SPATIAL).scenario)
    assert get(document, "robots.one.joints.slant.damping") == 0.3
    assert get(document, "robots.one.joints.slant.torque_limit") == 8
    assert get(document, "robots.one.joints.slide") == {
        "angle_deg": None,
        "offset": 0.05,
        "rate_deg": None,
        "speed": -0.02,
        "damping": 2.0,
        "torque_limit": 40.0,
        "locked": None,
    }
    assert get(document, "robots.one.links.base.inertia") == [3, 4, 5, 0.2, -0.1, 0.3]
    assert "tip" not in get(document, "robots.one.links")  # a frame without mass
    own = small_scene(SPATIAL, {"robots.one.joints.slant.damping": 1, "robots.one.links.base.mass": 7})
    assert own.scenario.robots["one"].links["base"].com == (0.02, -0.03, 0.05)
    assert own.model.damping[own.model.joints[own.model.getJointId("one/slant")].idx_v] == 1


def test_changes_are_made_in_order_and_reach_the_model():
    changes = [
        ("robots.*.tips.tip.pid.kp", 1),
        ("robots.two.tips.tip.pid.kp", 2),
        ("robots.one.sensors.joint_rate.offset", 0.1),
        ("robots.one.sensors.tip_position.scale", 0.9),  # of a section that the last change opened
    ]
    scene = small_scene(PLANAR, changes)
    robots = scene.scenario.robots
    assert [robot.tips["tip"].pid.kp for robot in robots.values()] == [1, 2]
    assert robots["one"].sensors.joint_rate.offset == 0.1
    assert robots["one"].sensors.tip_position.scale == 0.9
    assert robots["two"].sensors is None
    starred = small_scene(
        PLANAR, {"robots.one.sensors.joint_rate.offset": 0.1, "robots.one.sensors.*.offset": 0.2}
    )
    offsets = {
        signal["offset"] for signal in to_document(starred.scenario)["robots"]["one"]["sensors"].values()
    }
    assert offsets == {0.2}
    assert small_scene(PLANAR, {"robots.*.joints.joint_1.damping": 7}).model.damping[3] == 7


def test_changes_may_be_valid_only_together():
    gone = small_scene(PLANAR, {"robots.one.tips.tip.pid": None, "robots.one.tips.tip.amnesia": None})
    assert gone.scenario.robots["one"].tips["tip"].pid is None
    swapped = small_scene(
        PLANAR,
        [("robots.one.tips.tip.reference.kind", "hold"), ("robots.one.tips.tip.reference", {"kind": "hold"})],
    )
    assert swapped.scenario.robots["one"].tips["tip"].reference.kind == "hold"
    with pytest.raises(ScenarioError, match="the amnesia controller corrects"):
        small_scene(PLANAR, {"robots.one.tips.tip.pid": None})


def test_urdf_may_be_changed():
    changed = small_scene(PLANAR, {"target.urdf": "rectangle.urdf"})  # a shipped one
    assert changed.scenario.target.urdf == "rectangle.urdf"
    assert changed.scenario.target.links["body"].mass == 20
    assert small_scene(PLANAR).scenario.target.urdf == str(folder() / "plate.urdf")


def test_scenarios_find_urdfs_beside_themselves(tmp_path):
    (tmp_path / "sub").mkdir()
    urdf = (folder() / "plate.urdf").read_text(encoding="utf-8")
    (tmp_path / "sub" / "mine.urdf").write_text(urdf, encoding="utf-8")
    file = tmp_path / "s.yaml"
    file.write_text("robots: {a: {urdf: sub/mine.urdf}}", encoding="utf-8")
    scene = load_scene(str(file))
    assert scene.source == file
    assert scene.bodies[0].description.path == tmp_path / "sub" / "mine.urdf"
    # beside the scenario goes before shipped
    (tmp_path / "rectangle.urdf").write_text(urdf, encoding="utf-8")
    file.write_text("robots: {a: {urdf: rectangle.urdf}}", encoding="utf-8")
    assert load_scene(file).model.inertias[1].mass == 8
    assert validate(parse_yaml(to_yaml(load_scene(file).scenario))).robots["a"].urdf == str(
        tmp_path / "rectangle.urdf"
    )


def test_a_change_adds_a_whole_robot():
    own = {"urdf": "planar_arm.urdf", "base": {"joint": "planar", "position": [0, -5, 0]}}
    scene = load_scene("docking", {"robots.third": own})
    assert [body.name for body in scene.robots] == ["rpr1", "rpr2", "third"]
    with pytest.raises(ScenarioError, match=r"robots\.third\.urdf: missing"):
        load_scene("docking", {"robots.third": {"base": {"joint": "planar"}}})


def test_a_document_is_validated_once_and_once_for_all_changes(monkeypatch):
    from spacerobot.scenario import load
    from spacerobot.scene import resolve

    scenario, calls = load_scene("paper").scenario, []
    for module in (resolve, load):
        monkeypatch.setattr(module, "validate", lambda *a, **k: calls.append(1) or validate(*a, **k))
    build_scene(scenario)
    assert len(calls) == 1
    numbers = {"simulation.duration": 3, "robots.*.tips.tip.pid.kp": 3, "robots.*.tips.tip.pid.ki": 3}
    build_scene(scenario, numbers | {"robots.*.tips.tip.pid": {"kp": 3}})
    assert len(calls) == 1 + 2
