"""Resolved rates with a base that reacts, and in the reaction null space, against Pinocchio's momenta."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.closedloop.stiffness import find_poles
from spacerobot.common.errors import ScenarioError
from spacerobot.description.planar import PlanarBase, PlanarLink, planar_arm_urdf
from spacerobot.pinocchio_engine import simulate
from spacerobot.pinocchio_engine.mechanical_state import MechanicalState
from spacerobot.scene import load_scene
from tests.oracles.motions import DesiredMotions
from tests.oracles.small_scenes import ODD_ARM, random_x, small_scene
from tests.oracles.two_engines import Symbolic

PLANAR = """
robots:
  arm:
    urdf: arm.urdf
    base: {joint: planar}
    joints: {joint_1: {angle_deg: 60}, "joint_*": {angle_deg: -40}}
    tips: {tip: {reference: {kind: line, displacement: [0.1, -0.06, 0], duration: 2}}}
    controllers: {lead: {kind: resolved_rate, orientation: false, damping: 1e-6, OPTIONS}}
simulation: {duration: 3, output_step: 0.5, step: 0.02}
"""
SPATIAL = """
robots:
  arm:
    urdf: odd_arm.urdf
    joints: {slant: {angle_deg: 20}, round: {angle_deg: -50}, slide: {offset: 0.05}, wrist: {angle_deg: 30}}
    tips: {tip: {reference: {kind: line, displacement: [0.03, 0.02, 0], duration: 1}}}
    controllers: {lead: {kind: resolved_rate, orientation: false, damping: 0.1, OPTIONS}}
simulation: {duration: 1, output_step: 0.25, step: 0.02}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("resolved")
    link = PlanarLink(length_m=0.35, mass_kg=4.0, inertia_kg_m2=(0.06, 0.05))
    base = PlanarBase(mass_kg=40.0, inertia_kg_m2=6.0, radius_m=0.3)
    (place / "arm.urdf").write_text(planar_arm_urdf(links=6, link=link, base=base, damping=0.2))
    (place / "odd_arm.urdf").write_text(ODD_ARM)
    return place


def scene_of(folder, options="gain: 2", text=PLANAR):
    file = folder / "scenario.yaml"
    file.write_text(text.replace("OPTIONS", options))
    return load_scene(file)


def flown(folder, options="gain: 2", text=PLANAR):
    """Scene and trajectory."""
    scene = scene_of(folder, options, text)
    settings = scene.scenario.simulation
    return scene, Symbolic(scene).run(settings.duration, settings.output_step, settings.step)


def parts(scene, state):
    """q and v of a state."""
    return state[: scene.model.nq], state[scene.model.nq : scene.model.nq + scene.model.nv]


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_the_base_reacts_as_momentum_tells(folder, text):
    scene, run = flown(folder, text=text)
    size = scene.model.joints[scene.bodies[0].root_joint].nv
    for state in run.state[1:]:
        q, v = parts(scene, state)
        matrix = pin.ccrba(scene.model, scene.model.createData(), q, v)
        base = -np.linalg.lstsq(matrix[:, :size], matrix[:, size:] @ v[size:], rcond=None)[0]
        np.testing.assert_allclose(base, v[:size], atol=1e-9)


