"""Rigid-body algorithms as sparse CasADi expressions over any Pinocchio model of supported joints."""

from spacerobot.dynamics.articulated import ArticulatedBody, Wrench
from spacerobot.dynamics.composite import mass_matrix
from spacerobot.dynamics.configuration import configuration_derivative, normalise
from spacerobot.dynamics.inertias import Inertias
from spacerobot.dynamics.joints import Joint, JointKind, read_joints
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

__all__ = [
    "ArticulatedBody",
    "Inertias",
    "Joint",
    "JointKind",
    "Kinematics",
    "Wrench",
    "centre_of_mass",
    "configuration_derivative",
    "forward_kinematics",
    "frame_drift",
    "frame_jacobian",
    "frame_placement",
    "frame_velocity",
    "kinetic_energy",
    "mass_matrix",
    "momentum",
    "normalise",
    "point_jacobian",
    "read_joints",
    "subtree",
    "total_mass",
]
