"""Joints that mimic others: one coordinate for several joints, held to Pinocchio's projected algorithms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.common.errors import ScenarioError
from spacerobot.scene import Scene
from spacerobot.scene.configure import relative_jacobian
from tests.oracles.small_scenes import folder, random_x, small_scene
from tests.oracles.two_engines import ENGINES, Numeric, Symbolic, part

INERTIAL = """<inertial><origin xyz="0.05 {y} 0.1" rpy="0.3 0 0.2"/><mass value="{mass}"/>
  <inertia ixx="0.05" iyy="0.06" izz="0.07" ixy="0.01" ixz="0" iyz="0.02"/></inertial>"""
LINKS = {"base": 20, "upper": 3, "fore": 2, "wheel": 1, "hand": 1.5, "left": 0.4, "right": 0.3, "drum": 0.6}
JOINTS = [
    ("shoulder", "revolute", "base", "upper", "0.6 0 0.8", ""),
    # an elbow that is driven by the shoulder's belt: the tip's Jacobian feels it
    ("elbow", "revolute", "upper", "fore", "0 1 0", 'joint="shoulder" multiplier="-0.7" offset="0.2"'),
    ("spin", "continuous", "fore", "wheel", "0 1 0", 'joint="wrist" multiplier="2.5"'),
    ("wrist", "continuous", "fore", "hand", "1 0 0", ""),
    ("close", "prismatic", "hand", "left", "0 1 0", ""),
    ("follow", "prismatic", "hand", "right", "0 1 0", 'joint="close" multiplier="-1" offset="0.01"'),
    # a follower of a follower, and one of another kind than what it follows
    ("roll", "revolute", "right", "drum", "0 0 1", 'joint="follow" multiplier="30"'),
]
TIES = {"elbow": ("shoulder", -0.7, 0.2), "spin": ("wrist", 2.5, 0), "follow": ("close", -1, 0.01)} | {
    "roll": ("close", -30, 0.3)
}
SCENARIO = """
name: gripper
robots:
  one:
    urdf: gripper.urdf
    base: {joint: free_flyer, rotation_deg: [20, -30, 40], spin_deg: [1, -2, 3]}
    joints:
      shoulder: {angle_deg: 30, rate_deg: 4}
      wrist: {angle_deg: 50, rate_deg: -20}
      close: {speed: 0.01}
    tips:
      tip:
        frame: drum
        pid: {kp: 30, ki: 20, kd: 4}
        amnesia: {ge: 4, ta: 2}
        reference: {kind: line, displacement: [0.05, -0.1, 0.03], duration: 0.5}