def test_the_tip_comes_to_its_reference_though_the_base_gives_way(folder):
    _, run = flown(folder)
    error, moved = run.outputs["tip_error"], run.outputs["body_position"][-1]
    assert np.linalg.norm(moved) > 5e-3  # or nothing is tested
    assert np.linalg.norm(error, axis=1).max() < 2e-5
    assert np.abs(run.outputs["body_rotation"]).max() > 1e-3


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_joints_accelerate_by_the_damped_generalized_jacobian(folder, text):
    """By the gains k of errors and r of rates, with the base's reaction by Pinocchio's inertia and bias:

    ``q'' = J# (x_ref'' + k (x_ref' - x') - g) + r (J# (x_ref' + k e - x' + J q') - q'),
    J# = J^T (J J^T + d^2)^-1``, g the tip's acceleration at q'' = 0, and the last q' as a sensor reads it.
    """
    text = text.replace("orientation: false, damping: 1e-6", "orientation: false, damping: 0.1")
    text = text.replace("orientation: false", "orientation: true")
    text = text.replace(
        "    controllers:", "    sensors: {joint_rate: {offset: 0.02, scale: 0.9}}\n    controllers:"
    )
    scene = scene_of(folder, "gain: 2, rate_gain: 15", text)
    desired, model = DesiredMotions(scene), scene.model
    body = scene.bodies[0]
    joints = [int(model.idx_vs[joint]) for joint in body.driven_joints]
    base = list(range(model.nvs[body.root_joint]))
    axes = [*scene.translation_axes, *(axis + 3 for axis in scene.rotation_axes)]
    for seed in range(2):
        x = random_x(scene, np.random.default_rng(seed), len(desired.x0))
        wanted, (q, v) = desired.at(0.4, x)["arm/tip"], parts(scene, x)
        state = MechanicalState(model, q, v)
        tip = state.frame(scene.tips[0].frame)
        inertia = state.inertia[np.ix_(base, base)]
        reaction = -np.linalg.solve(inertia, state.inertia[np.ix_(base, joints)])
        falling = -np.linalg.solve(inertia, state.bias[base])
        jacobian = (tip.jacobian[:, joints] + tip.jacobian[:, base] @ reaction)[axes]
        error = np.r_[wanted.position - tip.position, pin.log3(wanted.rotation @ tip.rotation.T)]
        rate = np.r_[wanted.velocity, wanted.angular_velocity] - tip.velocity
        ahead = np.r_[wanted.acceleration, wanted.angular_acceleration] + 2 * rate
        ahead = (ahead - tip.drift - tip.jacobian[:, base] @ falling)[axes]
        inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + 0.01 * np.eye(len(axes)))
        rates = inverse @ ((rate + 2 * error)[axes] + jacobian @ v[joints])
        expected = inverse @ ahead + 15 * (rates - (0.02 + 0.9 * v[joints]))
        found = desired.rate(0.4, x)[model.nq : model.nq + model.nv][joints]
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


PAYLOAD = {"mass": 5, "com": [0.1, -0.05, 0.2], "inertia": [0.5, 0.6, 0.7, 0.02, -0.03, 0.04]}


def test_a_payload_counts_as_a_link_at_the_tip(folder):
    """Torques of a robot with that link are those for half a payload of twice its numbers, in any posture."""
    xx, yy, zz, xy, xz, yz = PAYLOAD["inertia"]
    link = f"""<link name="load"><inertial><origin xyz="{" ".join(map(str, PAYLOAD["com"]))}"/>
      <mass value="{PAYLOAD["mass"]}"/>
      <inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="{xz}" iyz="{yz}"/></inertial></link>
      <joint name="hold" type="fixed"><parent link="tip"/><child link="load"/></joint></robot>"""
    (folder / "loaded.urdf").write_text(ODD_ARM.replace("</robot>", link))
    twice = {
        f"robots.arm.controllers.lead.payload_{key}": (2 * np.array(PAYLOAD[key])).tolist()
        for key in ("mass", "inertia")
    }
    twice |= {"robots.arm.controllers.lead.payload_com": PAYLOAD["com"]}
    twice |= {"robots.arm.controllers.lead.payload_fraction": 0.5}
    pull, torques = {"gravity": [0.3, -0.5, 0.2]}, []
    for urdf, changes in (("loaded", {}), ("odd_arm", twice)):
        scene_of(folder, "gain: 2", SPATIAL.replace("odd_arm", urdf))
        scene = load_scene(folder / "scenario.yaml", pull | changes)
        own = Symbolic(scene)
        x = random_x(scene, np.random.default_rng(4), len(own.x0))
        torques.append(own.outputs(0.4, x)["joint_torque"])
    assert np.abs(torques[0]).max() > 1
    np.testing.assert_allclose(torques[0], torques[1], rtol=1e-9)


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_the_attitude_is_kept_in_the_reaction_null_space(folder, text):
    _, run = flown(folder, "keeps: attitude", text)
    assert np.abs(run.outputs["body_rotation"]).max() < 1e-9
    assert np.abs(run.outputs["body_position"][-1]).max() > 2e-5
    if text is PLANAR:
        assert np.linalg.norm(run.outputs["tip_error"], axis=1).max() < 2e-5


