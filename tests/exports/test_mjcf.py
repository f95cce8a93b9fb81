"""MJCF: MuJoCo's dynamics of exported scenes are ours."""

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.common.errors import SpaceRobotError
from spacerobot.exports.mjcf_bodies import coordinates, mjcf
from spacerobot.exports.mjcf_scene import scene_mjcf

mujoco = pytest.importorskip("mujoco")

SCENARIOS = (
    "paper",
    "docking",
    "servicer",
    "ssrms",
    "idss",
    "envisat",
    "capture",
    "detumble-published",
    "drift",
    "bounce",
)
"""Ten scenarios without wheels, planar and spatial."""


def velocity_map(scene, q, v):
    """Matrix T with MuJoCo's velocity T v and the rate of T times v: bases have world axes there."""
    size = scene.model.nv
    matrix, rate = np.eye(size), np.zeros(size)
    for joint in scene.model.joints[1:]:
        k = joint.idx_v
        if joint.nv == 6:
            rotation = pin.Quaternion(q[joint.idx_q + 3 : joint.idx_q + 7]).toRotationMatrix()
            matrix[k : k + 3, k : k + 3] = rotation
            rate[k : k + 3] = rotation @ np.cross(v[k + 3 : k + 6], v[k : k + 3])
        elif joint.nv == 3:
            c, s = q[joint.idx_q + 2 : joint.idx_q + 4]
            matrix[k : k + 2, k : k + 2] = [[c, -s], [s, c]]
            rate[k : k + 2] = matrix[k : k + 2, k : k + 2] @ (v[k + 2] * np.array([-v[k + 1], v[k]]))
    return matrix, rate


@pytest.mark.parametrize("name", SCENARIOS)
def test_passive_accelerations_and_mass_matrices_are_equal(name):
    scene, random = sr.load_scene(name), np.random.default_rng(1)
    text = scene_mjcf(scene, visuals=False)
    theirs = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(theirs)
    theirs.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    assert not scene.ties, "a tied joint is free where constraints are disabled"
    for _ in range(3):
        q = pin.integrate(scene.model, scene.q, random.uniform(-1, 1, scene.model.nv))
        v = random.uniform(-1, 1, scene.model.nv)
        data.qpos[:], data.qvel[:] = coordinates(scene, q, v)
        mujoco.mj_forward(theirs, data)
        ours = scene.model.createData()
        tau = -np.array(scene.model.damping) * v
        acceleration = pin.aba(scene.model, ours, q, v, tau)
        matrix, rate = velocity_map(scene, q, v)
        np.testing.assert_allclose(
            data.qacc, matrix @ acceleration + rate, rtol=1e-8, atol=1e-8 * np.abs(acceleration).max()
        )
        mass = np.zeros((theirs.nv, theirs.nv))
        mujoco.mj_fullM(theirs, data, mass)
        upper = np.triu(pin.crba(scene.model, ours, q))
        expected = matrix @ (upper + np.triu(upper, 1).T) @ matrix.T
        np.testing.assert_allclose(mass, expected, atol=1e-9 * np.abs(expected).max())


def test_inertials_are_exact():
    """MuJoCo's own import of URDFs loses digits and merges; ours keeps the sum of masses to the last bit."""
    scene = sr.load_scene("servicer")
    theirs = mujoco.MjModel.from_xml_string(scene_mjcf(scene, visuals=False))
    for joint in range(1, scene.model.njoints):
        body = theirs.body(scene.model.names[joint])
        assert body.mass[0] == scene.model.inertias[joint].mass
        rotation = pin.Quaternion(*body.iquat).toRotationMatrix()
        tensor = rotation @ np.diag(body.inertia) @ rotation.T
        np.testing.assert_allclose(
            tensor, scene.model.inertias[joint].inertia, rtol=0, atol=1e-12 * tensor.max()
        )


