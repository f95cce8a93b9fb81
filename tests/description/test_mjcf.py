"""Robots from MJCF: MuJoCo's mass matrix and bias forces are those of the description."""

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.common.errors import DescriptionError
from spacerobot.description import read_description

ARM = """
<mujoco model="arm">
  <compiler angle="degree" autolimits="true" eulerseq="XYZ"/>
  <include file="limits.xml"/>
  <default>
    <joint damping="0.5"/>
    <geom density="800"/>
    <default class="strong">
      <joint axis="0 1 0" range="-90 120" armature="0.1"/>
      <general forcerange="-40 50"/>
      <default class="rod"><geom type="capsule" size="0.05"/></default>
    </default>
  </default>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="bus" pos="0 0 1" euler="10 20 30" childclass="strong">
      <freejoint/>
      <inertial mass="30" pos="0.1 0 0" quat="0.9 0.1 0.2 0.3" diaginertia="3 2 2.5"/>
      <geom type="box" size="0.4 0.3 0.2" rgba="1 0 0 1"/>
      <site name="antenna" pos="0 0 0.4"/>
      <frame pos="0.4 0 0" euler="0 0 15">
        <body name="upper" pos="0 0 0.1" axisangle="1 1 0 40">
          <joint name="yaw" axis="0 0 1" pos="0.02 0.01 0"/>
          <joint name="pitch" pos="-0.03 0 0.05" frictionloss="0.2"/>
          <geom class="rod" fromto="0 0 0 0.1 0.2 0.5"/>
          <geom type="ellipsoid" size="0.1 0.05 0.2" mass="0.7" pos="0 0.1 0" zaxis="1 1 1"/>
          <body name="fore" pos="0.1 0.2 0.5" xyaxes="0 1 0 0 0 1">
            <joint name="elbow" axis="1 2 0"/>
            <geom type="cylinder" size="0.04 0.3" pos="0 0 0.3" contype="0" conaffinity="0"/>
            <geom type="sphere" size="0.06" pos="0 0 0.6" group="3"/>
            <body name="slider" pos="0 0 0.6">
              <joint name="slide" type="slide" axis="0 0 1" range="-0.1 0.2" class="main"/>
              <inertial mass="1.5" pos="0 0.01 0.1" fullinertia="0.02 0.03 0.04 0.001 0.002 -0.003"/>
              <site name="tool" pos="0 0 0.2" euler="90 0 0"/>
            </body>
          </body>
        </body>
      </frame>
    </body>
  </worldbody>
  <actuator>
    <motor name="m_yaw" joint="yaw" ctrlrange="-3 3" gear="10"/>
    <position name="m_pitch" joint="pitch" class="strong" kp="100"/>
  </actuator>
</mujoco>
"""
INCLUDED = "<mujocoinclude><default><joint frictionloss='0'/></default></mujocoinclude>"


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "limits.xml").write_text(INCLUDED)
    (tmp_path / "arm.xml").write_text(ARM)
    return tmp_path / "arm.xml"


