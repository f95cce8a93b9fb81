"""Plant of a scene: kinematics, inertias and resistances as expressions."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.dynamics import ArticulatedBody, Inertias, forward_kinematics
from spacerobot.dynamics.joints import sparse
from spacerobot.dynamics.recorded import recorded
from spacerobot.scene import Scene
from spacerobot.scene.model import lent
from spacerobot.symbolic import Constants, Parameters, Plant


def build_plant(scene: Scene, parameters: Parameters, constants: Constants) -> Plant:
    """Plant of a scene with the mass properties and resistances of its parameters."""
    q, v = ca.SX.sym("q", scene.model.nq), ca.SX.sym("v", scene.model.nv)
    kinematics = forward_kinematics(scene.model, q, v)
    # mass, first moment and inertia about the joint's origin, links welded to a joint added up
    count = scene.model.njoints
    mass = [ca.SX(1, 1) for _ in range(count)]
    moment = [ca.SX(3, 1) for _ in range(count)]
    rotational = [ca.SX(3, 3) for _ in range(count)]
    for body in scene.bodies:
        for name in body.config.links:
            frame = scene.model.frames[scene.model.getFrameId(f"{body.name}/{name}", pin.FrameType.BODY)]
            joint = int(frame.parentJoint)
            if joint == 0:
                continue  # welded to the world
            moments = link_moments(parameters, f"{body.path}.links.{name}", frame.placement)
            mass[joint] += moments[0]
            moment[joint] += moments[1]
            rotational[joint] += moments[2]
        for name, lender, rest in lent(scene.model, body):
            joint = int(lender.parentJoint)
            if joint:
                moments = link_moments(parameters, f"{body.path}.links.{name}", lender.placement * rest)
                mass[joint] -= moments[0]
                moment[joint] -= moments[1]
                rotational[joint] -= moments[2]
    names = [str(name) for name in scene.model.names]
    inertias = Inertias(
        tuple(constants.hoist(f"{n}.mass", x) for n, x in zip(names, mass, strict=True)),
        tuple(constants.hoist(f"{n}.moment", x) for n, x in zip(names, moment, strict=True)),
        tuple(_hoist_symmetric(constants, f"{n}.inertia", x) for n, x in zip(names, rotational, strict=True)),
    )
    articulated = ArticulatedBody.factorise(scene.model, kinematics, inertias)
    stiffness, damping = joint_resistance(scene, parameters, constants)
    spread = sparse(scene.spread)
    relative = sparse(np.eye(scene.model.nv) - scene.spread)
    tied = [relative[scene.model.idx_vs[tie.joint], :].T for tie in scene.ties]
    ties = ca.horzcat(ca.SX(v.size1(), 0), *(articulated.reduced(torque) for torque in tied))
    return Plant(
        scene.model, scene.planar, q, v, kinematics, inertias, articulated, stiffness, damping, ties, spread
    )


def joint_resistance(scene: Scene, parameters: Parameters, constants: Constants) -> tuple[ca.SX, ca.SX]:
    """Stiffness of springs in flexible links, and viscous resistance, of each velocity component (nv x 1).

    Structurally zero for components without stiffness or damping.
    """
    stiffness, damping = ca.SX(scene.model.nv, 1), ca.SX(scene.model.nv, 1)
    for body in scene.bodies:

        def number(name: str, key: str, path: str = body.path) -> ca.SX:
            return parameters(f"{path}.flexible.{name}.{key}")

        springs = body.springs(number)
        for name in body.config.joints:
            column = scene.model.joints[scene.model.getJointId(f"{body.name}/{name}")].idx_v
            path = f"{body.path}.joints.{name}.damping"
            resistance = parameters.sparse(path)
            if name in springs:
                stiffness[column] = constants.hoist(f"{body.path}.joints.{name}.stiffness", springs[name][0])
                resistance = resistance + springs[name][1]
            resistance = constants.hoist(path, resistance)
            if resistance.nnz():
                damping[column] = resistance
    return stiffness, damping


def _hoist_symmetric(constants: Constants, name: str, matrix: ca.SX) -> ca.SX:
    """Hoisted symmetric matrix whose two triangles are the same symbols."""
    lower = constants.hoist(name, ca.tril(matrix))
    return lower + ca.tril(lower, False).T


def link_moments(parameters: Parameters, path: str, placement: Any) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Mass, first moment and inertia of a link about its joint's origin, in the joint's axes.

    An inertia without a value of its own scales with the mass, unless both are varied.
    """
    mass = parameters(f"{path}.mass")
    rotation, offset = sparse(np.asarray(placement.rotation)), sparse(np.asarray(placement.translation))
    com = ca.mtimes(rotation, parameters.sparse_vector(f"{path}.com")) + offset
    xx, yy, zz, xy, xz, yz = (parameters.sparse(f"{path}.inertia.{i}") for i in range(6))
    by_itself = parameters.varies(f"{path}.inertia") and parameters.varies(f"{path}.mass")
    if f"{path}.inertia_at_mass" in parameters and not by_itself:
        scale = mass / parameters(f"{path}.inertia_at_mass")
        xx, yy, zz, xy, xz, yz = (scale * entry for entry in (xx, yy, zz, xy, xz, yz))
    about_com = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
    rotated = ca.mtimes(rotation, ca.mtimes(about_com, rotation.T))
    return mass, mass * com, rotated + _steiner(mass, com)


@recorded((1, 1), (3, 1))
def _steiner(mass: ca.SX, com: ca.SX) -> ca.SX:
    """Share of the parallel-axis theorem in an inertia, kg m^2, 3x3."""
    return mass * (ca.dot(com, com) * ca.SX.eye(3) - ca.mtimes(com, com.T))
