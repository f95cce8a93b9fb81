"""Rotation helpers against Pinocchio's exp3, log3 and rpy, with their derivatives where they are delicate."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spacerobot.dynamics import (
    quaternion_from_rotation,
    rotation_exp,
    rotation_from_quaternion,
    rotation_from_rpy,
    rotation_log,
)
from spacerobot.dynamics.algebra import cross, skew
from spacerobot.dynamics.rotations import turn

FEW = settings(deadline=None, max_examples=60, derandomize=True)
PHI = ca.SX.sym("phi", 3)
R = ca.SX.sym("R", 3, 3)
EXP = ca.Function("exp", [PHI], [rotation_exp(PHI)])
LOG = ca.Function("log", [R], [rotation_log(R)])
QUATERNION = ca.Function("quaternion", [R], [quaternion_from_rotation(R)])

direction = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda a: np.linalg.norm(a) > 0.1)
angle = st.one_of(
    st.floats(0, 3.1),
    st.sampled_from([0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-5, 1e-3, 0.0316, 0.0317, 0.06, 1.57, 3.0]),
)


def vector(axis, size):
    return size * np.asarray(axis) / np.linalg.norm(axis)


@FEW
@given(direction, angle)
def test_exponential_agrees_with_pinocchio(axis, size):
    phi = vector(axis, size)
    np.testing.assert_allclose(np.array(EXP(phi)), pin.exp3(phi), rtol=0, atol=2e-15)


@FEW
@given(direction, angle)
def test_logarithm_agrees_with_pinocchio(axis, size):
    phi = vector(axis, size)
    rotation = pin.exp3(phi)
    found = np.array(LOG(rotation)).ravel()
    blur = 2e-15 / min(1, np.pi - size) ** 2  # of Pinocchio's own logarithm, which takes the angle's cosine
    np.testing.assert_allclose(found, pin.log3(rotation), rtol=1e-12, atol=blur)
    np.testing.assert_allclose(found, phi, rtol=1e-13 / max(1e-3, np.pi - size), atol=5e-16)


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 0.0])
def test_logarithm_holds_up_to_pi(gap):
    for axis in np.vstack([np.eye(3), [[0.6, 0.0, 0.8], [1.0, 2.0, -3.0]]]):
        phi = vector(axis, np.pi - gap)
        found = np.array(LOG(pin.exp3(phi))).ravel()
        np.testing.assert_allclose(np.linalg.norm(found), np.pi - gap, rtol=1e-14)
        np.testing.assert_allclose(pin.exp3(found), pin.exp3(phi), atol=2e-15)


@FEW
@given(direction, angle)
def test_quaternion_round_trip(axis, size):
    rotation = pin.exp3(vector(axis, size))
    quaternion = np.array(QUATERNION(rotation)).ravel()
    assert quaternion[3] >= 0
    np.testing.assert_allclose(np.linalg.norm(quaternion), 1, rtol=1e-15)
    np.testing.assert_allclose(
        np.array(ca.DM(rotation_from_quaternion(ca.SX(quaternion)))), rotation, atol=1e-15
    )
    own = pin.Quaternion(rotation).coeffs()
    np.testing.assert_allclose(quaternion * np.sign(own @ quaternion), own, atol=1e-15)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-12, 1e-6, 0.02, 0.0316, 0.0317, 1.0, 2.5])
def test_derivatives_are_exact_at_and_near_zero(size):
    phi = vector([1.0, -2.0, 0.5], size)
    # d exp(phi) = exp(phi) skew(Jr d phi)
    slope = np.array(ca.Function("d", [PHI], [ca.jacobian(ca.vec(rotation_exp(PHI)), PHI)])(phi))
    right = pin.Jexp3(phi)
    for k in range(3):
        expected = pin.exp3(phi) @ pin.skew(right[:, k])
        np.testing.assert_allclose(slope[:, k].reshape(3, 3, order="F"), expected, atol=1e-14)
    # the logarithm along the tangent undoes the exponential
    jacobian = np.array(ca.Function("d", [PHI], [ca.jacobian(rotation_log(rotation_exp(PHI)), PHI)])(phi))
    np.testing.assert_allclose(jacobian, np.eye(3), atol=1e-12)


def test_second_derivatives_at_zero():
    weights = np.arange(1.0, 10.0).reshape(3, 3)
    value = ca.sum1(ca.sum2(weights * rotation_exp(PHI)))
    hessian = np.array(ca.Function("h", [PHI], [ca.hessian(value, PHI)[0]])(0))
    # exp = 1 + S + S^2 / 2, S^2 = phi phi^T - |phi|^2
    expected = 0.5 * (weights + weights.T) - np.trace(weights) * np.eye(3)
    np.testing.assert_allclose(hessian, expected, atol=1e-13)


@FEW
@given(st.tuples(*[st.floats(-4, 4)] * 3))
def test_roll_pitch_yaw_agrees_with_pinocchio(rpy):
    found = ca.DM(rotation_from_rpy(ca.SX(ca.DM(rpy))))
    np.testing.assert_allclose(np.array(found), pin.rpy.rpyToMatrix(*rpy), atol=2e-15)


@FEW
@given(direction, st.floats(-4, 4))
def test_turn_agrees_with_pinocchio(axis, size):
    unit = vector(axis, 1)
    found = ca.DM(turn(ca.SX(unit), ca.SX(np.cos(size)), ca.SX(np.sin(size))))
    np.testing.assert_allclose(np.array(found), pin.exp3(size * unit), atol=2e-15)


def test_vector_product():
    a, b = np.array([1.0, 2.0, 3.0]), np.array([-2.0, 0.5, 4.0])
    np.testing.assert_array_equal(np.array(ca.DM(cross(ca.SX(a), ca.SX(b)))).ravel(), np.cross(a, b))
    np.testing.assert_array_equal(np.array(ca.DM(skew(ca.SX(a)))), pin.skew(a))


def test_turns_about_one_axis_stay_sparse():
    yaw = ca.SX(3, 1)
    yaw[2] = ca.SX.sym("yaw")
    assert rotation_exp(yaw).nnz() == 5
    assert rotation_from_rpy(yaw).nnz() == 5
    back = rotation_log(rotation_exp(yaw))
    assert back.nnz() == 1
    value = ca.Function("f", [yaw[2]], [back])
    for size in (-3.0, 0.0, 1e-9, 2.0):
        np.testing.assert_allclose(np.array(value(size)).ravel(), [0, 0, size], atol=1e-15)
