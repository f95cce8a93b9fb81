"""Free-floating kinematics against simulation, conservation of momentum and a case worked out by hand."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from spacerobot.common.errors import DescriptionError
from spacerobot.dynamics import (
    FreeFloating,
    FreeFloatingRobot,
    Inertias,
    forward_kinematics,
    frame_jacobian,
)
from tests.oracles.random_trees import random_inertia, random_placement

WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def robot(base, joints, seed=5):
    """A robot with two branches on a base, and another body floating beside it, weightless."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    model.gravity = pin.Motion.Zero()
    planar = base == "planar"
    root = model.addJoint(
        0, pin.JointModelPlanar() if planar else pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base"
    )
    model.appendBodyToJoint(root, random_inertia(rng), pin.SE3.Identity())
    link = root
    for number in range(joints):
        placement = random_placement(rng, 0.4)
        if planar:
            placement = pin.SE3(np.eye(3), placement.translation * [1, 1, 0])
        if number == joints - 1:  # a second branch, off the tip's path
            link = root
        parent = root if number == joints - 1 else link
        link = model.addJoint(parent, pin.JointModelRZ(), placement, f"joint {number}")
        model.appendBodyToJoint(link, random_inertia(rng), pin.SE3.Identity())
        if number == joints - 2:
            offset = pin.SE3(np.eye(3), np.array([0.3, 0.1, 0.0]))
            model.addFrame(pin.Frame("tip", link, offset, pin.FrameType.OP_FRAME))
    other = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "other")
    model.appendBodyToJoint(other, random_inertia(rng), pin.SE3.Identity())
    model.armature = np.concatenate([np.zeros(root_size(base)), np.full(joints, 0.2), np.zeros(6)])
    return model


def root_size(base):
    return 3 if base == "planar" else 6


CASES = [("planar", 4), ("free-flyer", 7)]


@pytest.fixture(params=CASES, ids=lambda case: case[0])
def case(request):
    base, joints = request.param
    model = robot(base, joints)
    rng = np.random.default_rng(8)
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    return model, q, FreeFloatingRobot.of(model, "tip"), root_size(base), joints


def simulate(model, q, v, torque, until=1.0, step=5e-3):
    """Classical Runge-Kutta of Pinocchio's own forward dynamics, yielding every step's (q, v)."""
    data = model.createData()

    def rate(time, delta, v):
        at = pin.integrate(model, q, delta)
        slope = pin.dIntegrate(model, q, delta)[1]  # d(integrate)/d(delta), to invert
        return np.linalg.solve(slope, v), pin.aba(model, data, at, v, torque(time))

    for k in range(round(until / step)):
        time, zero = k * step, np.zeros(model.nv)
        a1, b1 = rate(time, zero, v)
        a2, b2 = rate(time + step / 2, step / 2 * a1, v + step / 2 * b1)
        a3, b3 = rate(time + step / 2, step / 2 * a2, v + step / 2 * b2)
        a4, b4 = rate(time + step, step * a3, v + step * b3)
        q = pin.normalize(model, pin.integrate(model, q, step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)))
        v = v + step / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
        yield q, v


def system_momentum(model, q, v, root=1):
    """Momentum of the robot alone about the world's origin, from Pinocchio's body velocities."""
    data = model.createData()
    pin.forwardKinematics(model, data, q, v)
    total = np.zeros(6)
    for index in model.subtrees[root]:
        total += data.oMi[index].act(model.inertias[index] * data.v[index]).vector
    return total


def tip_velocity(model, q, v):
    data = model.createData()
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    return pin.getFrameVelocity(model, data, model.getFrameId("tip"), WORLD).vector


