"""The plant: symbolic kinematics, inertias and resistance of the whole scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.closedloop.parameters import Constants, Parameters
from spacerobot.dynamics import (
    ArticulatedBody,
    Inertias,
    Kinematics,
    Wrench,
    forward_kinematics,
    frame_drift,
    frame_jacobian,
    frame_placement,
    frame_velocity,
)
from spacerobot.dynamics.joints import sparse
from spacerobot.scene import Scene, SceneBody


@dataclass(frozen=True)
class Plant:
    """Everything mechanical at one (q, v), world axes.

    Attributes
    ----------
    scene
        What it belongs to.
    q, v
        Symbols of configuration (nq x 1) and velocity (nv x 1).
    damping
        Viscous resistance R_j of each velocity component (nv x 1), structurally zero where there is none.
    ties
        Loads, reduced, along which v' is the acceleration of a joint that mimics another one, relative to
        what it mimics (nv x n); they keep it at zero.
    """

    scene: Scene
    q: ca.SX
    v: ca.SX
    kinematics: Kinematics
    inertias: Inertias
    articulated: ArticulatedBody
    damping: ca.SX
    ties: ca.SX

    @property
    def model(self) -> Any:
        """The scene's ``pinocchio.Model``."""
        return self.scene.model

    def placement(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Rotation (3x3) and origin (3x1) [m] of a frame."""
        return frame_placement(self.model, self.kinematics, frame)

    def velocity(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Linear and angular velocity of a frame's origin (3x1 each) [m/s, rad/s]."""
        return frame_velocity(self.model, self.kinematics, frame)

    def jacobian(self, frame: int) -> ca.SX:
        """Jacobian of a frame (6 x nv), linear rows first."""
        return frame_jacobian(self.model, self.kinematics, frame)

    def drift(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Linear and angular acceleration of a frame at zero joint acceleration (3x1 each)."""
        return frame_drift(self.model, self.kinematics, frame)

    def reduced(self, torque: ca.SX | None = None, wrenches: Sequence[Wrench] = ()) -> ca.SX:
        """Generalized forces and wrenches, reduced (nv x 1); see :mod:`spacerobot.dynamics.articulated`."""
        return self.articulated.reduced(torque, wrenches)

    def reduced_moving(self, torque: ca.SX, wrenches: Sequence[Wrench] = ()) -> ca.SX:
        """The same together with joint resistance, gravity and inertia forces (nv x 1)."""
        return self.articulated.reduced(torque - self.damping * self.v, wrenches, moving=True)

    def arm_columns(self, body: SceneBody) -> list[int]:
        """Places in v of a body's joints, its floating base left out."""
        return [int(self.model.joints[j].idx_v) for j in body.joints]

    def gathered(self, effort: ca.SX) -> ca.SX:
        """Generalized forces (nv x n), those on joints that mimic moved to the joints that they follow."""
        return ca.mtimes(sparse(self.scene.spread.T), effort) if self.scene.ties else effort


def build_plant(scene: Scene, parameters: Parameters, constants: Constants) -> Plant:
    """Plant of a scene with the mass properties and resistances of its parameters."""
    q, v = ca.SX.sym("q", scene.model.nq), ca.SX.sym("v", scene.model.nv)
    kinematics = forward_kinematics(scene.model, q, v)
    inertias = _inertias(scene, parameters, constants)
    articulated = ArticulatedBody.factorise(scene.model, kinematics, inertias)
    damping = ca.SX(scene.model.nv, 1)
    for body in scene.bodies:
        for name in body.config.joints:
            column = scene.model.joints[scene.model.getJointId(f"{body.name}/{name}")].idx_v
            path = f"{body.path}.joints.{name}.damping"
            resistance = constants.hoist(path, parameters.sparse(path))
            if resistance.nnz():
                damping[column] = resistance
    relative = sparse(np.eye(scene.model.nv) - scene.spread)
    tied = [relative[scene.model.idx_vs[tie.joint], :].T for tie in scene.ties]
    ties = ca.horzcat(ca.SX(v.size1(), 0), *(articulated.reduced(torque) for torque in tied))
    return Plant(scene, q, v, kinematics, inertias, articulated, damping, ties)


def _inertias(scene: Scene, parameters: Parameters, constants: Constants) -> Inertias:
    """Mass, first moment and inertia about the joint's origin, links welded to a joint added up."""
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
            own = _link_moments(parameters, f"{body.path}.links.{name}", frame.placement)
            mass[joint] += own[0]
            moment[joint] += own[1]
            rotational[joint] += own[2]
    names = [str(name) for name in scene.model.names]
    return Inertias(
        tuple(constants.hoist(f"{n}.mass", x) for n, x in zip(names, mass, strict=True)),
        tuple(constants.hoist(f"{n}.moment", x) for n, x in zip(names, moment, strict=True)),
        tuple(_hoist_symmetric(constants, f"{n}.inertia", x) for n, x in zip(names, rotational, strict=True)),
    )


def _hoist_symmetric(constants: Constants, name: str, matrix: ca.SX) -> ca.SX:
    """Hoisted symmetric matrix whose two triangles are the same symbols."""
    lower = constants.hoist(name, ca.tril(matrix))
    return lower + ca.tril(lower, False).T


def _link_moments(parameters: Parameters, path: str, placement: Any) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Mass, first moment and inertia of a link about its joint's origin, in the joint's axes."""
    mass = parameters(f"{path}.mass")
    rotation, offset = sparse(np.asarray(placement.rotation)), sparse(np.asarray(placement.translation))
    com = ca.mtimes(rotation, parameters.sparse_vector(f"{path}.com")) + offset
    xx, yy, zz, xy, xz, yz = (parameters.sparse(f"{path}.inertia.{i}") for i in range(6))
    about_com = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
    turned = ca.mtimes(rotation, ca.mtimes(about_com, rotation.T))
    steiner = mass * (ca.dot(com, com) * ca.SX.eye(3) - ca.mtimes(com, com.T))
    return mass, mass * com, turned + steiner
