"""The scene: placement of bodies, mass properties, planarity, naming, what was assumed."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.common.errors import ScenarioError
from spacerobot.scene import load_scene
from tests.oracles.small_scenes import ODD_ARM, PLANAR, SPATIAL, folder, small_scene

WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def frame(scene, name):
    """Placement and velocity of a link by its name in the model."""
    data = scene.model.createData()
    pin.forwardKinematics(scene.model, data, np.array(scene.q), np.array(scene.v))
    pin.updateFramePlacements(scene.model, data)
    index = scene.model.getFrameId(name, pin.FrameType.BODY)
    return data.oMf[index], pin.getFrameVelocity(scene.model, data, index, WORLD)


def planar_tip(base, yaw_deg, angles_deg):
    """Tip of the paper's arm in the complex plane (Eq. 1-4 with their sums put right)."""
    heading = math.radians(yaw_deg)
    tip = base + 0.4 * cmath.exp(1j * heading)
    for angle in angles_deg:
        heading += math.radians(angle)
        tip += 0.35 * cmath.exp(1j * heading)
    return tip


RISING = [40] * 4 + [-40] * 4


def test_paper_closes_at_the_base_worked_out_by_hand():
    scene = load_scene("paper")
    tip_1 = planar_tip(0, 0, RISING)
    tip_2 = planar_tip(0, 180, [-angle for angle in RISING])
    base_2 = tip_1 + 0.4 * math.cos(math.radians(30)) - tip_2
    assert (round(base_2.real, 4), round(base_2.imag, 4)) == (1.8042, 0)
    found = frame(scene, "rpr2/base")[0].translation
    np.testing.assert_allclose(found, [base_2.real, base_2.imag, 0], atol=1e-12)
    np.testing.assert_allclose(
        frame(scene, "rpr1/tip")[0].translation[:2], [tip_1.real, tip_1.imag], atol=1e-12
    )
    centre = frame(scene, "target/body")[0].translation
    np.testing.assert_allclose(
        centre[:2], [tip_1.real + 0.2 * math.cos(math.radians(30)), tip_1.imag], atol=1e-12
    )
    assert any("rpr2.base: placed at (1.8042, 0.0000, 0.0000) m" in told for told in scene.assumptions)


def test_printed_base_does_not_close_the_chain():
    printed = {"joint": "planar", "position": [2.42, 1.214, 0], "rotation_deg": [0, 0, 180]}
    tip_1, tip_2 = planar_tip(0, 0, RISING), planar_tip(2.42 + 1.214j, 180, [-a for a in RISING])
    assert round(abs(tip_2 - tip_1), 3) == 1.549
    gap = abs(tip_2 - tip_1 - 0.4 * math.cos(math.radians(30)))
    with pytest.raises(ScenarioError) as caught:
        load_scene("paper", {"robots.rpr2.base": printed})
    expected = f"grasps.right: does not close: rpr2/tip is {gap:.4g} m from mate_2, allowed max_gap 0.01 m"
    assert expected in str(caught.value)
    assert "place a base by `close_grasp: right`" in str(caught.value)
    wide = load_scene("paper", {"robots.rpr2.base": printed, "grasps.right.max_gap": 1.4})
    np.testing.assert_allclose(frame(wide, "rpr2/base")[0].translation, [2.42, 1.214, 0])


@pytest.mark.parametrize(("text", "mates"), [(PLANAR, ("mate_1", "mate_2")), (SPATIAL, ("left", "right"))])
def test_bases_are_placed_by_closing_grasps(text, mates):
    scene = small_scene(text)
    for robot, mate in zip(("one", "two"), mates, strict=True):
        gap = frame(scene, f"{robot}/tip")[0].translation - frame(scene, f"target/{mate}")[0].translation
        np.testing.assert_allclose(gap, 0, atol=1e-14)
    for body in scene.bodies:
        expected = pin.rpy.rpyToMatrix(np.radians(body.base.rotation_deg))
        placement = frame(scene, f"{body.name}/{body.description.root}")[0]
        np.testing.assert_allclose(placement.rotation, expected, atol=1e-14)