@pytest.mark.parametrize("moving", [False, True], ids=["at rest", "with momentum"])
def test_tip_velocity_follows_from_joint_rates_during_free_motion(case, moving):
    model, q, kinematics, base, joints = case
    motors = slice(base, base + joints)
    v = np.zeros(model.nv)
    if moving:
        v[: base + joints] = np.random.default_rng(2).normal(size=base + joints)
    start = system_momentum(model, q, v)
    assert np.any(start) == moving
    amplitude = np.linspace(1, 2, joints)

    def torque(time):
        effort = np.zeros(model.nv)
        effort[motors] = amplitude * np.cos(3 * time + np.arange(joints))
        return effort

    for number, (at, speed) in enumerate(simulate(model, q, v, torque)):
        if number % 40:
            continue
        rates = speed[motors]
        expected = tip_velocity(model, at, speed)
        found = kinematics.generalized_jacobian(at) @ rates + kinematics.momentum_map(at) @ start
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.max(np.abs(expected)))
        np.testing.assert_allclose(kinematics.base_velocity(at, rates, start), speed[:base], atol=1e-6)
    assert np.max(np.abs(rates)) > 0.1  # the torques did move the robot


def test_velocity_level_identity_is_exact(case):
    model, q, kinematics, base, joints = case
    assert kinematics.columns == tuple(range(base, base + joints))
    v = np.random.default_rng(4).normal(size=model.nv)
    rates, held = v[base : base + joints], system_momentum(model, q, v)
    found = kinematics.generalized_jacobian(q) @ rates + kinematics.momentum_map(q) @ held
    np.testing.assert_allclose(found, tip_velocity(model, q, v), atol=1e-12)
    np.testing.assert_allclose(kinematics.base_velocity(q, rates, held), v[:base], atol=1e-12)


@pytest.mark.parametrize("angular_only", [False, True])
def test_reaction_null_space_leaves_the_base_alone(case, angular_only):
    model, q, kinematics, base, joints = case
    basis = kinematics.reaction_null_space(q, angular_only=angular_only)
    constraints = (1 if base == 3 else 3) if angular_only else base
    assert basis.shape == (joints, joints - constraints)
    np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-12)
    rates = basis @ np.linspace(1, 2, basis.shape[1])
    v = np.zeros(model.nv)
    v[base : base + joints] = rates
    v[:base] = kinematics.base_velocity(q, rates)
    free = [0, 1, 5] if base == 3 else range(6)  # a planar base is held in its plane
    np.testing.assert_allclose(system_momentum(model, q, v)[free], 0, atol=1e-12)
    still = slice(base - (1 if base == 3 else 3), base) if angular_only else slice(0, base)
    np.testing.assert_allclose(v[still], 0, atol=1e-12)
    if angular_only:
        assert np.max(np.abs(v[:base])) > 1e-3  # the base does translate
    generic = kinematics.base_velocity(q, np.ones(joints))
    assert np.max(np.abs(generic[still])) > 1e-2  # and other rates do turn it


def test_base_stays_put_along_a_reaction_null_space_motion(case):
    """Follow basis rates for a second, the base moving as momentum conservation alone makes it."""
    model, q, kinematics, base, joints = case
    start, step, previous = q.copy(), 2e-3, None

    def velocity(at):
        basis = kinematics.reaction_null_space(at)
        # one smooth direction: the previous one, projected on the basis here
        wanted = basis[:, 0] if previous is None else basis @ (basis.T @ previous)
        v = np.zeros(model.nv)
        v[base : base + joints] = wanted / np.linalg.norm(wanted)
        v[:base] = kinematics.base_velocity(at, v[base : base + joints])
        return v

    for _ in range(250):
        here = velocity(q)
        middle = velocity(pin.integrate(model, q, 0.5 * step * here))
        q = pin.integrate(model, q, step * middle)
        previous = middle[base : base + joints]
    moved = pin.difference(model, start, q)
    np.testing.assert_allclose(moved[:base], 0, atol=1e-10)
    assert np.linalg.norm(moved[base : base + joints]) > 0.1