def test_the_whole_base_is_kept_and_has_no_momentum(folder):
    scene, run = flown(folder, "keeps: base")
    inertia = scene.model.inertias[1]
    for state in run.state:
        _, v = parts(scene, state)
        motion = pin.Motion(np.array([v[0], v[1], 0]), np.array([0, 0, v[2]]))
        np.testing.assert_allclose((inertia * motion).vector, 0, atol=1e-9)
    assert np.linalg.norm(run.outputs["tip_error"], axis=1).max() < 2e-5
    assert np.abs(run.outputs["tip_position"][-1] - run.outputs["tip_position"][0]).max() > 0.09


def test_momentum_that_there_is_does_not_turn_a_base_whose_attitude_is_kept(folder):
    scene_of(folder, "keeps: attitude")
    scene = load_scene(folder / "scenario.yaml", {"robots.arm.joints.joint_2.rate_deg": 4.0})
    run = Symbolic(scene).run(1.0, 0.25, 0.02)
    assert np.abs(run.outputs["body_momentum_angular"]).max() > 0.1
    assert np.abs(run.outputs["body_rotation"]).max() < 1e-9


@pytest.mark.parametrize(
    ("options", "change", "told"),
    [
        ("keeps: base", {"robots.arm.joints.joint_*.locked": True}, "cannot keep 3 velocities of the base"),
        ("keeps: attitude", {"robots.arm.base.joint": "fixed"}, "the base of arm is fixed"),
    ],
)
def test_what_cannot_be_kept_is_refused(folder, options, change, told):
    scene_of(folder, options)
    if "locked" in next(iter(change)):
        change = {f"robots.arm.joints.joint_{i}.locked": True for i in range(3, 7)}
    with pytest.raises(ScenarioError, match=told):
        load_scene(folder / "scenario.yaml", change)


LED = "robots.arm.controllers"
POSTURE = {
    LED: {},
    "robots.arm.tips.tip.pid": {"kp": 300, "ki": 0, "kd": 40, "feedback": "inertial"},
    "robots.arm.joint_pd": {"kp": 0, "kd": 10, "null_space": True},
}
LAWS = {"resolved": {}, "null space": POSTURE}


def jammed(folder, changes, *, at=0.0, known=True, mode="locked", duration=1.0, engine=False):
    """Outputs of the arm whose joint 3 is held from a time on; at -1 it is no joint from the start."""
    failure = {"kind": "joint_failure", "joint": "joint_3", "mode": mode, "at": at, "known": known}
    own = (
        {"robots.arm.actuators": {"jam": failure}} if at >= 0 else {"robots.arm.joints.joint_3.locked": True}
    )
    scene_of(folder)
    scene = load_scene(folder / "scenario.yaml", changes | own)
    if engine:
        return simulate(scene, duration_s=duration, output_step_s=0.25).outputs
    return Symbolic(scene).run(duration, 0.25, 0.02).outputs


@pytest.mark.parametrize("changes", LAWS.values(), ids=LAWS)
def test_with_a_joint_known_to_be_locked_it_is_the_law_of_the_arm_without_that_joint(folder, changes):
    """Of the Jacobian without the joint's column; in both engines."""
    known, without, unknown = (
        jammed(folder, changes, **options) for options in ({}, {"at": -1.0}, {"known": False})
    )
    for name in ("tip_position", "tip_error", "body_rotation"):
        np.testing.assert_allclose(known[name], without[name], atol=1e-9, err_msg=name)
    assert np.abs(unknown["tip_position"] - known["tip_position"]).max() > 1e-6
    other = jammed(folder, changes, engine=True)
    np.testing.assert_allclose(other["tip_position"], known["tip_position"], atol=1e-6)