def compare(path, seed=1, tolerance=1e-9):
    """Mass matrix and bias forces of a floating arm in random states; MuJoCo's armature left out."""
    mujoco = pytest.importorskip("mujoco")
    theirs = mujoco.MjModel.from_xml_path(str(path))
    theirs.dof_armature[:] = 0
    theirs.opt.gravity[:] = 0
    data, random = mujoco.MjData(theirs), np.random.default_rng(seed)
    description = read_description(path)
    free = theirs.njnt and theirs.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    root = [pin.JointModelFreeFlyer()] if free else []
    model = pin.buildModelFromXML(description.to_pinocchio_xml(""), *root)
    ours = model.createData()
    ranged = [j for j in range(theirs.njnt) if theirs.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE]
    names = [mujoco.mj_id2name(theirs, mujoco.mjtObj.mjOBJ_JOINT, j) for j in ranged]
    assert model.nv == theirs.nv
    for _ in range(3):
        q, v = (
            pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)),
            random.normal(size=model.nv),
        )
        turn = np.eye(model.nv)
        if free:
            q[:3], quaternion = random.normal(size=3), random.normal(size=4)
            q[3:7] = quaternion / np.linalg.norm(quaternion)
            rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
            turn[:3, :3] = rotation
            data.qpos[:7] = [*q[:3], q[6], *q[3:6]]
            data.qvel[:6] = turn[:6, :6] @ v[:6]
        for j, name in zip(ranged, names, strict=True):
            joint = model.joints[model.getJointId(name)]
            angle = random.uniform(-1, 1)
            q[joint.idx_q : joint.idx_q + joint.nq] = (
                [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
            )
            data.qpos[theirs.jnt_qposadr[j]] = angle
            data.qvel[theirs.jnt_dofadr[j]] = v[joint.idx_v]
            order = theirs.jnt_dofadr[j]
            assert joint.idx_v == order, "joints are in the same order"
        mujoco.mj_forward(theirs, data)
        upper = np.triu(pin.crba(model, ours, q))
        expected = turn @ (upper + np.triu(upper, 1).T) @ turn.T
        mass = np.zeros((theirs.nv, theirs.nv))
        mujoco.mj_fullM(theirs, data, mass)
        np.testing.assert_allclose(mass, expected, atol=tolerance * np.abs(expected).max())
        # M a + b = 0, where a base's linear velocity is in world axes: its rate is R (a + w x v)
        rate = np.zeros(model.nv)
        if free:
            rate[:3] = turn[:3, :3] @ np.cross(v[3:6], v[:3])
        bias = turn @ pin.nonLinearEffects(_weightless(model), ours, q, v) - expected @ rate
        scale = np.abs(bias).max()
        np.testing.assert_allclose(data.qfrc_bias, bias, atol=tolerance * scale)
    return description, theirs


def _weightless(model):
    model.gravity.linear = np.zeros(3)
    return model


def test_dynamics_are_mujocos(arm):
    description, theirs = compare(arm)
    assert description.root == "bus"
    assert sum(link.mass for link in description.links) == pytest.approx(sum(theirs.body_mass), rel=1e-12)


def test_limits_actuators_shapes_and_sites(arm):
    description = read_description(arm)
    joints = {joint.name: joint for joint in description.joints}
    assert joints["yaw"].lower == pytest.approx(np.radians(-90))
    assert joints["yaw"].effort == 30
    assert joints["pitch"].effort == 50
    assert (joints["slide"].kind, joints["slide"].lower, joints["slide"].upper) == ("prismatic", -0.1, 0.2)
    assert joints["elbow"].damping == 0.5
    assert joints["pitch"].friction == 0.2
    links = {link.name: link for link in description.links}
    assert {"antenna", "tool", "bus", "upper", "fore", "slider"} <= set(links)
    assert [shape.geometry.kind for shape in links["fore"].collisions] == ["sphere"]
    assert [shape.geometry.kind for shape in links["fore"].visuals] == ["cylinder"]
    assert links["bus"].collisions[0].rgba.tolist() == [1, 0, 0, 1]
    assert [shape.geometry.kind for shape in links["upper"].collisions] == ["cylinder", "sphere", "sphere"]
    text = "\n".join(description.warnings)
    assert "armature; a transmission has a motor inertia: yaw, pitch, elbow" in text
    assert "gains of an actuator; a controller of the scenario has them: m_pitch" in text
    assert "geometry of type ellipsoid: upper" in text


def test_a_scenario_flies_it(arm):
    document = f"""
robots:
  mine:
    urdf: {arm.name}
    base: {{joint: free_flyer}}
    joints: {{yaw: {{rate_deg: 20}}}}
    tips: {{tool: {{}}}}
simulation: {{duration: 0.5}}
"""
    (arm.parent / "mine.yaml").write_text(document)
    result = sr.simulate(arm.parent / "mine.yaml", backend="interpreted")
    assert result.completed
    assert float(abs(result.data.momentum_angular[-1] - result.data.momentum_angular[0]).max()) < 1e-6
    assert float(abs(result.data.momentum_angular).max()) > 1e-3


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('type="slide"', 'type="ball"', "joint 'slide' .*is of type 'ball', allowed: hinge, slide"),
        ('axis="1 2 0"', 'axis="0 0 0"', "joint 'elbow' .*its axis is zero"),
        (
            'geom class="rod"',
            'geom class="nothing"',
            "class 'nothing' does not exist; allowed: main, strong, rod",
        ),
        ('file="limits.xml"', 'file="missing.xml"', "includes 'missing.xml', which cannot be read"),
        ('file="limits.xml"', 'file="arm.xml"', "includes 'arm.xml' twice"),
        ('mass="30"', 'mass="heavy"', "found mass='heavy', allowed: numbers"),
        ('mass="30"', 'mass="nan"', "found mass='nan', allowed"),
        ('<body name="slider"', '<body name="s"><freejoint/></body><body name="slider"', "free joint below"),
        (
            '<light pos="0 0 3"/>',
            '<replicate count="2"><body/></replicate>',
            "is not read; write the bodies out",
        ),
        ('type="ellipsoid"', 'type="mesh" mesh="m"', "the inertia of a mesh; state <inertial>"),
        ("<mujoco model", "<!DOCTYPE a [<!ENTITY b 'c'>]><mujoco model", "declares a document type"),
    ],
)
def test_errors_are_one_line(arm, old, new, message):
    assert old in ARM
    arm.write_text(ARM.replace(old, new, 1).strip())
    with pytest.raises(DescriptionError, match=message) as error:
        read_description(arm)
    assert "\n" not in str(error.value)
    assert str(arm.parent) in str(error.value)
