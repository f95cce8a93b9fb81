"""Rigid grasps against Pinocchio's constrained dynamics, all grasps against Newton's third law."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from tests.oracles.small_scenes import PLANAR, SPATIAL, random_x, small_scene
from tests.oracles.two_engines import ENGINES

STILL = {
    "robots.*.base.velocity": [0, 0, 0],
    "robots.*.base.spin_deg": [0, 0, 0],
    "target.base.spin_deg": [0, 0, 0],
}
STILL_SPATIAL = STILL | {"robots.one.joints.slant.rate_deg": 0, "robots.one.joints.slide.speed": 0}
STILL_PLANAR = STILL | {"robots.one.joints.joint_1.rate_deg": 0}


def held(kind: str, tip: str, frame: str) -> dict[str, str]:
    return {"kind": kind, "tip": tip, "frame": frame}


SCENES = {
    "spatial weld, point": (
        SPATIAL,
        STILL_SPATIAL
        | {
            "grasps.left": held("weld", "one/tip", "flap"),  # which swings
            "grasps.right": held("point", "two/tip", "right"),
            "gravity": [0.1, -0.3, -1.6],
        },
    ),
    "planar weld, point": (
        PLANAR,
        STILL_PLANAR
        | {
            "grasps.left": held("weld", "one/tip", "mate_1"),
            "grasps.right": held("point", "two/tip", "mate_2"),
        },
    ),
    "planar, fixed target": (
        PLANAR,
        STILL_PLANAR
        | {
            "target.base": {"joint": "fixed", "position": [1, 0, 0]},
            "robots.one.base": {"joint": "planar", "close_grasp": "left"},
            "grasps.left": held("point", "one/tip", "mate_1"),
            "grasps.right": held("weld", "two/tip", "mate_2"),
        },
    ),
}


def constraint_models(scene):
    """Pinocchio's contacts: a weld keeps the tip's initial pose in the mating frame."""
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    models = pin.StdVec_RigidConstraintModel()
    for grasp in scene.grasps:
        tip, mate = (scene.model.frames[f] for f in (grasp.tip.frame, grasp.frame))
        rest = data.oMf[grasp.frame].rotation.T @ data.oMf[grasp.tip.frame].rotation
        kind = {"weld": pin.ContactType.CONTACT_6D, "point": pin.ContactType.CONTACT_3D}[grasp.config.kind]
        models.append(
            pin.RigidConstraintModel(
                kind,
                scene.model,
                tip.parentJoint,
                tip.placement,
                mate.parentJoint,
                mate.placement * pin.SE3(rest, np.zeros(3)),
                pin.ReferenceFrame.LOCAL,
            )
        )
    return models


def relative_jacobian(scene):
    """Rows that rigid grasps fix at zero gap."""
    data = scene.model.createData()
    pin.computeJointJacobians(scene.model, data, scene.q)
    pin.updateFramePlacements(scene.model, data)
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    rows = []
    for grasp in scene.grasps:
        tip, mate = (
            pin.getFrameJacobian(scene.model, data, frame, world) for frame in (grasp.tip.frame, grasp.frame)
        )
        rows.append((tip - mate)[: 6 if grasp.config.kind == "weld" else 3])
    return np.vstack(rows)


@pytest.mark.parametrize("case", SCENES)
@pytest.mark.parametrize("engine", ENGINES)
def test_rigid_grasps_are_pinocchios_constraints(case, engine):
    """At zero gap and zero relative velocity, where stabilisation has nothing to do."""
    scene = small_scene(*SCENES[case])
    model, loop, rng = scene.model, ENGINES[engine](scene), np.random.default_rng(5)
    rows = relative_jacobian(scene)
    v = rng.normal(size=model.nv)
    v -= np.linalg.pinv(rows, rcond=1e-10) @ (rows @ v)
    assert np.abs(v).max() > 0.1
    x = loop.x0.copy()
    x[model.nq : model.nq + model.nv] = v
    x[model.nq + model.nv :] = 0.1 * rng.normal(size=len(x) - model.nq - model.nv)
    acceleration = loop.rate(0.4, x)[model.nq : model.nq + model.nv]

    columns = sorted(model.joints[j].idx_v for body in scene.bodies for j in body.joints)
    torque = -np.array(model.damping) * v
    torque[columns] += loop.outputs(0.4, x)["joint_torque"]
    contacts = constraint_models(scene)
    datas = pin.StdVec_RigidConstraintData()
    datas.extend(contact.createData() for contact in contacts)
    data = model.createData()
    pin.initConstraintDynamics(model, data, contacts, datas)
    settings = pin.ProximalSettings(1e-13, 1e-10, 100)  # a plane leaves rows that are always zero
    expected = pin.constraintDynamics(model, data, np.array(scene.q), v, torque, contacts, datas, settings)
    np.testing.assert_allclose(acceleration, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())
    assert np.abs(acceleration - pin.aba(model, data, np.array(scene.q), v, torque)).max() > 1e-2


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
@pytest.mark.parametrize("engine", ENGINES)
def test_grasps_act_as_one_pair_of_opposite_wrenches_at_the_tip(engine, text):
    """Each body's momentum changes by its grasps' wrenches at the tips' points, by nothing else."""
    scene = small_scene(text, {"grasps.*.rotational_stiffness": 5, "grasps.*.rotational_damping": 2})
    loop = ENGINES[engine](scene)
    assert_momentum_follows_wrenches(scene, loop, random_x(scene, np.random.default_rng(2), len(loop.x0)))


