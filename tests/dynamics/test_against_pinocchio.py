"""Every algorithm against Pinocchio's own, on random trees of every joint and on the shipped URDFs."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings

from spacerobot.common.errors import DescriptionError
from spacerobot.dynamics import (
    ArticulatedBody,
    Inertias,
    Wrench,
    centre_of_mass,
    configuration_derivative,
    forward_kinematics,
    frame_drift,
    frame_jacobian,
    frame_placement,
    frame_velocity,
    inverse_dynamics,
    kinetic_energy,
    mass_matrix,
    momentum,
    normalise,
    read_joints,
    subtree,
)
from tests.oracles.random_trees import random_states

TREES = settings(deadline=None, max_examples=40, derandomize=True)
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
TOLERANCE = 1e-12


def symbols(model):
    return ca.SX.sym("q", model.nq), ca.SX.sym("v", model.nv), ca.SX.sym("tau", model.nv)


def evaluate(inputs, outputs, values):
    function = ca.Function("f", list(inputs), [ca.densify(output) for output in outputs])
    return [np.array(value) for value in function.call([ca.DM(value) for value in values])]


def assert_close(found, expected):
    expected = np.asarray(expected, dtype=float)
    found = np.asarray(found).reshape(expected.shape)
    scale = np.max(np.abs(expected), initial=1e-3)
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE * scale)


def jacobian(model, data, q, frame):
    return np.array(pin.computeFrameJacobian(model, data, q, frame, WORLD)).reshape(6, model.nv)


def symmetric(upper):
    return np.triu(upper) + np.triu(upper, 1).T


def check_kinematics(state):
    model, frame = state.model, state.model.nframes - 1
    q, v, _ = symbols(model)
    kinematics = forward_kinematics(model, q, v)
    outputs = [
        *frame_placement(model, kinematics, frame),
        ca.vertcat(*frame_velocity(model, kinematics, frame)),
        ca.vertcat(*frame_drift(model, kinematics, frame)),
        frame_jacobian(model, kinematics, frame),
    ]
    rotation, origin, velocity, drift, columns = evaluate((q, v), outputs, (state.q, state.v))
    data = model.createData()
    expected = jacobian(model, data, state.q, frame)
    pin.forwardKinematics(model, data, state.q, state.v, np.zeros(model.nv))
    pin.updateFramePlacements(model, data)
    assert_close(rotation, data.oMf[frame].rotation)
    assert_close(origin, data.oMf[frame].translation)
    assert_close(velocity, pin.getFrameVelocity(model, data, frame, WORLD).vector)
    assert_close(drift, pin.getFrameClassicalAcceleration(model, data, frame, WORLD).vector)
    assert_close(columns, expected)


def check_forward_dynamics(state):
    model, frame = state.model, state.model.nframes - 1
    q, v, tau = symbols(model)
    load = ca.SX.sym("load", 6)
    kinematics = forward_kinematics(model, q, v)
    body = ArticulatedBody.factorise(model, kinematics, Inertias.from_model(model))
    point = frame_placement(model, kinematics, frame)[1]
    wrench = Wrench(int(model.frames[frame].parentJoint), load[:3], load[3:], point)
    both = ca.horzcat(body.reduced(tau), body.reduced(wrenches=[wrench]))
    outputs = [body.acceleration(tau, [wrench]), body.response(tau), body.response(wrenches=[wrench])]
    outputs.append(body.negated_mobility(both, both))
    values = (state.q, state.v, state.tau, state.wrench)
    acceleration, unit, pushed, mobility = evaluate((q, v, tau, load), outputs, values)
    data = model.createData()
    effort = jacobian(model, data, state.q, frame).T @ state.wrench
    assert_close(acceleration, pin.aba(model, data, state.q, state.v, state.tau + effort))
    inertia = symmetric(np.array(pin.crba(model, data, state.q)))
    # residuals in effort: they do not grow with the condition of the inertia matrix
    assert_close(inertia @ unit, state.tau[:, None])
    assert_close(inertia @ pushed, effort[:, None])
    loads = np.column_stack([state.tau, effort])
    assert_close(-mobility, loads.T @ np.hstack([unit, pushed]))


def check_inverse_dynamics(state):
    model, frame = state.model, state.model.nframes - 1
    q, v, wanted = symbols(model)
    load = ca.SX.sym("load", 6)
    kinematics, inertias = forward_kinematics(model, q, v), Inertias.from_model(model)
    point = frame_placement(model, kinematics, frame)[1]
    wrench = Wrench(int(model.frames[frame].parentJoint), load[:3], load[3:], point)
    outputs = [
        inverse_dynamics(model, kinematics, inertias, wanted),
        inverse_dynamics(model, kinematics, inertias, wanted, [wrench]),
    ]
    free, loaded = evaluate((q, v, wanted, load), outputs, (state.q, state.v, state.tau, state.wrench))
    data = model.createData()
    effort = jacobian(model, data, state.q, frame).T @ state.wrench
    expected = pin.rnea(model, data, state.q, state.v, state.tau)
    assert_close(free, expected)
    assert_close(loaded, expected - effort)


def check_momentum(state):
    model = state.model
    q, v, _ = symbols(model)
    about = ca.SX([0.3, -0.2, 0.7])
    kinematics, inertias = forward_kinematics(model, q, v), Inertias.from_model(model)
    outputs = [
        ca.vertcat(*momentum(model, kinematics, inertias)),
        ca.vertcat(*momentum(model, kinematics, inertias, about=about)),
        kinetic_energy(model, kinematics, inertias),
        centre_of_mass(model, kinematics, inertias),
        mass_matrix(model, kinematics, inertias),
    ]
    whole, moved, energy, centre, inertia = evaluate((q, v), outputs, (state.q, state.v))
    data = model.createData()
    centroidal = pin.computeCentroidalMomentum(model, data, state.q, state.v)
    linear = centroidal.linear
    assert_close(whole[:3, 0], linear)
    assert_close(whole[3:, 0], centroidal.angular + np.cross(data.com[0], linear))
    assert_close(moved[3:, 0], centroidal.angular + np.cross(data.com[0] - [0.3, -0.2, 0.7], linear))
    assert_close(centre[:, 0], pin.centerOfMass(model, data, state.q))
    expected = symmetric(np.array(pin.crba(model, data, state.q)))
    assert_close(inertia, expected)
    assert_close(energy, 0.5 * state.v @ expected @ state.v)
    if not np.any(model.armature):
        assert_close(energy, pin.computeKineticEnergy(model, data, state.q, state.v))


@TREES
@given(random_states())
def test_kinematics_of_random_trees(state):
    check_kinematics(state)


@TREES
@given(random_states())
def test_forward_dynamics_of_random_trees(state):
    check_forward_dynamics(state)
    check_inverse_dynamics(state)


@settings(TREES, max_examples=20)
@given(random_states(armature=True))
def test_rotor_inertia_of_random_trees(state):
    check_forward_dynamics(state)
    check_inverse_dynamics(state)
    check_momentum(state)


@TREES
@given(random_states())
def test_momentum_and_energy_of_random_trees(state):
    check_momentum(state)


def test_shipped_robots(shipped_state):
    check_kinematics(shipped_state)
    check_forward_dynamics(shipped_state)
    check_inverse_dynamics(shipped_state)
    check_momentum(shipped_state)


@TREES
@given(random_states())
def test_configuration_derivative(state):
    model = state.model
    q, v, _ = symbols(model)
    (rate,) = evaluate((q, v), [configuration_derivative(model, q, v)], (state.q, state.v))
    step = 1e-6
    ahead, behind = (pin.integrate(model, state.q, sign * step * state.v) for sign in (1, -1))
    np.testing.assert_allclose(rate[:, 0], (ahead - behind) / (2 * step), atol=1e-8)


@TREES
@given(random_states())
def test_normalise(state):
    model = state.model
    q = ca.SX.sym("q", model.nq)
    function = ca.Function("f", [q], [normalise(model, q)])
    np.testing.assert_allclose(np.array(function(state.q)).ravel(), state.q, atol=1e-15)
    found = np.array(function(state.q * 1.001)).ravel()
    assert pin.isNormalized(model, found, 1e-14)
    for joint in read_joints(model):
        if joint.nq == joint.nv:
            rows = slice(joint.idx_q, joint.idx_q + joint.nq)
            np.testing.assert_array_equal(found[rows], state.q[rows] * 1.001)


@settings(TREES, max_examples=20)
@given(random_states())
def test_parts_add_up(state):
    model = state.model
    q, v, _ = symbols(model)
    kinematics, inertias = forward_kinematics(model, q, v), Inertias.from_model(model)
    groups = [subtree(model, int(child)) for child in model.children[0]]
    assert sorted(i for group in groups for i in group) == list(range(1, model.njoints))
    linear = sum(momentum(model, kinematics, inertias, group)[0] for group in groups)
    angular = sum(momentum(model, kinematics, inertias, group)[1] for group in groups)
    energy = sum(kinetic_energy(model, kinematics, inertias, group) for group in groups)
    whole = [*momentum(model, kinematics, inertias), kinetic_energy(model, kinematics, inertias)]
    found = evaluate((q, v), [linear, angular, energy, *whole], (state.q, state.v))
    for part, total in zip(found[:3], found[3:], strict=True):
        assert_close(part, total)


def test_rest_is_structural():
    model = pin.buildSampleModelManipulator()
    kinematics = forward_kinematics(model, ca.SX.sym("q", model.nq))
    for index in range(model.njoints):
        assert kinematics.linear_velocity[index].nnz() == 0
        assert kinematics.local[index].gradient.nnz() == 0


def test_symbolic_inertias_give_the_same_motion():
    """The closed loop hands in parameters; here they are symbols that take the model's own values."""
    model = pin.buildSampleModelManipulator()
    numeric = Inertias.from_model(model)
    mass = tuple(ca.SX.sym("m", m.sparsity()) for m in numeric.mass)
    moment = tuple(ca.SX.sym("h", h.sparsity()) for h in numeric.moment)
    rotational = tuple(ca.SX.sym("I", i.sparsity()) for i in numeric.rotational)
    q, v, tau = symbols(model)
    kinematics = forward_kinematics(model, q, v)
    outputs = [
        ArticulatedBody.factorise(model, kinematics, chosen).acceleration(tau)
        for chosen in (numeric, Inertias(mass, moment, rotational))
    ]
    names = [ca.veccat(*mass, *moment, *rotational)]
    values = [ca.veccat(*numeric.mass, *numeric.moment, *numeric.rotational)]
    rng = np.random.default_rng(3)
    state = [rng.normal(size=n) for n in (model.nq, model.nv, model.nv)]
    first, second = evaluate((q, v, tau, *names), outputs, (*state, *(ca.DM(x) for x in values)))
    assert_close(second, first)


def test_unsupported_joint_is_named():
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    with pytest.raises(DescriptionError, match=r"'ball'.*Spherical is not supported.*FreeFlyer"):
        forward_kinematics(model, ca.SX.sym("q", model.nq))
