"""What the algorithms cost, counted in operations: linear in the joints, and planar where the arm is."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from spacerobot.dynamics import ArticulatedBody, Inertias, Wrench, forward_kinematics, point_jacobian
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


def operations(model):
    """Operations of forward dynamics, without the instructions that move inputs and outputs."""
    q, v, tau = ca.SX.sym("q", model.nq), ca.SX.sym("v", model.nv), ca.SX.sym("tau", model.nv)
    body = ArticulatedBody.factorise(model, forward_kinematics(model, q, v), Inertias.from_model(model))
    function = ca.Function("aba", [q, v, tau], [body.acceleration(tau)])
    return function.n_instructions() - model.nq - 3 * model.nv


@pytest.mark.parametrize(("arm", "slope"), [(planar_arm, 80), (spatial_arm, 300)])
def test_forward_dynamics_cost_grows_linearly(arm, slope):
    counts = np.array([operations(arm(size)) for size in SIZES])
    slopes = np.diff(counts) / np.diff(SIZES)
    assert np.all(slopes <= slope), slopes
    np.testing.assert_allclose(slopes, slopes[-1], rtol=0.05)


@pytest.mark.parametrize(
    ("model", "bound"),
    [(planar_arm(8), 680), (spatial_arm(7, arms=2), 4300)],
    ids=["planar", "spatial"],
)
def test_forward_dynamics_keeps_its_zeros(model, bound):
    assert operations(model) <= bound


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
    assert body.response(wrenches=[Wrench(0, force, force, force)]).nnz() == 0  # on the universe


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


def own_axes(model):
    """Joints that calculate in their own body axes."""
    kinematics = forward_kinematics(model, ca.SX.sym("q", model.nq))
    return [index for index, motion in enumerate(kinematics.local) if motion.to_parent is not None]


def chain(*joints):
    model, index = pin.Model(), 0
    for number, joint in enumerate(joints):
        index = model.addJoint(index, joint, pin.SE3.Identity(), f"joint {number}")
        model.appendBodyToJoint(index, pin.Inertia.Random(), pin.SE3.Identity())
    return model


def test_axes_are_adopted_where_they_pay():
    assert own_axes(planar_arm(4)) == []  # parallel axes: all in world axes
    assert own_axes(spatial_arm(4)) == [1, 2, 3, 4]  # all but the leaf
    assert own_axes(chain(pin.JointModelPlanar())) == [1]  # a free body: constant inertia
    parallel = [pin.JointModelRY(), pin.JointModelRY(), pin.JointModelRY(), pin.JointModelRX()]
    assert own_axes(chain(*parallel)) == [3]  # the last of a parallel group turns for all of them
    assert own_axes(chain(pin.JointModelRZ(), pin.JointModelPX(), pin.JointModelRZ())) == []
    assert own_axes(chain(pin.JointModelRZ(), pin.JointModelPX(), pin.JointModelRY())) == [1]


def test_planar_arm_with_its_tip_in_world_axes():
    """A closed loop wants the tip's motion and Jacobian too: there world axes earn their keep."""
    model = planar_arm(8)
    q, v, tau = ca.SX.sym("q", model.nq), ca.SX.sym("v", model.nv), ca.SX.sym("tau", model.nv)
    force, tip = ca.SX.sym("force", 3), model.njoints - 1
    kinematics, inertias = forward_kinematics(model, q, v), Inertias.from_model(model)
    wrench = Wrench(tip, force, ca.SX(3, 1), kinematics.origin[tip])
    outputs = [
        ArticulatedBody.factorise(model, kinematics, inertias).acceleration(tau, [wrench]),
        kinematics.origin[tip],
        kinematics.linear_velocity[tip],
        point_jacobian(kinematics, tip, kinematics.origin[tip]),
    ]
    assert ca.Function("f", [q, v, tau, force], outputs).n_instructions() <= 840


def test_free_bodies_cost_next_to_nothing():
    for joint, bound in ((pin.JointModelPlanar(), 15), (pin.JointModelFreeFlyer(), 40)):
        model = chain(joint)
        model.gravity = pin.Motion.Zero()
        model.inertias[1] = pin.Inertia(20.0, np.zeros(3), np.diag([1.0, 2.0, 2.25]))
        assert operations(model) <= bound