def test_velocities_are_given_in_world_axes():
    scene = small_scene(SPATIAL)
    for body in scene.bodies:
        velocity = frame(scene, f"{body.name}/{body.description.root}")[1]
        np.testing.assert_allclose(velocity.linear, body.base.velocity, atol=1e-15)
        np.testing.assert_allclose(velocity.angular, np.radians(body.base.spin_deg), atol=1e-15)
    joints = {
        name: scene.model.joints[scene.model.getJointId(f"one/{name}")]
        for name in ("slant", "slide", "round")
    }
    assert scene.q[joints["slant"].idx_q] == pytest.approx(math.radians(20))
    assert scene.v[joints["slant"].idx_v] == pytest.approx(math.radians(2))
    assert (scene.q[joints["slide"].idx_q], scene.v[joints["slide"].idx_v]) == (0.05, -0.02)
    start = joints["round"].idx_q
    np.testing.assert_allclose(
        scene.q[start : start + 2], [math.cos(math.radians(-50)), math.sin(math.radians(-50))]
    )


def test_order_and_names_of_bodies():
    scene = small_scene(PLANAR)
    assert [body.name for body in scene.bodies] == ["one", "two", "target"]
    assert [body.path for body in scene.bodies] == ["robots.one", "robots.two", "target"]
    assert [body.name for body in scene.robots] == ["one", "two"]
    assert scene.target is scene.bodies[-1]
    assert [tip.label for tip in scene.tips] == ["one/tip", "two/tip"]
    assert [grasp.name for grasp in scene.grasps] == ["left", "right"]
    assert list(scene.model.names)[1:5] == ["one/root", "one/joint_1", "one/joint_2", "one/joint_3"]
    assert scene.body("two") is scene.bodies[1]
    with pytest.raises(ScenarioError, match="no body 'tow'; did you mean two"):
        scene.body("tow")
    with pytest.raises(ValueError, match="read-only"):
        scene.q[0] = 1
    covered = [joint for body in scene.bodies for joint in body.subtree]
    assert covered == list(range(1, scene.model.njoints))


def test_joint_called_root_keeps_its_name():
    text = (folder() / "odd_arm.urdf").read_text(encoding="utf-8").replace('"slant"', '"root"')
    (folder() / "rooted.urdf").write_text(text, encoding="utf-8")
    scene = small_scene("robots: {a: {urdf: rooted.urdf, joints: {root: {angle_deg: 30}}}}")
    assert list(scene.model.names)[1:3] == ["a/root_", "a/root"]
    assert scene.model.names[scene.bodies[0].root_joint] == "a/root_"
    assert scene.q[scene.model.joints[scene.model.getJointId("a/root")].idx_q] == pytest.approx(math.pi / 6)


def test_mass_properties_come_from_the_urdf_or_the_scenario():
    plain = small_scene(SPATIAL)
    urdf = pin.buildModelFromUrdf(str(folder() / "odd_arm.urdf"), pin.JointModelFreeFlyer())
    for joint in range(1, urdf.njoints):
        name = "one/root" if joint == 1 else f"one/{urdf.names[joint]}"
        found = plain.model.inertias[plain.model.getJointId(name)]
        np.testing.assert_allclose(
            found.toDynamicParameters(), urdf.inertias[joint].toDynamicParameters(), atol=1e-14
        )
    link = plain.scenario.robots["one"].links["a"]
    assert (link.mass, link.com) == (3, (0.1, 0.02, 0))

    given = {"mass": 4.0, "com": [0.1, 0.2, -0.3], "inertia": [0.4, 0.5, 0.6, 0.01, -0.02, 0.03]}
    changed = small_scene(SPATIAL, {f"robots.one.links.a.{key}": value for key, value in given.items()})
    found = changed.model.inertias[changed.model.getJointId("one/slant")]
    assert found.mass == 4.0
    np.testing.assert_allclose(found.lever, [0.1, 0.2, -0.3])
    expected = [[0.4, 0.01, -0.02], [0.01, 0.5, 0.03], [-0.02, 0.03, 0.6]]
    np.testing.assert_allclose(found.inertia, expected, atol=1e-14)
    untouched = changed.model.inertias[changed.model.getJointId("two/slant")]
    assert untouched.mass == 3