target: {urdf: flapped_box.urdf, base: {close_grasp: hold}}
grasps: {hold: {tip: one/tip, frame: left, kind: compliant, stiffness: 90, damping: 7}}
simulation: {duration: 1, step: 0.002}
"""
PASSIVE = {"robots.one.tips.tip.pid": None, "robots.one.tips.tip.amnesia": None}
AT_REST = {
    "robots.one.base": {"joint": "free_flyer"},
    "robots.one.joints.shoulder.rate_deg": 0,
    "robots.one.joints.wrist.rate_deg": 0,
    "robots.one.joints.close.speed": 0,
    "target.joints.hinge.rate_deg": 0,
}
SENSORS = {
    "joint_rate": {"offset": 0.02, "scale": 0.9},
    "joint_position": {"offset": 0.01, "scale": 1.05},
}
CASES = {
    "tip control": {},
    "sensors": {"robots.one.sensors": SENSORS},
    "joint control": {"robots.one.joint_pd": {"kp": 9, "kd": 2}},
    "null space": {
        "robots.one.joint_pd": {"kp": 9, "kd": 2, "null_space": True},
        "robots.one.sensors": SENSORS,
        "robots.one.tips.tip.pid.feedback": "inertial",
    },
    "limits": {"robots.one.torque_limits": True, "robots.one.joints.shoulder.torque_limit": 0.5},
    "rigid grasp": AT_REST
    | {"grasps.hold": {"tip": "one/tip", "frame": "left", "kind": "weld"}, "robots.one.joint_pd": {"kp": 9}},
}


def urdf() -> str:
    links = [
        f'<link name="{name}">{INERTIAL.format(mass=mass, y=0.02 * i)}</link>'
        for i, (name, mass) in enumerate(LINKS.items())
    ]
    joints = [
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.2 0.05 0.1" rpy="0.2 0 0.4"/><axis xyz="{axis}"/>'
        f"{f'<mimic {mimics}/>' if mimics else ''}"
        f'<limit lower="-3" upper="3" effort="8" velocity="2"/><dynamics damping="0.{i}"/></joint>'
        for i, (name, kind, parent, child, axis, mimics) in enumerate(JOINTS)
    ]
    return f'<robot name="gripper">{"".join(links + joints)}</robot>'


def gripper(changes: dict[str, object] | None = None, text: str = SCENARIO) -> Scene:
    (folder() / "gripper.urdf").write_text(urdf(), encoding="utf-8")
    return small_scene(text, changes)


def tied_x(scene: Scene, rng: np.random.Generator, size: int) -> np.ndarray:
    """A random state in which joints follow what they mimic."""
    x, model = random_x(scene, rng, size), scene.model
    x[model.nq : model.nq + model.nv] = scene.spread @ x[model.nq : model.nq + model.nv]
    angles = {joint: rng.uniform(-1, 1) for joint in scene.bodies[0].free_joints}
    angles |= {tie.joint: tie.multiplier * angles[tie.leader] + tie.offset for tie in scene.ties}
    for joint, angle in angles.items():
        at, count = model.idx_qs[joint], model.nqs[joint]
        x[at : at + count] = [np.cos(angle), np.sin(angle)] if count == 2 else angle
    return x


def test_ties_are_what_the_urdf_says():
    scene = gripper()
    names = [name.removeprefix("one/") for name in scene.model.names]
    found = {names[t.joint]: (names[t.leader], t.multiplier, t.offset) for t in scene.ties}
    assert found == TIES
    assert [names[joint] for joint in scene.bodies[0].free_joints] == ["shoulder", "wrist", "close"]
    assert set(scene.scenario.robots["one"].joints) == {name for name, *_ in JOINTS}
    assert scene.scenario.robots["one"].joints["elbow"].angle_deg is None


@pytest.mark.parametrize("engine", ENGINES)
def test_acceleration_is_pinocchios_projected(engine):
    """``E^T M E a = E^T (tau - h)``: inertia and bias by CRBA and RNEA of the tree without ties."""
    scene = gripper(PASSIVE | {"grasps": {}, "target": None, "gravity": [0.1, -0.3, 1.62]})
    own, model, rng = ENGINES[engine](scene), scene.model, np.random.default_rng(5)
    spread = scene.spread
    free = spread[:, np.diag(spread) > 0]
    assert free.shape == (model.nv, 6 + 3)
    for _ in range(5):
        x = tied_x(scene, rng, own.x0.size)
        q, v = x[: model.nq], x[model.nq : model.nq + model.nv]
        inertia = pin.crba(model, model.createData(), q)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        bias = pin.rnea(model, model.createData(), q, v, np.zeros(model.nv)) + model.damping * v
        expected = free @ np.linalg.solve(free.T @ inertia @ free, -free.T @ bias)
        found = own.rate(0, x)[model.nq : model.nq + model.nv]
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


def test_projected_inertia_is_that_of_pinocchios_mimic_joints():
    """Of what Pinocchio's own mimic joints cover: revolute and prismatic ones, and no follower's follower."""
    fixed = {"grasps": {}, "target": None, "robots.one.base": {"joint": "fixed"}}
    # the wheel is locked where the wrist begins
    still = {"robots.one.joints.spin.locked": True, "robots.one.joints.wrist.angle_deg": 0}
    scene = gripper(PASSIVE | fixed | still)
    text = urdf().replace('joint="follow" multiplier="30"', 'joint="close" multiplier="-30" offset="0.3"')
    text = text.replace('name="spin" type="continuous"', 'name="spin" type="fixed"')
    text = text.replace('<mimic joint="wrist" multiplier="2.5"/>', "")
    model = pin.buildModelFromXML(text, mimic=True)
    assert model.nv == 3
    free = scene.spread[:, np.diag(scene.spread) > 0]
    rng = np.random.default_rng(3)
    x = tied_x(scene, rng, scene.model.nq + scene.model.nv)[: scene.model.nq]
    free_joints = scene.bodies[0].free_joints
    q = np.concatenate([x[scene.model.idx_qs[j] :][: scene.model.nqs[j]] for j in free_joints])
    inertia = np.triu(pin.crba(scene.model, scene.model.createData(), x))
    inertia = inertia + np.triu(inertia, 1).T
    expected = np.triu(pin.crba(model, model.createData(), q))
    np.testing.assert_allclose(np.triu(free.T @ inertia @ free), expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("case", CASES)
def test_engines_agree(case):
    scene = gripper(CASES[case])
    first, second, rng = Symbolic(scene), Numeric(scene), np.random.default_rng(2)
    assert first.names == second.names
    np.testing.assert_allclose(first.x0, second.x0, rtol=1e-12, atol=1e-12)
    for _ in range(4):
        x = tied_x(scene, rng, first.x0.size)
        found, expected = first.rate(0.3, x), second.rate(0.3, x)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())
        outputs = first.outputs(0.3, x)
        for name, value in second.outputs(0.3, x).items():
            scale = max(1.0, np.abs(value).max(initial=0.0))
            np.testing.assert_allclose(outputs[name], value, atol=1e-9 * scale, err_msg=name)


def test_actuators_of_joints_that_mimic_push_where_they_follow():
    """Their torques stand at the joints they follow, and do the same work."""
    scene = gripper(CASES["joint control"])
    own, model = Symbolic(scene), scene.model
    x = tied_x(scene, np.random.default_rng(1), own.x0.size)
    torque = own.outputs(0.1, x)["joint_torque"]
    arm = sorted(joint for body in scene.bodies for joint in body.joints)
    tied = [arm.index(tie.joint) for tie in scene.ties]
    assert np.all(torque[tied] == 0)
    assert np.all(torque[[arm.index(joint) for joint in scene.bodies[0].free_joints]] != 0)
    power = part(own, own.rate(0.1, x), "work.actuator")
    v = x[model.nq : model.nq + model.nv][[model.idx_vs[joint] for joint in arm]]
    assert power == pytest.approx(torque @ v)


@pytest.mark.parametrize("engine", ENGINES)
def test_ties_momentum_and_energy_hold_over_a_rollout(engine):
    scene = gripper()
    ran, model = ENGINES[engine](scene).run(0.4, 0.1, step_s=1e-3), scene.model
    for tie in scene.ties:
        follower, leader = (ran.state[:, model.nq + model.idx_vs[joint]] for joint in (tie.joint, tie.leader))
        tolerance = 1e-12 * max(1, abs(tie.multiplier))
        np.testing.assert_allclose(follower, tie.multiplier * leader, atol=tolerance)
        if model.nqs[tie.joint] == 1:
            follower, leader = (ran.state[:, model.idx_qs[joint]] for joint in (tie.joint, tie.leader))
            np.testing.assert_allclose(follower, tie.multiplier * leader + tie.offset, atol=1e-11)
    y = ran.outputs
    for name in ("momentum_linear", "momentum_angular"):
        np.testing.assert_allclose(y[name], np.tile(y[name][0], (len(y[name]), 1)), atol=2e-9)
    stored = y["energy_kinetic"] + y["energy_spring"]
    balance = stored - stored[0] - y["work_actuator"] + y["work_joint"] + y["work_grasp"]
    assert np.abs(balance).max() < 1e-8 * np.abs(stored).max()
    assert abs(y["work_actuator"]).max() > 1e-3


def test_locked_joints_take_along_what_follows_them():
    locks = {"robots.one.joints.shoulder": {"locked": True, "angle_deg": 40}}
    joints = {joint.name: joint for joint in gripper(locks).bodies[0].description.joints}
    free = {joint.name: joint for joint in gripper().bodies[0].description.joints}
    assert joints["shoulder"].kind == joints["elbow"].kind == "fixed"
    turn = pin.AngleAxis(np.radians(40), np.array([0.6, 0, 0.8])).toRotationMatrix()
    np.testing.assert_allclose(joints["shoulder"].origin[:3, :3], free["shoulder"].origin[:3, :3] @ turn)
    turn = pin.AngleAxis(0.2 - 0.7 * np.radians(40), np.array([0.0, 1, 0])).toRotationMatrix()
    np.testing.assert_allclose(joints["elbow"].origin[:3, :3], free["elbow"].origin[:3, :3] @ turn)


def test_a_locked_scene_begins_where_the_free_one_does():
    """Bodies do not depend on whether a joint is locked, nor on how the lock is written."""
    text = SCENARIO.replace("rate_deg: 4}", "rate_deg: 0}\n      's*': {locked: true}")
    written = gripper(text=text)
    changed = gripper({"robots.one.joints.shoulder.rate_deg": 0, "robots.*.joints.s*.locked": True})
    frames = []
    for scene in (gripper(), written, changed):
        data = scene.model.createData()
        pin.framesForwardKinematics(scene.model, data, scene.q)
        ids = [scene.model.getFrameId(f"one/{name}", pin.FrameType.BODY) for name in LINKS]
        frames.append([data.oMf[frame].homogeneous for frame in ids])
    np.testing.assert_allclose(frames[1], frames[0], atol=1e-14)
    np.testing.assert_allclose(frames[2], frames[0], atol=1e-14)
    assert written.model.nv == changed.model.nv == gripper().model.nv - 3  # shoulder, elbow and spin
    assert np.abs(written.spread - changed.spread).max() == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robots.one.joints.elbow.angle_deg": 3}, r"joints\.elbow\.angle_deg: this joint mimics 'shoulder'"),
        ({"robots.one.joints.roll.torque_limit": 3}, r"roll\.torque_limit: this joint mimics 'follow'"),
        ({"robots.one.joints.shoulder.locked": True}, r"joints\.shoulder: a locked joint has no rate"),
        ({"robots.one.joints.x*.locked": True}, r"joints\.x\*\.locked: `x\*` finds nothing here"),
        ({"robots.one.joints": {"x*": {"locked": True}}}, r"joints: no moving joint 'x\*' in the URDF"),
        ({"robots.one.joints.shoulder.locked": 1.5}, r"shoulder\.locked: found 1\.5, allowed: true or false"),
    ],
)
def test_what_is_refused_of_locks_and_followers(changes, message):
    with pytest.raises(ScenarioError, match=message):
        gripper(changes)


def test_mimicry_that_leads_nowhere_is_named_at_once_and_may_be_locked():
    path = folder() / "gripper.urdf"
    text = urdf().replace('joint="wrist"', 'joint="wirst"').replace('joint="close"', 'joint="roll"')
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        small_scene(SCENARIO)
    message = str(caught.value)
    assert "joint 'spin': mimics 'wirst', which does not exist (did you mean wrist?)" in message
    assert "the same fault: follow, roll" in message
    changes = {"robots.one.joints.spin.locked": True, "robots.one.joints.follow.locked": True}
    scene = small_scene(SCENARIO, changes)
    assert [scene.model.names[tie.joint] for tie in scene.ties] == ["one/elbow"]


def test_a_grasp_that_no_base_closes_begins_without_slip_and_tied():
    """A base that moves in a plane only takes what it can, the joints and what mimics them the rest."""
    point = {"grasps.hold": {"tip": "one/tip", "frame": "left", "kind": "point"}}
    fixed = {
        "robots.one.base": {"joint": "fixed"},
        "robots.one.tips.tip.pid": None,
        "robots.one.tips.tip.amnesia": None,
    }
    placed = gripper(point | fixed | {"target.base": {"joint": "free_flyer"}})
    height = placed.q[placed.model.idx_qs[placed.target.root_joint] + 2]
    scene = gripper(point | fixed | {"target.base": {"joint": "planar", "position": [0, 0, float(height)]}})
    slip = relative_jacobian(scene, scene.grasps[0])
    np.testing.assert_allclose(slip @ scene.v, 0, atol=1e-12)
    np.testing.assert_allclose(scene.spread @ scene.v, scene.v, atol=1e-12)
    assert np.abs(scene.v).max() > 1e-2
    x0, nq = Symbolic(scene).x0, scene.model.nq
    np.testing.assert_allclose(x0[:nq], scene.q, atol=1e-13)
    np.testing.assert_allclose(x0[nq : nq + scene.model.nv], scene.v, atol=1e-13)
