"""Scenes that cannot be simulated are refused with the place, what was found and what is allowed."""

from __future__ import annotations

import math
import re

import pytest

from spacerobot.common.errors import ScenarioError
from spacerobot.scene import checks, load_scene
from tests.oracles.small_scenes import ODD_ARM, PLANAR, SPATIAL, folder, small_scene

STILL = {
    "robots.*.base.velocity": [0, 0, 0],
    "robots.*.base.spin_deg": [0, 0, 0],
    "target.base.spin_deg": [0, 0, 0],
    "robots.one.joints.joint_1.rate_deg": 0,
}


def rigid(kind: str = "weld") -> dict[str, object]:
    return {
        "grasps.left": {"kind": kind, "tip": "one/tip", "frame": "mate_1"},
        "grasps.right": {"kind": kind, "tip": "two/tip", "frame": "mate_2"},
    }


@pytest.mark.parametrize(
    ("text", "changes", "expected"),
    [
        (
            PLANAR,
            {"target.base.close_grasp": "right"},
            "robots.two.base.close_grasp and target.base.close_grasp wait",
        ),
        (
            PLANAR,
            {"robots.one.base": {"joint": "planar", "close_grasp": "left"}},
            "robots.one.base.close_grasp and robots.two.base.close_grasp and target.base.close_grasp wait",
        ),
        (
            PLANAR,
            {"robots.two.base.close_grasp": "left"},
            "robots.two.base.close_grasp: grasp 'left' holds 'one/tip'",
        ),
        (
            PLANAR,
            {"grasps.left.frame": "mate_3"},
            "grasps.left.frame: no link 'mate_3' in the target's URDF; did you",
        ),
        (
            PLANAR,
            {"robots.one.tips.tap": {}},
            "robots.one.tips.tap: no link 'tap' in arm.urdf; did you mean tip",
        ),
        (PLANAR, {"robots.one.tips.tip.frame": "tipp"}, "robots.one.tips.tip.frame: no link 'tipp'"),
        (
            PLANAR,
            {"robots.one.links.link_9": {"mass": 1}},
            "robots.one.links: no link 'link_9' in the URDF; did you mean",
        ),
        (
            PLANAR,
            {"robots.one.joints.joint_9": {"damping": 1}},
            "robots.one.joints: no moving joint 'joint_9'",
        ),
        (
            PLANAR,
            {"robots.one.joints.joint_1.offset": 1},
            "robots.one.joints.joint_1.offset: not for a revolute joint",
        ),
        (
            SPATIAL,
            {"robots.one.joints.slide.angle_deg": 1},
            "robots.one.joints.slide.angle_deg: not for a prismatic",
        ),
        (PLANAR, {"robots.one.urdf": "arn.urdf"}, "robots.one.urdf: arn.urdf: no such URDF file"),
        (
            PLANAR,
            {"robots.one.tips.nothing.pid.kp": 1},
            "change robots.one.tips.nothing.pid.kp: no 'nothing'",
        ),
        (PLANAR, {"robots.three.urdf": "arm.urdf"}, "change robots.three.urdf: no 'three'"),
        (
            PLANAR,
            {"robots.one.links.link_1.inertia.0": -1},
            "robots.one.links: link 'link_1' is a moving link; it has principal inertias -1, 0.06, 0.06 kg",
        ),
        (
            PLANAR,
            {"robots.one.links.link_3": {"com": [0, 0, 0], "inertia": [0, 0, 0, 0, 0, 0]}},
            "nothing with inertia resists the motion of one/joint_3 in the initial posture",
        ),
        (PLANAR, {"target.links.body.mass": -1}, "target.links.body.mass: found -1, allowed: at least 0"),
        (
            PLANAR,
            {"target.links.body.mass": 0},
            "target.links: link 'body' is the base; it has no mass, nor has anything fixed to it; give it",
        ),
        (
            PLANAR,
            {"target.links.body.mass": 0, "target.links.body.inertia.2": 0.7},
            "target.links: link 'body' is the base; it has an inertia but",
        ),
        (
            PLANAR,
            {"robots.one.tips.tip.amnesia.ta": "x"},
            "robots.one.tips.tip.amnesia.ta: found 'x', allowed: a number",
        ),
        # alignment
        (PLANAR, {"robots.one.base.align": True}, "robots.one.base.align: which grasp? give `close_grasp`"),
        (PLANAR, {"target.base.align": True}, "target.base: give either `rotation_deg` or `align`, not both"),
        (
            PLANAR,
            {"target.base.align_rotation_deg": [0, 0, 5]},
            "target.base.align_rotation_deg: without effect; give `align: true` too",
        ),
        (
            PLANAR,
            {"target.base": {"joint": "planar", "close_grasp": "left", "align_rotation_deg": [5, 0, 0]}},
            "target.base: a planar base turns about z and moves in x and y only",
        ),
        (
            SPATIAL,
            {"target.base": {"joint": "planar", "close_grasp": "left", "align": True}},
            "target.base.align: cannot align grasp 'left': a planar base turns about z alone, and the axes "
            "of one/tip and left remain tilted by",
        ),
        # rigid grasps
        (
            PLANAR,
            rigid()
            | {
                "target.base": {"joint": "fixed", "position": [0.9, 0.2, 0]},
                "robots.one.base": {"joint": "fixed"},
            },
            "grasps.left: does not close: one/tip is",
        ),
        # a joint PD in the null space of a robot without one
        (
            SPATIAL,
            {
                "robots.two.joint_pd": {"kp": 5, "null_space": True},
                "robots.two.tips.tip.orientation_pid": {"kp": 1},
            },
            "robots.two.joint_pd.null_space: two has no null space: its 4 joints move 6 controlled "
            "directions of its tips, of which 4 are independent in the initial posture; leave",
        ),
        (
            PLANAR,
            {
                "robots.one.joint_pd": {"kp": 5, "null_space": True},
                "robots.one.tips.same": {"frame": "tip", "pid": {"kp": 1}},
            },
            "robots.one.joint_pd.null_space: one has no null space: its 3 joints move 4 controlled "
            "directions of its tips, of which 2",
        ),
        (
            PLANAR,
            {
                "robots.one.controllers": {"own": {"kind": "joint_pd", "kp": 5, "null_space": True}},
                "robots.one.tips.tip.controllers": {"same": {"kind": "pid", "kp": 1}},
            },
            "robots.one.controllers.own.null_space: one has no null space: its 3 joints move 4 controlled "
            "directions of its tips, of which 2",
        ),
    ],
)
def test_refusals(text, changes, expected):
    with pytest.raises(ScenarioError) as caught:
        small_scene(text, changes)
    message = str(caught.value).removeprefix(f"{folder() / 'scenario.yaml'}: ")
    assert re.match(re.escape(expected), message), message
    assert "\n" not in message