def test_welded_links_add_up():
    """The mate of a two-part body: parallel axes by hand."""
    urdf = """<robot name="pair">
<link name="a"><inertial><mass value="2"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="b"><inertial><mass value="3"/>
  <inertia ixx="1" iyy="2" izz="3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="weld" type="fixed"><parent link="a"/><child link="b"/>
  <origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/></joint></robot>"""
    (folder() / "pair.urdf").write_text(urdf, encoding="utf-8")
    inertia = small_scene("robots: {p: {urdf: pair.urdf}}").model.inertias[1]
    assert inertia.mass == 5
    np.testing.assert_allclose(inertia.lever, [0.6, 0, 0])
    apart = 2 * 0.6**2 + 3 * 0.4**2
    np.testing.assert_allclose(np.diag(inertia.inertia), [1 + 2, 1 + 1 + apart, 1 + 3 + apart])


@pytest.mark.parametrize(
    ("text", "changes", "planar"),
    [
        (PLANAR, {}, True),
        (PLANAR, {"gravity": [0, -9.81, 0]}, True),
        (PLANAR, {"gravity": [0, 0, -1e-3]}, False),
        (PLANAR, {"robots.one.base": {"joint": "free_flyer"}}, False),
        (PLANAR, {"robots.one.base": {"joint": "fixed"}}, True),
        (PLANAR, {"robots.one.base": {"joint": "fixed", "rotation_deg": [180, 0, 30]}}, True),
        (PLANAR, {"robots.one.base": {"joint": "fixed", "rotation_deg": [90, 0, 0]}}, False),
        (PLANAR, {"robots.one.base": {"joint": "fixed", "rotation_deg": [0, 1e-3, 0]}}, False),
        (SPATIAL, {}, False),
    ],
)
def test_planar_scenes_are_recognised(text, changes, planar):
    wide = {"grasps.*.max_gap": 10}
    scene = small_scene(text, changes | wide)
    assert scene.planar is planar
    assert scene.translation_axes == ((0, 1) if planar else (0, 1, 2))
    assert scene.rotation_axes == ((2,) if planar else (0, 1, 2))
    assert ("nothing can leave the x-y plane" in scene.assumptions[0]) is planar


def test_assumptions_and_warnings_are_told():
    scene = small_scene(
        PLANAR,
        {
            "robots.two.tips.tip.pid": None,
            "robots.one.tips.tip.reference": None,
            "robots.one.joints.joint_1.angle_deg": 400,
            "grasps.left.rotational_stiffness": 3,
        },
    )
    told = "\n".join(scene.assumptions)
    for part in (
        "no gravity, no orbital motion",
        "robots.two.base: placed at",
        "robots.two: no controller, so its joints are passive",
        "robots.one: ideal sensors",
        "robots.one: torques are not limited",
        "robots.one.tips.tip: no reference given, so it holds its initial pose",
        "robots.one.tips.tip.pid: feeds back the velocity seen from the base",
        "robots.one.tips.tip.pid: ideal derivative",
        "grasps.left: rotational spring at rest in the initial relative orientation",
        "no contact except in the grasps",
    ):
        assert part in told
    (warning,) = [w for w in scene.warnings if "outside" in w]
    assert warning.startswith(
        "robots.one.joints.joint_1: begins at 400 deg, outside the URDF's limits -360 to 360 deg"
    )


def test_reference_derived_from_the_target_needs_a_grasp():
    line = {"kind": "line", "displacement": [0.1, 0, 0]}
    scene = small_scene(PLANAR, {"robots.one.tips.tip.reference": None, "target.reference": line})
    one, two = scene.tips
    assert (one.from_target, two.from_target) == (True, False)
    assert one.reference == scene.scenario.target.reference
    assert two.reference.kind == "line"
    loose = small_scene(
        PLANAR,
        {
            "robots.one.tips.tip.reference": None,
            "target.reference": line,
            "target.base": {"joint": "planar"},
            "robots.two.base": {"joint": "planar"},
            "grasps": {},
        },
    )
    assert (loose.tips[0].from_target, loose.tips[0].reference.kind) == (False, "hold")


