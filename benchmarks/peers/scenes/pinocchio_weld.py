"""The closed chain once more, by ``pin.constraintDynamics`` in a loop written in Python."""

from __future__ import annotations

import pinocchio as pin

from benchmarks.peers.compare import Outcome, PeerScene, compare
from benchmarks.peers.scenes.mujoco_plant import our_plant
from benchmarks.peers.scenes.mujoco_weld import DURATION, TITLE, TORQUES, held
from benchmarks.peers.scenes.pinocchio_plant import python_loop
from spacerobot.common.arrays import Array

TOLERANCE = 1e-7


def measure() -> Outcome:
    """Both grasps are contact models of six directions between a tip and its mating frame."""
    scene = held()
    model = scene.model
    torque = -0.0 * scene.v
    torque[[model.joints[j].idx_v for body in scene.robots for j in body.joints]] = TORQUES * 2
    contacts = pin.StdVec_RigidConstraintModel()
    for grasp in scene.grasps:
        ends = (model.frames[frame] for frame in (grasp.tip.frame, grasp.frame))
        where = [part for end in ends for part in (end.parentJoint, end.placement)]
        contacts.append(
            pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, *where, pin.ReferenceFrame.LOCAL)
        )
    datas = pin.StdVec_RigidConstraintData()
    datas.extend([contact.createData() for contact in contacts])
    data, settings = model.createData(), pin.ProximalSettings(1e-14, 1e-10, 20)
    pin.initConstraintDynamics(model, data, contacts, datas)

    def acceleration(q: Array, v: Array) -> Array:
        force = torque - model.damping * v
        return pin.constraintDynamics(model, data, q, v, force, contacts, datas, settings).copy()

    return compare(our_plant(scene, 0.08), python_loop(scene, DURATION, 0.08, acceleration), TOLERANCE)


SCENE = PeerScene("Pinocchio", "pin", TITLE, "`pin.constraintDynamics`", measure)
