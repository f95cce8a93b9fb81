"""Wrenches that arms put on their bases."""

from __future__ import annotations

import casadi as ca
import numpy as np

from optim.planning.formulation.stage import Stage
from spacerobot.dynamics import Inertias, centre_of_mass, momentum, total_mass
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.joints import sparse


def base_reactions(stage: Stage) -> dict[str, ca.SX]:
    """Wrenches that the robots' arms put on their bases, by robot: force [N], then torque about the root
    link's origin [N m], world axes, as far as the scene has them; on a fixed base with the opposite sign.

    On a floating base that is the rate of the momentum of the root link, and of wheels on it, less gravity
    and what drives the base; under a fixed one the same of the arm. Grasps act where their tips are.
    """
    scene, model, moving = stage.scene, stage.scene.model, stage.kinematics
    inertias, found = Inertias.from_model(model), {}
    state, rate = ca.vertcat(stage.q, stage.v), ca.vertcat(stage.rate, stage.a)
    for body in scene.robots:
        # panels of the base are part of it, flexible booms of the arm
        own = set(body.driven_joints)
        panels = [j for j in body.passive if own.isdisjoint(model.supports[j])]
        floating = (body.root_joint, *body.owned, *panels)
        joints = floating if body.root_joint else body.joints
        # what the bodies' motion takes in addition to gravity and grasps, about the root link's origin
        momenta = ca.vertcat(*momentum(model, moving, inertias, joints))
        whole = ca.jtimes(momenta, state, rate)
        force, torque = whole[:3], whole[3:]
        weight = total_mass(model, inertias, joints) * sparse(np.asarray(model.gravity.linear))
        acting = [(weight, centre_of_mass(model, moving, inertias, joints))] if weight.nnz() else []
        for grip in (*stage.grips, *stage.springs):
            if int(model.frames[grip.tip.frame].parentJoint) in joints:
                pull, twist = ca.SX(3, 1), ca.SX(3, 1)
                pull[list(scene.translation_axes)], turn = stage.wrench(grip)
                if turn.numel():
                    twist[list(scene.rotation_axes)] = turn
                acting.append((pull, stage.placement(grip.tip.frame)[1]))
                torque -= twist
        for pull, place in acting:
            force, torque = force - pull, torque - cross(place, pull)
        rotation, origin = stage.placement(body.root_frame)
        wrench = ca.vertcat(force, torque - cross(origin, force))
        for name, drive in zip(stage.driven.names, ca.vertsplit(stage.u), strict=True):
            base, _, axis = name.rpartition(".")
            if base == f"{body.name}/base":
                first = 0 if axis[0] == "f" else 3
                wrench[first : first + 3] -= rotation[:, "xyz".index(axis[1])] * drive
        axes = (*scene.translation_axes, *(3 + axis for axis in scene.rotation_axes))
        found[body.name] = wrench[list(axes)]
    return found