def test_links_and_joints_of_the_same_name_are_told_apart():
    """A URDF may call a joint like a link, and either like the joint that this project adds."""
    plain = ODD_ARM.replace('"base"', '"root"')
    same = plain
    for joint, link in (("slant", "a"), ("round", "b"), ("tip_mount", "tip"), ("wrist", "root")):
        same = same.replace(f'joint name="{joint}"', f'joint name="{link}"')
    for name, text in (("plain", plain), ("same", same)):
        (folder() / f"{name}.urdf").write_text(text, encoding="utf-8")
    one, two = (
        small_scene(f"robots: {{r: {{urdf: {name}.urdf, tips: {{tip: {{}}}}}}}}")
        for name in ("plain", "same")
    )
    assert list(two.model.names) == ["universe", "r/root_", "r/a", "r/b", "r/slide", "r/root"]
    np.testing.assert_array_equal(one.q, two.q)
    for link in ("root", "a", "d", "tip", "elbow"):
        np.testing.assert_array_equal(
            frame(one, f"r/{link}")[0].homogeneous, frame(two, f"r/{link}")[0].homogeneous
        )
    bodies = {f.name for f in two.model.frames if f.type == pin.FrameType.BODY}
    assert not bodies & {f.name for f in two.model.frames if f.type != pin.FrameType.BODY}


@pytest.mark.parametrize(
    ("given", "used_by"),
    [
        ("joint_position", {"robots.one.joint_pd": {"kp": 1}}),
        ("joint_rate", {"robots.one.tips.tip.pid.feedback": "base"}),
        ("tip_position", {"robots.one.tips.tip.amnesia": {"ge": 1, "ta": 1}}),
        ("tip_velocity", {"robots.one.tips.tip.pid.feedback": "inertial"}),
        (
            "tip_orientation",
            {
                "robots.one.tips.tip": {
                    "orientation_pid": {"kp": 1},
                    "orientation_amnesia": {"ge": 1, "ta": 1},
                }
            },
        ),
        (
            "tip_angular_velocity",
            {"robots.one.tips.tip": {"orientation_pid": {"kp": 1, "feedback": "inertial"}}},
        ),
    ],
)
def test_a_sensor_error_that_nothing_reads_is_warned_of(given, used_by):
    def told(changes):
        return [w for w in small_scene(PLANAR, changes).warnings if "without effect" in w]

    bare = {"robots.one.tips.tip": {}, f"robots.one.sensors.{given}.offset": 0.1}
    (warning,) = told(bare)
    assert warning.startswith(f"robots.one.sensors.{given}: without effect")
    assert "nothing of this robot reads it" in warning
    base = {"robots.one.tips.tip": {"pid": {"kp": 1}}, f"robots.one.sensors.{given}.offset": 0.1}
    assert told(base | used_by) == []
    assert told({"robots.one.tips.tip": {}, f"robots.one.sensors.{given}.offset": 0}) == []


@pytest.mark.parametrize(
    ("reference", "key"),
    [
        ({"kind": "line", "displacement": [0, 0, 0.1]}, "displacement"),
        ({"kind": "line", "displacement": [0.1, 0, 0], "rotation_deg": [0, 1, 0]}, "rotation_deg"),
        ({"kind": "circle", "plane_deg": [30, 0, 0]}, "plane_deg"),
        ({"kind": "circle", "rotation_deg": [1, 0, 0]}, "rotation_deg"),
        ({"kind": "spline", "times": [0, 1], "displacements": [[0, 0, 0], [0, 0, 1]]}, "displacements.1"),
    ],
)
def test_a_reference_that_leaves_the_plane_is_refused(reference, key):
    with pytest.raises(
        ScenarioError, match=rf"robots\.one\.tips\.tip\.reference\.{key}: leads out of the x-y"
    ):
        small_scene(PLANAR, {"robots.one.tips.tip.reference": reference})
    changes = {"robots.one.tips.tip.reference": None, "target.reference": reference}
    with pytest.raises(ScenarioError, match=rf"target\.reference\.{key}: leads out of the x-y"):
        small_scene(PLANAR, changes)
    assert not small_scene(SPATIAL, {"robots.one.tips.tip.reference": reference}).planar