@pytest.mark.parametrize("key", ["joint_pd", "controllers.own"])
def test_a_null_space_that_leaves_nothing_is_warned_of(key):
    section = {"kind": "joint_pd", "kp": 5, "null_space": True}
    changes = {f"robots.one.{key}": section}

    def told(more):
        return [w for w in small_scene(PLANAR, changes | more).warnings if "without effect" in w]

    assert told({}) == []
    (warning,) = told({"robots.one.tips.tip.orientation_pid": {"kp": 1}})
    assert warning.startswith(f"robots.one.{key}: without effect")


def test_a_spin_about_the_mating_point_stays_in_a_point_and_gives_way_in_a_weld():
    spinning = STILL | {"target.base.spin_deg": [0, 0, 5]}
    loose = {"robots.two.base": {"joint": "planar", "position": [5, 0, 0]}}

    def scene(kind):
        return small_scene(PLANAR, spinning | loose | {"grasps": {"left": rigid(kind)["grasps.left"]}})

    reach, spin = 0.2 * math.cos(math.radians(30)), math.radians(5)
    point, weld = scene("point"), scene("weld")
    # in axes of the body, whose mating frame lies at -reach on its x axis
    assert point.v[-3:] == pytest.approx([0, spin * reach, spin], abs=1e-12)
    assert not any("is replaced by" in warning for warning in point.warnings)
    assert not weld.v.any()
    assert (
        "target.base: `spin_deg` is replaced by (0, 0, 0) deg/s so that grasp 'left' begins closed"
        in weld.warnings
    )


def test_grasps_that_fix_a_freedom_twice():
    both = {
        "left": rigid("weld")["grasps.left"],
        "again": {"kind": "weld", "tip": "one/same", "frame": "mate_1"},
    }
    changes = STILL | {
        "robots.two.base": {"joint": "planar"},
        "robots.one.tips.same": {"frame": "tip"},
        "grasps": both,
    }
    with pytest.raises(ScenarioError) as caught:
        small_scene(PLANAR, changes)
    assert "grasps: the rigid grasps left, again fix 6 freedoms of which only 3 are independent" in str(
        caught.value
    )
    softened = changes | {"grasps": both | {"again": both["again"] | {"kind": "compliant"}}}
    assert len(small_scene(PLANAR, softened).grasps) == 2
    # a fixed base and a straight arm cannot move its tip along itself
    straight = STILL | {
        "robots.one.base": {"joint": "fixed"},
        "robots.one.joints.*.angle_deg": 0,
        "target.base": {"joint": "fixed", "position": [1.5 + 0.2 * math.cos(math.radians(30)), 0, 0]},
        "robots.two.base": {"joint": "planar"},
        "grasps": {"left": rigid("point")["grasps.left"]},
    }
    with pytest.raises(ScenarioError, match="fix 2 freedoms of which only 1 are independent"):
        small_scene(PLANAR, straight)


