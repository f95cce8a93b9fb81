"""Outputs of tips, bodies, grasps and energies at random states, by Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.pinocchio_engine.mechanical_state import MechanicalState
from tests.oracles.motions import DesiredMotions
from tests.oracles.small_scenes import PLANAR, SPATIAL, random_x, small_scene

GRAVITY = {"planar": [0.3, -1.6, 0], "spatial": [0.2, 0.5, -3]}


@pytest.mark.parametrize(("name", "text"), [("planar", PLANAR), ("spatial", SPATIAL)])
def test_outputs_are_those_of_pinocchio(name, text):
    springs = {"grasps.*.rotational_stiffness": 4, "grasps.*.rotational_damping": 0.6}
    scene = small_scene(text, {"gravity": GRAVITY[name]} | springs)
    desired, model = DesiredMotions(scene), scene.model
    x = random_x(scene, np.random.default_rng(6), len(desired.x0))
    state, start = (
        MechanicalState(model, y[: model.nq], y[model.nq : model.nq + model.nv]) for y in (x, desired.x0)
    )
    motions, found = desired.at(0.6, x), desired.outputs(0.6, x)
    rows = {key: found[key].reshape(-1, 3) for key in found if key.startswith(("tip_", "body_", "grasp_"))}
    for k, tip in enumerate(scene.tips):
        frame, wanted = state.frame(tip.frame), motions[tip.label]
        expected = {
            "tip_position": frame.position,
            "tip_velocity": frame.velocity[:3],
            "tip_reference": wanted.position,
            "tip_error": wanted.position - frame.position,
            "tip_orientation_error": pin.log3(wanted.rotation @ frame.rotation.T),
        }
        for key, value in expected.items():
            np.testing.assert_allclose(rows[key][k], value, atol=1e-12, err_msg=key)
    whole = np.zeros(6)
    for k, body in enumerate(scene.bodies):
        frame, first = (one.frame(body.root_frame) for one in (state, start))
        np.testing.assert_allclose(rows["body_position"][k], frame.position, atol=1e-12)
        turned = pin.log3(frame.rotation @ first.rotation.T)
        np.testing.assert_allclose(rows["body_rotation"][k], turned, atol=1e-12)
        moving = (state.data.oMi[j].act(model.inertias[j] * state.data.v[j]).vector for j in body.subtree)
        own = sum(moving, np.zeros(6))
        np.testing.assert_allclose(rows["body_momentum_linear"][k], own[:3], atol=1e-11)
        np.testing.assert_allclose(rows["body_momentum_angular"][k], own[3:], atol=1e-11)
        whole += own
    np.testing.assert_allclose(found["momentum_linear"][:, 0], whole[:3], atol=1e-11)
    np.testing.assert_allclose(found["momentum_angular"][:, 0], whole[3:], atol=1e-11)
    along, about = np.zeros((2, 3))
    along[list(scene.translation_axes)] = about[list(scene.rotation_axes)] = 1
    for k, grasp in enumerate(scene.grasps):
        (tip, mate), (first, other) = (
            (one.frame(grasp.tip.frame), one.frame(grasp.frame)) for one in (state, start)
        )
        gap, spin = tip.position - mate.position, tip.velocity[3:] - mate.velocity[3:]
        slip = tip.velocity[:3] - mate.velocity[:3] - np.cross(mate.velocity[3:], gap)
        twist = pin.log3(tip.rotation @ (mate.rotation @ other.rotation.T @ first.rotation).T)
        force = grasp.config.stiffness * gap + grasp.config.damping * slip
        np.testing.assert_allclose(rows["grasp_gap"][k], gap, atol=1e-12)
        np.testing.assert_allclose(rows["grasp_force"][k], along * force, atol=1e-10)
        np.testing.assert_allclose(rows["grasp_torque"][k], about * (4 * twist + 0.6 * spin), atol=1e-10)
    data = model.createData()
    kinetic = pin.computeKineticEnergy(model, data, state.q, state.v)
    assert found["energy_kinetic"][0, 0] == pytest.approx(kinetic, rel=1e-12)
    fall = pin.computePotentialEnergy(model, data, state.q)
    assert found["energy_potential"][0, 0] == pytest.approx(fall, rel=1e-12)