@pytest.mark.parametrize("case", ["spatial weld, point", "planar weld, point"])
@pytest.mark.parametrize("engine", ENGINES)
def test_rigid_wrenches_are_opposite_at_any_gap(engine, case):
    scene = small_scene(SCENES[case][0], SCENES[case][1] | {"gravity": [0, 0, 0]})
    loop = ENGINES[engine](scene)
    assert_momentum_follows_wrenches(scene, loop, random_x(scene, np.random.default_rng(2), len(loop.x0)))


def assert_momentum_follows_wrenches(scene, loop, x):
    rate, outputs = loop.rate(0.7, x), loop.outputs(0.7, x)
    dt = 1e-5
    ahead, behind = (loop.outputs(0.7, x + s * dt * rate) for s in (1, -1))
    count = len(scene.bodies)
    change = {
        kind: ((ahead[name] - behind[name]) / (2 * dt)).reshape(count, 3)
        for kind, name in (("linear", "body_momentum_linear"), ("angular", "body_momentum_angular"))
    }
    force = {body.name: np.zeros(3) for body in scene.bodies}
    moment = {body.name: np.zeros(3) for body in scene.bodies}
    tips = dict(zip([t.label for t in scene.tips], outputs["tip_position"].reshape(-1, 3), strict=True))
    forces, torques = (outputs[f"grasp_{kind}"].reshape(-1, 3) for kind in ("force", "torque"))
    for grasp, f, t in zip(scene.grasps, forces, torques, strict=True):
        about_origin = t + np.cross(tips[grasp.tip.label], f)
        for name, sign in (("target", 1), (grasp.tip.body.name, -1)):
            force[name] += sign * f
            moment[name] += sign * about_origin
    assert np.abs(forces).max() > 0.1
    scale = max(1.0, *(np.abs(m).max() for m in moment.values()))
    for i, body in enumerate(scene.bodies):
        np.testing.assert_allclose(change["linear"][i], force[body.name], atol=1e-6 * scale)
        np.testing.assert_allclose(change["angular"][i], moment[body.name], atol=1e-6 * scale)


@pytest.mark.parametrize("case", SCENES)
@pytest.mark.parametrize("engine", ENGINES)
def test_drift_of_a_rigid_grasp_decays_as_stabilised(engine, case):
    """Of w, the tip's velocity relative to the target's point there: w' = -2 k w - k^2 gap, at any state."""
    scene = small_scene(SCENES[case][0], SCENES[case][1] | {"grasps.*.stabilisation": 3})
    loop = ENGINES[engine](scene)
    x = random_x(scene, np.random.default_rng(4), len(loop.x0))
    rate, dt = loop.rate(0.7, x), 1e-5
    (ahead, _), (behind, _), (here, gaps) = (relative(scene, x + s * dt * rate) for s in (1, -1, 0))
    for i, grasp in enumerate(scene.grasps):
        rows = list(scene.translation_axes)
        if grasp.config.kind == "weld":
            rows += [axis + 3 for axis in scene.rotation_axes]
        change = (ahead[i] - behind[i]) / (2 * dt)
        expected = -2 * 3 * here[i] - 9 * gaps[i]
        scale = np.abs(rate).max()
        np.testing.assert_allclose(change[rows], expected[rows], atol=1e-7 * scale)
        assert np.abs(expected[rows]).max() > 1e-3


def relative(scene, x):
    """Relative velocities (6 each) and gaps (position, rotation vector) of the grasps, by Pinocchio."""
    model, data = scene.model, scene.model.createData()
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    pin.framesForwardKinematics(model, data, np.array(scene.q))
    rests = [data.oMf[g.frame].rotation.T @ data.oMf[g.tip.frame].rotation for g in scene.grasps]
    q = pin.normalize(model, x[: model.nq])
    pin.forwardKinematics(model, data, q, x[model.nq : model.nq + model.nv])
    pin.updateFramePlacements(model, data)
    velocities, gaps = [], []
    for grasp, rest in zip(scene.grasps, rests, strict=True):
        tip, mate = data.oMf[grasp.tip.frame], data.oMf[grasp.frame]
        v_tip, v_mate = (pin.getFrameVelocity(model, data, f, world) for f in (grasp.tip.frame, grasp.frame))
        gap = tip.translation - mate.translation
        linear = v_tip.linear - v_mate.linear - np.cross(v_mate.angular, gap)
        velocities.append(np.concatenate([linear, v_tip.angular - v_mate.angular]))
        gaps.append(np.concatenate([gap, pin.log3(tip.rotation @ (mate.rotation @ rest).T)]))
    return velocities, gaps