def test_a_circle_seen_from_below_stays_in_the_plane():
    circle = {"kind": "circle", "plane_deg": [180, 0, 40], "radius": 0.1}
    assert small_scene(PLANAR, {"robots.one.tips.tip.reference": circle}).planar


def out_of_reach(text, changes):
    return [w for w in small_scene(text, changes).warnings if "reaches" in w]


def test_a_reference_beyond_the_arm_is_warned_of():
    """The small arm's base, links and tip laid in one line: 0.3 + 3 x 0.4 m."""
    straight = {"robots.two.joints.*.angle_deg": 0, "robots.two.base": {"joint": "planar"}, "grasps": {}}
    straight |= {"target.base": {"joint": "planar", "position": [9, 9, 0]}}
    for joint in ("planar", "fixed"):
        base = {"robots.two.base": {"joint": joint, "position": [5, 6, 0], "rotation_deg": [0, 0, 90]}}
        line = {"kind": "line", "displacement": [0, 0, 0]}
        assert not out_of_reach(PLANAR, straight | base | {"robots.two.tips.tip.reference": line})
        beyond = line | {"displacement": [0, 0.01, 0]}
        (warning,) = out_of_reach(PLANAR, straight | base | {"robots.two.tips.tip.reference": beyond})
        assert warning == (
            "robots.two.tips.tip.reference: leads two/tip 1.51 m from where its base begins, "
            "the arm reaches 1.5 m"
        )


def test_reach_of_prismatic_joints_and_of_the_targets_reference():
    assert not out_of_reach(SPATIAL, {})
    far = {"kind": "line", "displacement": [0, 0, 0], "rotation_deg": [0, 0, 180]}
    derived = {"robots.*.tips.tip.reference": None, "target.reference": far}
    assert not out_of_reach(SPATIAL, derived)
    spun = {"kind": "spline", "times": [0, 1, 2], "displacements": [[0, 0, 0], [30, 0, 0], [0, 0, 0]]}
    told = out_of_reach(SPATIAL, derived | {"target.reference": spun})
    assert len(told) == 2
    assert all(warning.startswith("target.reference: leads ") for warning in told)


def test_a_value_behind_a_name_that_ends_in_urdf_is_no_file():
    text = ODD_ARM.replace('joint name="slide"', 'joint name="my_urdf"')
    (folder() / "named.urdf").write_text(text, encoding="utf-8")
    scene = small_scene("robots: {r: {urdf: named.urdf}}", {"robots.r.joints.my_urdf": {"offset": 0.1}})
    assert scene.scenario.robots["r"].joints["my_urdf"].offset == 0.1


@pytest.mark.parametrize(("axis", "planar"), [("0 0 1", True), ("0 1 0", False)])
def test_a_scene_of_one_joint_alone(tmp_path, axis, planar):
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    )
    joint = f'<parent link="base"/><child link="rod"/><axis xyz="{axis}"/>'
    (tmp_path / "one.urdf").write_text(
        f'<robot name="one"><link name="base"/><link name="rod">{inertial}</link>'
        f'<joint name="hinge" type="continuous">{joint}</joint></robot>'
    )
    (tmp_path / "one.yaml").write_text("robots: {one: {urdf: one.urdf, base: {joint: fixed}}}")
    scene = load_scene(tmp_path / "one.yaml")
    assert scene.model.nv == 1
    assert scene.planar is planar


@pytest.mark.parametrize(("times", "swings"), [([0, 5, 10], False), ([0, 1e-3, 10], True)])
def test_a_spline_that_swings_far_beyond_its_waypoints_is_warned_of(times, swings):
    points = [[0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]]
    spline = {"kind": "spline", "times": times, "displacements": points}
    found = load_scene("paper", {"robots.rpr1.tips.tip.reference": spline}).warnings
    text = (
        "robots.rpr1.tips.tip.reference: swings 22.2 m beyond its waypoints along x, which lie between 0 and"
    )
    assert any(text in warning for warning in found) is swings
