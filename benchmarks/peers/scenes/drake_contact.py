"""A ball bounces off the fist of a free-floating arm: Drake's point contact by Hunt and Crossley."""

from __future__ import annotations

import numpy as np

from benchmarks.peers.compare import Job, Outcome, PeerScene, Side, compare
from benchmarks.peers.scenes.mujoco_plant import our_plant
from spacerobot.common.arrays import Array
from spacerobot.exports.mjcf_bodies import coordinates, mjcf
from spacerobot.scene import Scene, load_scene

DURATION, TOLERANCE = 4.0, 1e-6
STIFFNESS, DISSIPATION = 20000.0, 1.5
TITLE = "`bounce`, frictionless, without control, 4 s"


def bounce(contact: dict[str, object]) -> Scene:
    """The shipped scenario with another law; its shapes are those of the pad and of the ball's URDF."""
    law = {"between": ["fist", "target/body"], "longest_step": 0.002} | contact
    changes = {"robots.arm.tips": {"tip": {}}, "contacts": {"bump": law}, "simulation.duration": DURATION}
    return load_scene("bounce", changes)


def spheres(scene: Scene) -> list[tuple[int, Array, float]]:
    """Joint, centre in its axes [m] and radius [m] of both."""
    tip, ball = scene.tips[0], scene.target
    frame = scene.model.frames[tip.frame]
    return [
        (int(frame.parentJoint), frame.placement.translation, 0.07),
        (ball.root_joint, np.zeros(3), 0.12),
    ]


def measure() -> Outcome:
    """Drake's error-controlled RK3; each level tightens its accuracy eightfold."""
    from pydrake.geometry import AddContactMaterial, ProximityProperties, Sphere
    from pydrake.math import RigidTransform
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder

    scene = bounce(
        {"kind": "hunt_crossley", "stiffness": STIFFNESS, "exponent": 1, "dissipation": DISSIPATION}
    )
    text = mjcf(scene)

    def ready(level: int) -> Job:
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
        Parser(plant).AddModelsFromString(text, "xml")
        plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        for joint, centre, radius in spheres(scene):
            material = ProximityProperties()
            # two equal springs in series
            AddContactMaterial(DISSIPATION, 2 * STIFFNESS, CoulombFriction(0, 0), material)
            body = plant.GetBodyByName(scene.model.names[joint])
            plant.RegisterCollisionGeometry(body, RigidTransform(centre), Sphere(radius), "touch", material)
        plant.Finalize()
        simulator = Simulator(builder.Build())
        context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        position, velocity = coordinates(scene, scene.q, scene.v)
        plant.SetPositions(context, position)
        plant.SetVelocities(context, velocity)
        simulator.get_mutable_integrator().set_target_accuracy(accuracy(level))
        simulator.Initialize()

        def run() -> Array:
            simulator.AdvanceTo(DURATION)
            return np.concatenate([plant.GetPositions(context), plant.GetVelocities(context)])

        return run

    theirs = Side(ready, lambda level: f"RK3, accuracy {accuracy(level):.0e}")
    return compare(our_plant(scene, 0.04), theirs, TOLERANCE)


def accuracy(level: int) -> float:
    """That halves the step of a third-order method."""
    return float(1e-3 / 8**level)


SCENE = PeerScene("Drake", "drake", TITLE, "", measure)
