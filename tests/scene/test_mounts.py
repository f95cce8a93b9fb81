"""Arms mounted on a bus in the scenario, held to a URDF that was merged by hand."""

import copy
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.common.errors import ScenarioError
from spacerobot.description.find import find_urdf
from spacerobot.scene import build_scene, load_scene
from spacerobot.simulation import simulate

PLACES = {"left": ("0.1 0.5 0.2", "0.3 0.2 1.5"), "right": ("0 -0.5 -0.1", "0 0.4 -1.5")}
REST = """
    base: {joint: free_flyer, spin_deg: [3, -2, 1]}
    joints: {left_joint_2: {angle_deg: 40, rate_deg: 5}, right_joint_1: {angle_deg: -30}}
    tips:
      left: {frame: left_tip, pid: {kp: 90, ki: 30, feedback: base}}
      right: {frame: right_tip, pid: {kp: 50, kd: 2, feedback: inertial}}
simulation: {duration: 0.2, step: 0.01, output_step: 0.05}
"""


def merged_urdf():
    """The bus with both arms, as one would write it."""
    bus = ET.parse(find_urdf("satellite_box.urdf")).getroot()
    for name, (xyz, rpy) in PLACES.items():
        for part in copy.deepcopy(ET.parse(find_urdf("short_arm.urdf")).getroot()):
            if part.tag == "material":
                continue
            part.set("name", f"{name}_{part.get('name')}")
            for end in (*part.findall("parent"), *part.findall("child")):
                end.set("link", f"{name}_{end.get('link')}")
            for visual in part.findall("visual"):
                part.remove(visual)
            bus.append(part)
        weld = ET.SubElement(bus, "joint", name=f"{name}_mount", type="fixed")
        ET.SubElement(weld, "origin", xyz=xyz, rpy=rpy)
        ET.SubElement(weld, "parent", link="body")
        ET.SubElement(weld, "child", link=f"{name}_base")
    return ET.tostring(bus, encoding="unicode")


@pytest.fixture
def scenes(tmp_path):
    """The scene with mounts, and that of the merged URDF."""
    (tmp_path / "merged.urdf").write_text(merged_urdf())
    (tmp_path / "merged.yaml").write_text("robots:\n  bus:\n    urdf: merged.urdf" + REST)
    mounts = ""
    for name, (xyz, rpy) in PLACES.items():
        position, angles = ([float(x) for x in text.split()] for text in (xyz, rpy))
        place = f"position: {position}, rotation_deg: {np.degrees(angles).tolist()}"
        mounts += f"\n      {name}: {{urdf: short_arm.urdf, link: body, {place}}}"
    text = f"robots:\n  bus:\n    urdf: satellite_box.urdf\n    mounts:{mounts}{REST}"
    (tmp_path / "mounted.yaml").write_text(text)
    return load_scene(tmp_path / "mounted.yaml"), load_scene(tmp_path / "merged.yaml")


def test_accelerations_are_those_of_the_merged_urdf(scenes):
    mounted, merged = scenes
    assert list(mounted.model.names) == list(merged.model.names)
    random = np.random.default_rng(3)
    model = mounted.model
    q = pin.integrate(model, np.array(mounted.q), random.normal(size=model.nv))
    v, tau = random.normal(size=(2, model.nv))
    found, wanted = (pin.aba(s.model, s.model.createData(), q, v, tau) for s in (mounted, merged))
    assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("engine", ["casadi", "pinocchio"])
def test_closed_loop_is_that_of_the_merged_urdf(scenes, engine, interpreted):
    changed = [build_scene(s.scenario, {"simulation.engine": engine}, source=s.source) for s in scenes]
    found, wanted = (simulate(scene) for scene in changed)
    error = np.abs(found.data.tip_position.values - wanted.data.tip_position.values)
    assert error.max() < 1e-12
    drift = found.data.momentum_angular - found.data.momentum_angular.isel(time=0)
    assert float(np.abs(drift).max()) < 1e-6


def test_a_resolved_scenario_runs_again_and_a_mount_may_be_changed(scenes):
    mounted, _ = scenes
    again = build_scene(mounted.scenario)
    assert again.body("bus").description.sha256 == mounted.body("bus").description.sha256
    moved = build_scene(mounted.scenario, {"robots.bus.mounts.left.position.0": 0.4})
    joint = moved.model.getJointId("bus/left_joint_1")
    before, after = (s.model.jointPlacements[joint].translation for s in (mounted, moved))
    assert np.allclose(after - before, [0.3, 0, 0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"robots.bus.mounts.left.link": "bodi"}, "no link 'bodi' in satellite_box.urdf; did you mean body"),
        ({"robots.bus.mounts.left.urdf": "short.urdf"}, r"mounts\.left\.urdf: .*did you mean short_arm"),
        ({"robots.bus.joints.lef_joint_1.angle_deg": 3}, "did you mean left_joint_1"),
    ],
)
def test_what_cannot_be_mounted_is_refused_by_name(scenes, change, words):
    with pytest.raises(ScenarioError, match=words):
        build_scene(scenes[0].scenario, change)


def test_links_stand_where_the_scenario_places_them(scenes):
    mounted, _ = scenes
    named = build_scene(mounted.scenario, {"robots.bus.placements": {"left_link_2": {}, "right_tip": {}}})
    assert named.model == mounted.model
    moved = build_scene(named.scenario, {"robots.bus.placements.left_link_2.position.1": 0.4})
    again = build_scene(moved.scenario)
    assert again.body("bus").description.sha256 == moved.body("bus").description.sha256
    joint = moved.model.getJointId("bus/left_joint_2")
    before, after, kept = (s.model.jointPlacements[joint] for s in (mounted, moved, again))
    assert np.allclose(after.translation, [before.translation[0], 0.4, before.translation[2]])
    assert np.array_equal(kept.homogeneous, after.homogeneous)
    turned = build_scene(named.scenario, {"robots.bus.placements.right_tip.rotation_deg": [0, 0, 90]})
    frame = turned.model.frames[turned.model.getFrameId("bus/right_tip")].placement
    assert np.allclose(frame.rotation, pin.rpy.rpyToMatrix(0, 0, np.pi / 2))
    for link, words in (("left_link_9", "did you mean left_link_"), ("body", "has no parent")):
        with pytest.raises(ScenarioError, match=words):
            build_scene(mounted.scenario, {"robots.bus.placements": {link: {}}})
