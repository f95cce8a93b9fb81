"""Impedance of a tip: closed form with a base that reacts, passivity, gradients, engines, null space."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import PinocchioLoop
from spacerobot.scene import load_scene
from tests.oracles.small_scenes import ODD_ARM, random_x

BASE_MASS, TIP_MASS = 10.0, 4.0
SLIDER = f"""<robot name="slider">
<link name="base"><inertial><mass value="{BASE_MASS}"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<link name="mass"><inertial><mass value="{TIP_MASS}"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<link name="tip"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="mass"/><axis xyz="1 0 0"/>
  <limit lower="-9" upper="9" effort="1000" velocity="100"/></joint>
<joint name="mount" type="fixed"><parent link="mass"/><child link="tip"/></joint>
</robot>"""
SLIDING = """
robots:
  arm:
    urdf: slider.urdf
    base: {joint: JOINT}
    joints: {slide: {offset: 0.4, speed: SPEED}}
    tips:
      tip:
        reference: {kind: line, displacement: [0, 0, 0], duration: 1}
        controllers: {soft: {kind: impedance, stiffness: [50, 0, 0], damping: [8, 0, 0]}}
simulation: {duration: 3, output_step: 0.05, step: 0.005}
"""
SPATIAL = """
robots:
  arm:
    urdf: odd_arm.urdf
    joints:
      slant: {angle_deg: 20}
      round: {angle_deg: -50}
      slide: {offset: 0.05}
      wrist: {angle_deg: 30}
    tips:
      tip:
        reference: {kind: line, displacement: [0.06, 0.1, -0.05], rotation_deg: [30, -40, 20], duration: 0.2}
        controllers:
          soft: {kind: impedance, stiffness: [50, 80, 30]}
          orientation_soft: {kind: impedance, stiffness: [3, 8, 5]}
simulation: {duration: 2, output_step: 0.02, step: 0.002}
"""
SOFT, TURN = (f"robots.arm.tips.tip.controllers.{key}" for key in ("soft", "orientation_soft"))
UNDAMPED = {f"robots.arm.joints.{name}.damping": 0 for name in ("slant", "round", "slide")}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("impedance")
    (place / "slider.urdf").write_text(SLIDER)
    (place / "odd_arm.urdf").write_text(ODD_ARM)
    return place


def scene_of(folder, text=SPATIAL, changes=None):
    file = folder / "scenario.yaml"
    file.write_text(text)
    return load_scene(file, changes or {})


@pytest.mark.parametrize("joint", ["planar", "fixed"])
def test_a_mass_at_the_tip_swings_as_its_closed_form(folder, joint):
    """``Lambda x'' + d x' + k x = 0`` with ``Lambda = m (M + m) / M``; a fixed base has ``Lambda = m``."""
    speed, floats = 0.3, joint == "planar"
    share = TIP_MASS / (BASE_MASS + TIP_MASS) if floats else 0.0  # of the speed that the base takes
    inertia = TIP_MASS / (1 - share)
    text = SLIDING.replace("JOINT", joint).replace("SPEED", str(speed))
    changes = {"robots.arm.base.velocity": [-share * speed, 0, 0]} if floats else {}
    data = sr.simulate(scene_of(folder, text, changes), backend="interpreted").data
    decay, t = 8 / (2 * inertia), data.time.values
    frequency = np.sqrt(50 / inertia - decay**2)
    swing = (1 - share) * speed * np.exp(-decay * t) * np.sin(frequency * t) / frequency
    moved = data.tip_position.values[:, 0, 0] - data.tip_position.values[0, 0, 0]
    np.testing.assert_allclose(moved, swing, atol=1e-8)


def stored(scene):
    """Kinetic energy and that of both springs, from the end of the reference on."""
    data = sr.simulate(scene, backend="interpreted").data.sel(time=slice(0.21, None)).isel(tip=0)
    energy = data.energy_kinetic.values.copy()
    for key, error in (("soft", data.tip_error), ("orientation_soft", data.tip_orientation_error)):
        stiffness = np.array(scene.tips[0].config.controllers[key].stiffness)
        energy += 0.5 * (stiffness * error.values**2).sum(axis=1)
    return energy


def test_springs_conserve_energy_though_the_base_reacts(folder):
    energy = stored(scene_of(folder, changes=UNDAMPED))
    assert energy[0] > 0.1
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


def test_dampers_never_raise_the_energy(folder):
    dampers = {f"{SOFT}.damping": [2, 9, 0.5], f"{TURN}.damping": [0.3, 0.1, 0.7]}
    energy = stored(scene_of(folder, changes=UNDAMPED | dampers))
    assert np.diff(energy).max() < 1e-9 * energy[0]
    assert energy[-1] < 0.6 * energy[0]