def test_grasps_limits_motors_and_initial_state(tmp_path):
    scene = sr.load_scene("servicer")
    theirs = mujoco.MjModel.from_xml_path(str(sr.export(scene, tmp_path / "servicer.xml")))
    data = mujoco.MjData(theirs)
    mujoco.mj_resetDataKeyframe(theirs, data, 0)
    position, velocity = coordinates(scene, scene.q, scene.v)
    np.testing.assert_allclose(data.qpos, position, atol=1e-15)
    np.testing.assert_allclose(data.qvel, velocity, atol=1e-15)
    mujoco.mj_forward(theirs, data)
    assert theirs.neq == len(scene.grasps)
    equality = [k for k in range(data.nefc) if data.efc_type[k] == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
    assert len(equality) == 6 * len(scene.grasps)
    assert np.abs(data.efc_pos[equality]).max() < 1e-12
    (robot,) = scene.robots
    assert theirs.nu == len(robot.driven_joints)
    name = "left_joint_1"
    (joint,) = [one for one in robot.description.joints if one.name == name]
    np.testing.assert_array_equal(theirs.joint(f"servicer/{name}").range, [joint.lower, joint.upper])
    limit = robot.config.joints[name].torque_limit
    np.testing.assert_array_equal(theirs.actuator(f"servicer/{name}").ctrlrange, [-limit, limit])
    geometries = theirs.ngeom
    plain = mujoco.MjModel.from_xml_path(str(sr.export(scene, tmp_path / "plain.xml", visuals=False)))
    assert plain.ngeom < geometries


def test_wheels_carry_their_momentum():
    scene = sr.load_scene("servicer-wheels", {"robots.servicer.actuators.wheels.speeds": [100, -50, 20, 5]})
    text = scene_mjcf(scene, visuals=False)
    theirs = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(theirs)
    mujoco.mj_resetDataKeyframe(theirs, data, 0)
    mujoco.mj_forward(theirs, data)
    speeds = [data.joint(f"wheel_{k}").qvel[0] for k in range(4)]
    np.testing.assert_array_equal(speeds, [100, -50, 20, 5])
    ours = scene.model.createData()
    assert sum(theirs.body_mass) == pytest.approx(pin.computeTotalMass(scene.model), rel=1e-14)
    upper = np.triu(pin.crba(scene.model, ours, scene.q))
    mass = np.zeros((theirs.nv, theirs.nv))
    mujoco.mj_fullM(theirs, data, mass)
    wheels = [theirs.joint(f"wheel_{k}").dofadr[0] for k in range(4)]
    kept = np.delete(np.delete(mass, wheels, 0), wheels, 1)
    matrix, _ = velocity_map(scene, scene.q, scene.v)
    expected = matrix @ (upper + np.triu(upper, 1).T) @ matrix.T
    storage = scene.robots[0].config.actuators["wheels"].momentum_storage()
    # the wheels' inertia about their axes is added to the model's, as in our law of wheels
    base = scene.model.joints[scene.robots[0].root_joint].idx_v
    spin = slice(base + 3, base + 6)
    expected[spin, spin] += storage.inertia * storage.axes @ storage.axes.T
    np.testing.assert_allclose(kept, expected, atol=1e-9 * expected.max())


def test_contacts_touch_only_their_pairs():
    scene = sr.load_scene("bounce")
    theirs = mujoco.MjModel.from_xml_string(scene_mjcf(scene))
    assert theirs.npair == sum(len(contact.pairs) for contact in scene.contacts)
    assert not theirs.geom_contype.any()
    planes = mujoco.MjModel.from_xml_string(scene_mjcf(sr.load_scene("idss"), visuals=False))
    assert planes.npair == sum(len(contact.pairs) for contact in sr.load_scene("idss").contacts)


def test_a_body_without_inertia_is_refused_in_one_line():
    with pytest.raises(
        SpaceRobotError, match="MuJoCo needs an inertia about every axis; none has what moves with"
    ):
        scene_mjcf(sr.load_scene("ssrms-flexible"))


def test_the_bodies_alone_are_a_model():
    scene = sr.load_scene("paper")
    assert mujoco.MjModel.from_xml_string(mjcf(scene)).nv == scene.model.nv
