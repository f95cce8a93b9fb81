"""Grasps: one pair of opposite wrenches at the tip's point, given by springs or asked for by a constraint."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.elements import Grasp
from spacerobot.elements.grasps.compliant import Compliant
from spacerobot.elements.grasps.point import Point
from spacerobot.elements.grasps.weld import Weld
from spacerobot.scene import Scene, SceneGrasp
from tests.oracles.engine.kinematics import Kinematics, cross, rotation_vector
from tests.oracles.engine.laws import refusal
from tests.oracles.engine.references import Jet


@dataclass(frozen=True)
class Relative:
    """Tip relative to the target, world axes.

    Attributes:
        point: The tip's origin (3,) [m].
        apart, turned: From mating frame to tip (3,) [m]; rotation vector from where mated to the tip (3,)
            [rad].
        slip: Velocity of the tip relative to the target's material point there, then angular (6,).
        jacobian: Its Jacobian (6, nv).
        gap, twist, velocity, drift: The same less the rest's own, and the rate of the velocity at zero joint
            acceleration (6,).
        rest_velocity: Of the rest, then angular (6,).
        mate_rotation: Of the mating frame (3, 3).
    """

    point: Array
    apart: Array
    turned: Array
    slip: Array
    jacobian: Array
    gap: Array
    twist: Array
    velocity: Array
    drift: Array
    rest_velocity: Array
    mate_rotation: Array


@dataclass(frozen=True)
class Rest:
    """Where a tip is at rest, axes of the mating frame.

    Attributes:
        mated: Its orientation where mated (3, 3).
        gap, turn: From there to the rest (3,) [m], and the rotation vector (3,) [rad], of a constant
            direction; each with its first two derivatives.
    """

    mated: Array
    gap: Jet = (np.zeros(3), np.zeros(3), np.zeros(3))
    turn: Jet = (np.zeros(3), np.zeros(3), np.zeros(3))


def relative_motion(kinematics: Kinematics, grasp: SceneGrasp, rest: Rest) -> Relative:
    """Relative motion of a grasp."""
    tip, mate = kinematics.frame(grasp.tip.frame), kinematics.frame(grasp.frame)
    gap = tip.position - mate.position
    # velocity of the target's material point at the tip: shift the mating frame's by the gap
    shift, shift_rate = np.eye(6), np.zeros((6, 6))
    shift[:3, 3:] = -pin.skew(gap)
    shift_rate[:3, 3:] = -pin.skew(tip.velocity[:3] - mate.velocity[:3])
    place, moving, bend = (mate.rotation @ part for part in rest.gap)
    _, turning, gain = (mate.rotation @ part for part in rest.turn)
    spin, slip = mate.velocity[3:], tip.velocity - shift @ mate.velocity
    own = np.concatenate([moving, turning])
    own_rate = np.concatenate([cross(spin, moving) + bend, cross(spin, turning) + gain])
    wanted = mate.rotation @ pin.exp3(rest.turn[0]) @ rest.mated
    return Relative(
        point=tip.position,
        apart=gap,
        turned=rotation_vector(tip.rotation, mate.rotation @ rest.mated),
        slip=slip,
        jacobian=tip.jacobian - shift @ mate.jacobian,
        gap=gap - place,
        twist=rotation_vector(tip.rotation, wanted),
        velocity=slip - own,
        drift=tip.drift - shift @ mate.drift - shift_rate @ mate.velocity - own_rate,
        rest_velocity=own,
        mate_rotation=mate.rotation,
    )


@dataclass(frozen=True)
class Coupling:
    """Wrench of a compliant grasp on the target (3,) each, energy [J] and dissipated power [W]."""

    force: Array
    torque: Array
    energy: float
    dissipation: float


@dataclass(frozen=True)
class Constraint:
    """A rigid grasp, ``jacobian v' = right``.

    Attributes:
        rows: Which of the six components of the relative motion it fixes.
        jacobian, right: (n, nv) and (n,); drift decays critically damped (Baumgarte).
    """

    grasp: SceneGrasp
    relative: Relative
    rows: list[int]
    jacobian: Array
    right: Array


@functools.singledispatch
def grasp_of(config: Grasp, scene: Scene, grasp: SceneGrasp, relative: Relative) -> Coupling | Constraint:
    """What a grasp does at one instant, of each kind."""
    del scene, grasp, relative
    raise refusal(config)


@grasp_of.register
def _(config: Compliant, scene: Scene, grasp: SceneGrasp, relative: Relative) -> Coupling:
    """Springs and dampers."""
    del grasp
    along, about = mask(scene.translation_axes), mask(scene.rotation_axes)
    gap, velocity = along * relative.gap, along * relative.velocity[:3]
    twist, spin = about * relative.twist, about * relative.velocity[3:]
    stiffness, damping = config.rotational_stiffness or 0.0, config.rotational_damping or 0.0
    return Coupling(
        config.stiffness * gap + config.damping * velocity,
        stiffness * twist + damping * spin,
        float(0.5 * (config.stiffness * gap @ gap + stiffness * twist @ twist)),
        float(config.damping * velocity @ velocity + damping * spin @ spin),
    )


@grasp_of.register
def _(config: Point, scene: Scene, grasp: SceneGrasp, relative: Relative) -> Constraint:
    return _rigid(config, list(scene.translation_axes), grasp, relative)


@grasp_of.register
def _(config: Weld, scene: Scene, grasp: SceneGrasp, relative: Relative) -> Constraint:
    rows = [*scene.translation_axes, *(axis + 3 for axis in scene.rotation_axes)]
    return _rigid(config, rows, grasp, relative)


def _rigid(config: Point | Weld, rows: list[int], grasp: SceneGrasp, relative: Relative) -> Constraint:
    """Constraint of some components of the relative motion."""
    rate, offset = config.stabilisation, np.concatenate([relative.gap, relative.twist])
    right = -(relative.drift + 2 * rate * relative.velocity + rate**2 * offset)
    return Constraint(grasp, relative, rows, relative.jacobian[rows], right[rows])


def rest_orientation(kinematics: Kinematics, grasp: SceneGrasp) -> Array:
    """Tip's orientation in the mating frame (3, 3)."""
    tip, mate = kinematics.frame(grasp.tip.frame), kinematics.frame(grasp.frame)
    rest: Array = mate.rotation.T @ tip.rotation
    return rest


def mask(axes: tuple[int, ...]) -> Array:
    """Ones at some of three axes (3,)."""
    found = np.zeros(3)
    found[list(axes)] = 1.0
    return found