def test_an_effort_of_zero_is_no_limit_and_is_named():
    (folder() / "zero.urdf").write_text(ODD_ARM.replace('effort="6"', 'effort="0"'), encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"no effort limit .* round \(effort 0 in the URDF\)"):
        small_scene("robots: {a: {urdf: zero.urdf, torque_limits: true}}")


def test_torque_limits_need_a_number_for_every_joint():
    urdf = ODD_ARM.replace(
        '<limit effort="6" velocity="2"/><dynamics damping="0.2"/>', '<dynamics damping="0.2"/>'
    )
    (folder() / "unlimited.urdf").write_text(urdf, encoding="utf-8")
    text = "robots: {a: {urdf: unlimited.urdf, torque_limits: true}}"
    with pytest.raises(ScenarioError) as caught:
        small_scene(text)
    assert str(caught.value).endswith(
        "robots.a.torque_limits: no effort limit in the URDF, nor joints.*.torque_limit, for round"
    )
    scene = small_scene(text, {"robots.a.joints.round.torque_limit": 3})
    limits = {name: joint.torque_limit for name, joint in scene.scenario.robots["a"].joints.items()}
    assert limits == {"slant": 8, "round": 3, "slide": 40, "wrist": 5}


MASSLESS_ROOT = ODD_ARM.replace(
    '<robot name="odd_arm">', '<robot name="on_a_stand"><link name="stand"/>'
).replace(
    "</robot>",
    '<joint name="turn" type="continuous"><parent link="stand"/><child link="base"/></joint></robot>',
)


def test_a_base_needs_mass_only_where_it_floats():
    (folder() / "stand.urdf").write_text(MASSLESS_ROOT, encoding="utf-8")
    text = "robots: {a: {urdf: stand.urdf, base: {joint: %s}}}"
    with pytest.raises(ScenarioError) as caught:
        small_scene(text % "free_flyer")
    assert str(caught.value).endswith(
        "robots.a.links: link 'stand' is the base; it has no mass, nor has anything fixed to it; give it "
        "some, or connect it by `base: {joint: fixed}`"
    )
    scene = small_scene(text % "fixed")
    assert scene.model.nv == 5
    assert not any("stand" in warning for warning in scene.warnings)


def test_a_light_floating_base_is_warned_of_after_all_changes():
    def light(changes):
        return [w for w in small_scene(PLANAR, changes).warnings if "has only" in w]

    speck = {"robots.one.links.base.mass": 1e-3, "robots.one.links.base.inertia": [1e-6] * 3 + [0] * 3}
    assert not light({})
    assert light(speck) == [
        "robots.one: link 'base': the base has only 0.001 kg, other links far more",
        "robots.one: link 'base': the base has only 1e-06 kg m^2, other links far more",
    ]
    loose = {"grasps": {}, "robots.two.base": {"joint": "planar"}, "target.base": {"joint": "planar"}}
    assert not light(speck | loose | {"robots.one.base": {"joint": "fixed"}})


def test_more_velocities_than_pinocchio_has_memory_for(monkeypatch):
    monkeypatch.setattr(checks, "MOST_VELOCITIES", 17)
    with pytest.raises(ScenarioError, match=r"has 18 velocities, allowed are 17: .*locked: true"):
        small_scene(PLANAR, {"target.base": {"joint": "free_flyer", "close_grasp": "left"}})
    assert small_scene(PLANAR).model.nv == 15


def test_scene_in_which_nothing_moves():
    with pytest.raises(ScenarioError, match="nothing can move"):
        small_scene("robots: {a: {urdf: plate.urdf, base: {joint: fixed}}}")


def test_errors_name_the_file(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("robots: {a: {urdf: nothing.urdf}}", encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        load_scene(file)
    assert str(caught.value).startswith(f"{file}: robots.a.urdf: ")
    assert caught.value.source == file


def test_a_release_no_later_than_the_capture_is_refused():
    grasp = {"kind": "compliant", "tip": "one/tip", "frame": "mate_1", "begins": "open"}
    for release in (1.0, 2.0):
        changes = {"grasps.left": grasp | {"capture": {"at": 2.0}, "release": {"at": release}}}
        with pytest.raises(
            ScenarioError, match=r"grasps\.left.*release\.at: found .* later than `capture\.at`"
        ):
            small_scene(PLANAR, changes)
    later = {"grasps.left": grasp | {"capture": {"at": 2.0}, "release": {"at": 2.5}}}
    small_scene(PLANAR, later | {"target.base.close_grasp": None})
