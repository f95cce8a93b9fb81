"""Joints of many configurations at once, against Pinocchio's own one by one."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from spacerobot.dynamics.joints import read_joints
from spacerobot.scene import load_scene
from viz.drawing.placements import joint_placements, quaternions


@pytest.mark.parametrize("name", ["bounce", "capture"])
def test_joints_stand_where_pinocchio_puts_them(name):
    scene, rng = load_scene(name), np.random.default_rng(3)
    model = scene.model
    q = np.array([pin.integrate(model, scene.q, rng.normal(size=model.nv)) for _ in range(4)])
    found = joint_placements(scene, read_joints(model), q)
    data = model.createData()
    for k, row in enumerate(q):
        pin.forwardKinematics(model, data, row)
        for joint, placement in enumerate(data.oMi):
            np.testing.assert_allclose(found.rotation[k, joint], placement.rotation, atol=1e-13)
            np.testing.assert_allclose(found.origin[k, joint], placement.translation, atol=1e-13)


def test_quaternions_turn_as_their_matrices_do():
    half_turns = Rotation.from_rotvec(np.pi * np.eye(3))
    turns = Rotation.concatenate([Rotation.random(200, random_state=0), half_turns, Rotation.identity(1)])
    found = quaternions(turns.as_matrix().reshape(2, -1, 3, 3)).reshape(-1, 4)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(Rotation.from_quat(found).as_matrix(), turns.as_matrix(), atol=1e-14)