def test_two_bodies_in_a_plane_by_hand():
    """Base (m1, I1) and link (m2, I2): joint at a from the base's centre, the link's centre l beyond it."""
    m1, I1, m2, I2, a, l, tip = 20.0, 3.0, 5.0, 0.4, 0.5, 0.3, 0.7  # noqa: E741
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, pin.Inertia(m1, np.zeros(3), I1 * np.eye(3)), pin.SE3.Identity())
    link = model.addJoint(base, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([a, 0, 0])), "elbow")
    body = pin.Inertia(m2, np.array([l, 0, 0]), I2 * np.eye(3))
    model.appendBodyToJoint(link, body, pin.SE3.Identity())
    placement = pin.SE3(np.eye(3), np.array([tip, 0, 0]))
    model.addFrame(pin.Frame("tip", link, placement, pin.FrameType.OP_FRAME))
    phi, theta = 0.4, 1.1
    q = np.array([0.2, -0.3, np.cos(phi), np.sin(phi), theta])

    # Angular momentum about the common centre of mass, I1 phi' + I2 (phi' + theta') + mu d x d', is zero,
    # d = a e(phi) + l e(phi + theta) from one centre of mass to the other, mu the reduced mass.
    mu = m1 * m2 / (m1 + m2)
    turning = I2 + mu * (l**2 + a * l * np.cos(theta))
    whole = I1 + I2 + mu * (a**2 + l**2 + 2 * a * l * np.cos(theta))
    spin = -turning / whole  # phi' per theta'
    across = [np.array([-np.sin(x), np.cos(x)]) for x in (phi, phi + theta)]
    apart = a * spin * across[0] + l * (spin + 1) * across[1]
    expected = -m2 / (m1 + m2) * apart + a * spin * across[0] + tip * (spin + 1) * across[1]

    kinematics = FreeFloatingRobot.of(model, "tip")
    jacobian = kinematics.generalized_jacobian(q)[:, 0]
    np.testing.assert_allclose(jacobian, [*expected, 0, 0, 0, spin + 1], atol=1e-14)
    along = [np.array([np.cos(x), np.sin(x)]) for x in (phi, phi + theta)]
    # total momentum drifts the pair and turns it about the common centre of mass
    total, moment = np.array([2.0, -1.0]), 0.7
    centre = q[:2] + m2 / (m1 + m2) * (a * along[0] + l * along[1])
    about_centre = moment - (centre[0] * total[1] - centre[1] * total[0])
    rate = about_centre / whole
    point = q[:2] + a * along[0] + tip * along[1]
    drift = total / (m1 + m2) + rate * np.array([centre[1] - point[1], point[0] - centre[0]])
    found = kinematics.momentum_map(q) @ [*total, 0, 0, 0, moment]
    np.testing.assert_allclose(found, [*drift, 0, 0, 0, rate], atol=1e-14)


def test_heavy_base_gives_the_ordinary_jacobian():
    model = robot("free-flyer", 5)
    model.inertias[1] = pin.Inertia(1e12, np.zeros(3), 1e12 * np.eye(3))
    q = pin.integrate(model, pin.neutral(model), np.random.default_rng(0).normal(size=model.nv))
    symbol = ca.SX.sym("q", model.nq)
    kinematics, inertias = forward_kinematics(model, symbol), Inertias.from_model(model)
    frame = model.getFrameId("tip")
    outputs = [
        FreeFloating.split(model, kinematics, inertias).generalized_jacobian(frame),
        frame_jacobian(model, kinematics, frame)[:, 6:11],
    ]
    found, fixed = (np.array(x) for x in ca.Function("f", [symbol], outputs)(q))
    np.testing.assert_allclose(found, fixed, atol=1e-10)


def test_unknown_tip_names_the_near_ones():
    with pytest.raises(DescriptionError, match=r"no frame 'tipp'.*'?tip'?"):
        FreeFloatingRobot.of(robot("planar", 3), "tipp")


def test_unknown_root_is_named():
    with pytest.raises(DescriptionError, match=r"no joint 'bass'.*base"):
        FreeFloatingRobot.of(robot("planar", 3), "tip", root="bass")


@pytest.mark.parametrize("root", ["joint 0", "universe"])
def test_root_must_float(root):
    with pytest.raises(DescriptionError, match="planar or free-flyer"):
        FreeFloatingRobot.of(robot("planar", 3), "tip", root=root)
