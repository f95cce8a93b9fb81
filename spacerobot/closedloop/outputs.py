"""What can be observed of the closed loop, as named column vectors.

=============================  ========================================================================
``tip_position``               of each tip (3 each) [m]
``tip_velocity``               of each tip (3 each) [m/s]
``tip_reference``              of each tip (3 each) [m]
``tip_error``                  reference minus position (3 each) [m]
``tip_orientation_error``      rotation vector from orientation to reference (3 each) [rad]
``body_position``              root link's origin of each body (3 each) [m]
``body_rotation``              rotation vector of each root link since the start (3 each) [rad]
``joint_torque``               of each joint that is not a base, in the model's order [N m or N]
``grasp_force``                of each grasp on the target at the tip's point (3 each) [N]
``grasp_torque``               of each grasp on the target (3 each) [N m]
``grasp_gap``                  from mating frame to tip (3 each) [m]
``body_momentum_linear``       of each body (3 each) [N s]
``body_momentum_angular``      of each body about the world's origin (3 each) [N m s]
``momentum_linear``            of all bodies (3) [N s]
``momentum_angular``           of all bodies about the world's origin (3) [N m s]
``energy_kinetic``             [J]
``energy_spring``              held in the grips' springs [J]
``energy_potential``           of gravity [J]
``work_actuator``              put in by the actuators since the start [J]
``work_joint``                 taken by the joints' resistance since the start [J]
``work_grasp``                 taken by the grips' dampers since the start [J]
``work_constraint``            put in by rigid grasps whose drift is stabilised, since the start [J]
=============================  ========================================================================

Vectors are in world axes; the order of tips, bodies and grasps is the scene's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from spacerobot.closedloop.energy import WORKS, stored_energies
from spacerobot.closedloop.forward_dynamics import Solution
from spacerobot.closedloop.grasps import Constraint, Coupling
from spacerobot.closedloop.parameters import Constants
from spacerobot.closedloop.plant import Plant
from spacerobot.closedloop.references import Motion
from spacerobot.closedloop.start import Start
from spacerobot.closedloop.states import State
from spacerobot.closedloop.tip_control import orientation_error
from spacerobot.dynamics import momentum


def build_outputs(
    plant: Plant,
    start: Start,
    motions: Mapping[str, Motion],
    solution: Solution,
    couplings: Sequence[Coupling],
    constraints: Sequence[Constraint],
    works: Sequence[State],
    constants: Constants,
) -> dict[str, ca.SX]:
    """Named outputs, dense columns."""
    outputs = _tips(plant, motions) | _bodies(plant, start, constants)
    columns = sorted(column for body in plant.scene.bodies for column in plant.arm_columns(body))
    outputs["joint_torque"] = solution.torque[columns]
    outputs |= _grasps(plant, solution, couplings, constraints)
    for name, energy in stored_energies(plant, couplings).items():
        outputs[f"energy_{name}"] = energy
    for name, work in zip(WORKS, works, strict=True):
        outputs[f"work_{name}"] = work.symbol
    return {name: ca.densify(expression) for name, expression in outputs.items()}


def _tips(plant: Plant, motions: Mapping[str, Motion]) -> dict[str, ca.SX]:
    position, velocity, reference, error = [], [], [], []
    for tip in plant.scene.tips:
        rotation, origin = plant.placement(tip.frame)
        motion = motions[tip.label]
        position.append(origin)
        velocity.append(plant.velocity(tip.frame)[0])
        reference.append(motion.position)
        error.append(orientation_error(plant.scene, motion.rotation, rotation))
    stacked = {
        "tip_position": _stack(position),
        "tip_velocity": _stack(velocity),
        "tip_reference": _stack(reference),
    }
    stacked["tip_error"] = stacked["tip_reference"] - stacked["tip_position"]
    stacked["tip_orientation_error"] = _stack(error)
    return stacked


def _bodies(plant: Plant, start: Start, constants: Constants) -> dict[str, ca.SX]:
    position, rotated, linear, angular = [], [], [], []
    for body in plant.scene.bodies:
        rotation, origin = plant.placement(body.root_frame)
        rotation0 = constants.hoist(f"{body.path}.start.rotation", start.placement(body.root_frame)[0])
        position.append(origin)
        rotated.append(orientation_error(plant.scene, rotation, rotation0))
        p, h = momentum(plant.model, plant.kinematics, plant.inertias, joints=body.subtree, about=ca.SX(3, 1))
        linear.append(p)
        angular.append(h)
    return {
        "body_position": _stack(position),
        "body_rotation": _stack(rotated),
        "body_momentum_linear": _stack(linear),
        "body_momentum_angular": _stack(angular),
        "momentum_linear": sum(linear, ca.SX(3, 1)),
        "momentum_angular": sum(angular, ca.SX(3, 1)),
    }


def _grasps(
    plant: Plant, solution: Solution, couplings: Sequence[Coupling], constraints: Sequence[Constraint]
) -> dict[str, ca.SX]:
    force = {c.relative.grasp.name: c.force for c in couplings}
    torque = {c.relative.grasp.name: c.torque for c in couplings}
    relatives = [c.relative for c in couplings] + [c.relative for c in constraints]
    gap = {relative.grasp.name: relative.gap for relative in relatives}
    for constraint, (f, t) in zip(constraints, solution.wrenches, strict=True):
        force[constraint.relative.grasp.name] = f
        torque[constraint.relative.grasp.name] = t
    names = [grasp.name for grasp in plant.scene.grasps]
    return {
        "grasp_force": _stack([force[name] for name in names]),
        "grasp_torque": _stack([torque[name] for name in names]),
        "grasp_gap": _stack([gap[name] for name in names]),
    }


def _stack(vectors: Sequence[ca.SX]) -> ca.SX:
    return ca.vertcat(*vectors) if vectors else ca.SX(0, 1)