ALONE = SPATIAL.replace("          orientation_soft: {kind: impedance, stiffness: [3, 8, 5]}\n", "")
NULL_SPACE = {"robots.arm.joint_pd": {"kp": 20, "kd": 3, "null_space": True}}
READ = {
    f"robots.arm.sensors.{name}": {"offset": 0.01, "scale": 1.1}
    for name in ("tip_position", "tip_velocity", "tip_orientation", "tip_angular_velocity")
}


@pytest.mark.parametrize(
    ("text", "changes"),
    [(SPATIAL, {}), (SPATIAL, READ), (ALONE, NULL_SPACE)],
    ids=["both", "sensors", "null_space"],
)
def test_the_engines_agree(folder, text, changes):
    gains = {f"{SOFT}.damping": [2, 9, 0.5], f"{SOFT}.axes": "reference"}
    gains |= {} if text is ALONE else {f"{TURN}.damping": [0.3, 0.1, 0.7], f"{TURN}.axes": "reference"}
    scene = scene_of(folder, text, gains | changes)
    loop, second = build_closed_loop(scene), PinocchioLoop(scene)
    _, c = loop.setup(loop.parameter_values)
    for seed in range(3):
        x, t = random_x(scene, np.random.default_rng(seed), loop.nx), 0.1
        rate = loop.dynamics(t, x, loop.at(t, x, c)).full().ravel()
        near = {"rtol": 1e-8, "atol": 1e-8 * np.abs(rate).max()}
        np.testing.assert_allclose(rate, second.derivative(t, x), **near)


@pytest.mark.parametrize("inertia", [None, [5, 4, 3]], ids=["of the arm", "desired"])
def test_joints_in_the_null_space_do_not_accelerate_the_tip(folder, inertia):
    accelerations = []
    for kp in (0, 200):
        gains = {"robots.arm.joint_pd.kp": kp, f"{SOFT}.inertia": inertia}
        scene = scene_of(folder, ALONE, NULL_SPACE | gains)
        loop, model = build_closed_loop(scene), scene.model
        _, c = loop.setup(loop.parameter_values)
        x = random_x(scene, np.random.default_rng(4), loop.nx)
        rate = loop.dynamics(0.1, x, loop.at(0.1, x, c)).full().ravel()
        accelerations.append(rate[model.nq : model.nq + model.nv])
    change, world = accelerations[1] - accelerations[0], pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    tip, data = scene.tips[0].frame, model.createData()
    jacobian = pin.computeFrameJacobian(model, data, x[: model.nq], tip, world)
    assert np.abs(change).max() > 1
    np.testing.assert_allclose(jacobian[:3] @ change, 0, atol=1e-9 * np.abs(change).max())


@pytest.mark.parametrize("sampled", [None, {"period": 0.02, "delay": 0.005}], ids=["continuous", "sampled"])
def test_gradients_are_exact(folder, sampled):
    changes = {f"{SOFT}.sampled": sampled, f"{SOFT}.damping": [2, 9, 0.5], "simulation.duration": 0.4}
    loop = build_closed_loop(scene_of(folder, changes=changes))
    rollout = sr.build_rollout(loop, duration_s=0.4, step_s=0.005, backend="interpreted")
    paths = [f"{SOFT}.stiffness.1", f"{SOFT}.damping.0", f"{TURN}.stiffness.2"]
    jacobian = rollout.jacobian(wrt=paths, outputs=["tip_position"]).outputs["tip_position"]
    for k, path in enumerate(paths):
        value, step = loop.parameters()[loop.index(path)], 1e-4
        ends = [rollout.run({path: value * (1 + s * step)}).outputs["tip_position"] for s in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step * value)
        scale = np.abs(difference).max()
        assert scale > 1e-7
        np.testing.assert_allclose(jacobian[..., k] / scale, difference / scale, atol=1e-5)


def test_a_negative_stiffness_is_refused_by_its_path(folder):
    with pytest.raises(ScenarioError, match=r"soft\.stiffness"):
        scene_of(folder, changes={f"{SOFT}.stiffness": [1, -2, 3]})


def test_a_pid_among_the_controllers_turns_the_tip_as_orientation_pid_does(folder):
    pid = "{kp: 30, ki: 60, feedback: inertial}"
    before, after = SPATIAL.split("          orientation_soft: {kind: impedance, stiffness: [3, 8, 5]}\n")
    named = f"{before}        orientation_pid: {pid}\n{after}"
    listed = f"{before}          orientation_aim: {{kind: pid, {pid[1:]}\n{after}"
    tilts = [
        sr.simulate(scene_of(folder, text), backend="interpreted").data.tip_orientation_error.values
        for text in (named, listed)
    ]
    np.testing.assert_allclose(tilts[1], tilts[0], atol=1e-12)