@pytest.mark.parametrize(("mode", "most"), [("locked", 2e-6), ("runaway", 1e-9)])
def test_the_tip_keeps_to_its_reference_with_the_joints_that_are_left(folder, mode, most):
    ends = {}
    for known in (True, False):
        found = jammed(folder, {}, at=0.9, known=known, mode=mode, duration=3.0)
        ends[known] = float(np.linalg.norm(found["tip_error"], axis=1).max())
    assert ends[True] < most < 3 * most < ends[False]


DOCKING = """
robots:
  one:
    urdf: arm.urdf
    base: {joint: planar}
    joints: {joint_1: {angle_deg: 60}, joint_2: {angle_deg: -70}, joint_3: {angle_deg: -30}}
    tips:
      tip:
        reference: {kind: rendezvous, frame: mate_1, standoff: 0.05, approach_time: 1, closing_speed: 0.1,
                    end_distance: 0}
    controllers: {lead: {kind: resolved_rate, orientation: false}}
target:
  urdf: plate.urdf
  base: {joint: planar, position: [1.35, 0.35, 0], velocity: [0.02, 0.03, 0], spin_deg: [0, 0, 3]}
grasps:
  left: {tip: one/tip, frame: mate_1, kind: compliant, stiffness: 90, damping: 7, begins: open,
         capture: {distance: 0.002}}
simulation: {duration: 2, step: 0.01, output_step: 0.1}
"""
JAM = {"kind": "joint_failure", "joint": "joint_3", "at": 0.5}
BRAKED = {"kind": "momentum_observer", "period": 0.01, "allowance": 0.05, "joint_noise": 1e-5}


@pytest.mark.parametrize(
    ("actuators", "captures"),
    [
        ({"jam": JAM | {"known": True}}, True),
        ({"jam": JAM}, False),
        ({"watch": BRAKED, "jam": JAM | {"mode": "free"}}, True),
    ],
    ids=["known", "unknown", "detected and braked"],
)
def test_a_docking_succeeds_where_the_law_knows_of_the_lock(actuators, captures):
    scene = small_scene(DOCKING, {"robots.one.actuators": actuators})
    events = [event["kind"] for event in sr.simulate(scene, backend="interpreted").summary["events"]]
    assert ("captured" in events) == captures
    assert ("detected" in events) == ("watch" in actuators)


def test_what_controllers_cannot_know_is_refused():
    with pytest.raises(ScenarioError, match=r"jam\.known: found true, allowed: where `mode` is locked or"):
        small_scene(DOCKING, {"robots.one.actuators": {"jam": JAM | {"mode": "free", "known": True}}})


HOLDING = PLANAR.replace(
    "\nsimulation:",
    """
target: {urdf: ball.urdf, base: {joint: planar, close_grasp: hold}}
grasps: {hold: {tip: arm/tip, frame: body, kind: weld}}
simulation:""",
)


@pytest.mark.parametrize("payload", [True, False])
def test_the_poles_stay_where_they_are_with_a_payload(folder, payload):
    """Tip errors fade with the gain, rates with the rate gain, if the controller knows what it holds."""
    plain = scene_of(folder, "gain: 2, rate_gain: 10", HOLDING)
    body = plain.model.inertias[plain.bodies[-1].root_joint]
    data = plain.model.createData()
    pin.framesForwardKinematics(plain.model, data, plain.q)
    grasp = plain.grasps[0]
    held = data.oMf[grasp.tip.frame].actInv(data.oMi[plain.bodies[-1].root_joint]).act(body)
    about = held.inertia
    moments = [float(about[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    told = f", payload_mass: {held.mass}, payload_com: {held.lever.tolist()}, payload_inertia: {moments}"
    scene = scene_of(folder, "gain: 2, rate_gain: 10" + told * payload, HOLDING)
    loop = build_closed_loop(scene)
    x, c = (part.full().ravel() for part in loop.setup(loop.parameter_values))
    found = find_poles(loop, 0.0, x, c)
    fast = found[np.abs(found) > 0.5]
    apart = np.abs(fast[:, None] + [2.0, 10.0]).min(axis=1)
    # two directions of the tip, and rates of six joints; near them while the reference moves the tip
    assert (np.sort(apart)[:8].max() < 0.05) == payload
