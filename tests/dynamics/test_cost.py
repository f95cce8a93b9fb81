"""What the algorithms cost, counted in operations: linear in the joints, and planar where the arm is."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from spacerobot.dynamics import ArticulatedBody, Inertias, Wrench, forward_kinematics
from spacerobot.dynamics.joints import exact_directions, read_joints

SIZES = (4, 8, 16, 32, 64)


def planar_arm(links):
    """Planar base with ``links`` equal links, as in the paper."""
    model = pin.Model()
    model.gravity = pin.Motion.Zero()
    index = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(index, pin.Inertia(200, np.zeros(3), 40 * np.eye(3)), pin.SE3.Identity())
    for number in range(links):
        placement = pin.SE3(np.eye(3), np.array([0.35, 0, 0]))
        index = model.addJoint(index, pin.JointModelRZ(), placement, f"joint {number}")
        body = pin.Inertia(11.76, np.array([0.175, 0, 0]), np.diag([0.01, 0.2, 0.2153]))
        model.appendBodyToJoint(index, body, pin.SE3.Identity())
    return model


def spatial_arm(links, arms=1):
    """Free-flyer with ``arms`` arms whose axes alternate, as in a manipulator with intersecting axes."""
    model = pin.Model()
    model.gravity = pin.Motion.Zero()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(
        root, pin.Inertia(200, np.zeros(3), np.diag([30.0, 35.0, 40.0])), pin.SE3.Identity()
    )
    for arm in range(arms):
        index = root
        for number in range(links):
            joint = pin.JointModelRZ() if number % 2 == 0 else pin.JointModelRY()
            placement = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.35]))
            index = model.addJoint(index, joint, placement, f"arm {arm} joint {number}")
            body = pin.Inertia(5.0, np.array([0.01, 0.02, 0.175]), np.diag([0.1, 0.12, 0.02]))
            model.appendBodyToJoint(index, body, pin.SE3.Identity())
    return model


def operations(model, lumped=False):
    """Operations of forward dynamics, without the instructions that move inputs and outputs."""
    q, v, tau = ca.SX.sym("q", model.nq), ca.SX.sym("v", model.nv), ca.SX.sym("tau", model.nv)
    inertias = Inertias.from_model(model)
    if lumped:
        inertias = inertias.lumped(model)
    body = ArticulatedBody.factorise(model, forward_kinematics(model, q, v), inertias)
    function = ca.Function("aba", [q, v, tau], [body.acceleration(tau)])
    return function.n_instructions() - model.nq - 3 * model.nv


@pytest.mark.parametrize(("arm", "slope"), [(planar_arm, 80), (spatial_arm, 300)])
def test_forward_dynamics_cost_grows_linearly(arm, slope):
    counts = np.array([operations(arm(size)) for size in SIZES])
    slopes = np.diff(counts) / np.diff(SIZES)
    assert np.all(slopes <= slope), slopes
    np.testing.assert_allclose(slopes, slopes[-1], rtol=0.05)


@pytest.mark.parametrize(
    ("model", "lumped", "bound"),
    [
        (planar_arm(8), False, 680),
        (planar_arm(8), True, 660),
        (spatial_arm(7, arms=2), False, 4300),
        (spatial_arm(7, arms=2), True, 3900),
    ],
    ids=["planar", "planar lumped", "spatial", "spatial lumped"],
)
def test_forward_dynamics_keeps_its_zeros(model, lumped, bound):
    assert operations(model, lumped) <= bound


def test_response_costs_only_the_loaded_paths():
    model = spatial_arm(7, arms=2)
    q = ca.SX.sym("q", model.nq)
    kinematics = forward_kinematics(model, q)
    body = ArticulatedBody.factorise(model, kinematics, Inertias.from_model(model))
    force = ca.SX.sym("force", 3)
    tip = model.njoints - 1
    wrench = Wrench(tip, force, ca.SX(3, 1), kinematics.origin[tip])

    def count(*outputs):
        return ca.Function("f", [q, force], list(outputs)).n_instructions()

    one = count(body.response(wrenches=[wrench]))
    both = count(body.response(wrenches=[wrench]), body.response(ca.SX.ones(model.nv)))
    assert both - one < 0.5 * one  # the factorisation is shared
    assert count(body.response()) <= model.nv  # no load, no motion: constants
    assert body.response().nnz() == 0


def test_rounding_noise_of_quarter_turns_does_not_destroy_sparsity():
    clean = exact_directions(np.array(pin.rpy.rpyToMatrix(np.pi / 2, 0, -np.pi)))
    assert clean.nnz() == 3
    exact, noisy = planar_arm(4), planar_arm(4)
    for index in range(2, noisy.njoints):
        turn = pin.rpy.rpyToMatrix(0, 0, np.pi / 2)
        assert np.count_nonzero(turn) > 3  # or there is nothing to test
        noisy.jointPlacements[index] = pin.SE3(turn, np.array([0.35, 2e-17, 0]))
        exact.jointPlacements[index] = pin.SE3(np.rint(turn), np.array([0.35, 0, 0]))
    assert all(joint.rotation.nnz() == 3 for joint in read_joints(noisy))
    assert operations(noisy) == operations(exact)


def test_small_angles_are_not_noise():
    rotation = pin.rpy.rpyToMatrix(0, 0, 1.5707963)  # seven digits, as people write it
    kept = exact_directions(rotation)
    assert kept.nnz() == 5
    np.testing.assert_allclose(np.array(ca.DM(kept)), rotation, rtol=0, atol=1e-15)


def test_planar_kinematics_is_planar():
    model = planar_arm(3)
    kinematics = forward_kinematics(model, ca.SX.sym("q", model.nq), ca.SX.sym("v", model.nv))
    assert [rotation.nnz() for rotation in kinematics.rotation] == [3, 5, 5, 5, 5]
    for index in range(model.njoints):
        assert kinematics.angular[index][:2, :].nnz() == 0
        assert kinematics.angular_velocity[index][:2].nnz() == 0
        assert kinematics.origin[index][2].nnz() == 0
        assert kinematics.linear_velocity[index][2].nnz() == 0
