"""Rigid-body algorithms as sparse CasADi expressions over any Pinocchio model of supported joints."""

from spacerobot.dynamics.articulated import ArticulatedBody, Wrench
from spacerobot.dynamics.composite import mass_matrix
from spacerobot.dynamics.configuration import configuration_derivative, normalise
from spacerobot.dynamics.free_floating import FreeFloating, FreeFloatingRobot
from spacerobot.dynamics.inertias import Inertias
from spacerobot.dynamics.joints import JointKind, JointModel, read_joints
from spacerobot.dynamics.kinematics import (
    Kinematics,
    forward_kinematics,
    frame_drift,
    frame_jacobian,
    frame_placement,
    frame_velocity,
    point_jacobian,
)
from spacerobot.dynamics.momentum import centre_of_mass, kinetic_energy, momentum, subtree, total_mass
from spacerobot.dynamics.recursive import inverse_dynamics
from spacerobot.dynamics.rotations import (
    quaternion_from_rotation,
    rotation_exp,
    rotation_from_quaternion,
    rotation_from_rpy,
    rotation_log,
)

__all__ = [
    "ArticulatedBody",
    "FreeFloating",
    "FreeFloatingRobot",
    "Inertias",
    "JointKind",
    "JointModel",
    "Kinematics",
    "Wrench",
    "centre_of_mass",
    "configuration_derivative",
    "forward_kinematics",
    "frame_drift",
    "frame_jacobian",
    "frame_placement",
    "frame_velocity",
    "inverse_dynamics",
    "kinetic_energy",
    "mass_matrix",
    "momentum",
    "normalise",
    "point_jacobian",
    "quaternion_from_rotation",
    "read_joints",
    "rotation_exp",
    "rotation_from_quaternion",
    "rotation_from_rpy",
    "rotation_log",
    "subtree",
    "total_mass",
]
