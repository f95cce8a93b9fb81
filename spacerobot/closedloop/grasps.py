"""Grasps: compliant couplings as wrenches, rigid ones as acceleration constraints.

Both act as *one* pair of opposite wrenches at one point, the tip's, so that momentum is conserved to
rounding. Velocities are those of the tip relative to the target's material point that coincides with it.
The mating points' own motion (Eq. 14-25) follows from the target's frames; a test holds it to the printed
formulas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from spacerobot.closedloop.parameters import Constants, Parameters
from spacerobot.closedloop.plant import Plant
from spacerobot.closedloop.start import Start
from spacerobot.closedloop.tip_control import orientation_error, unit_load
from spacerobot.dynamics import Wrench
from spacerobot.dynamics.algebra import SymmetricFactors, cross
from spacerobot.scenario import Compliant, Weld
from spacerobot.scene import SceneGrasp


@dataclass(frozen=True)
class Relative:
    """Tip relative to mating frame, world axes.

    Attributes
    ----------
    point
        Where the wrenches act: the tip's origin (3x1) [m].
    gap
        From mating frame to tip (3x1) [m].
    twist
        Rotation vector from the mating frame's orientation, turned as at the start, to the tip's (3x1) [rad].
    velocity, spin
        Of the tip relative to the target at ``point`` (3x1 each) [m/s, rad/s].
    """

    grasp: SceneGrasp
    point: ca.SX
    gap: ca.SX
    twist: ca.SX
    velocity: ca.SX
    spin: ca.SX


@dataclass(frozen=True)
class Coupling:
    """A compliant grasp.

    Attributes
    ----------
    force, torque
        On the target at the tip's point, world axes (3x1 each) [N, N m].
    energy
        Held in its springs (1x1) [J].
    dissipation
        Power its dampers take (1x1) [W].
    """

    relative: Relative
    force: ca.SX
    torque: ca.SX
    energy: ca.SX
    dissipation: ca.SX


@dataclass(frozen=True)
class Constraint:
    """A rigid grasp: the tip's acceleration relative to the target, and the wrenches that make it vanish.

    Attributes
    ----------
    directions
        Unit force and torque on the tip, opposite on the target at the same point (pairs of 3x1), of exact
        rank: two or three, and one or three more for a weld.
    sense
        The same loads, reduced, along which v' is the relative acceleration, drift left out (nv x n).
    drift
        Remaining acceleration and stabilisation (n x 1).
    slip
        The relative velocity itself (n x 1).
    """

    relative: Relative
    sense: ca.SX
    drift: ca.SX
    slip: ca.SX
    directions: tuple[tuple[ca.SX, ca.SX], ...]

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.directions)


def opposite(relative: Relative, force: ca.SX, torque: ca.SX) -> tuple[Wrench, Wrench]:
    """One pair of opposite wrenches at the tip's point: on the target and on the robot."""
    tip, target = relative.grasp.tip.joint, relative.grasp.joint
    return (
        Wrench(target, force, torque, relative.point),
        Wrench(tip, -force, -torque, relative.point),
    )


def build_relative(plant: Plant, start: Start, grasp: SceneGrasp, constants: Constants) -> Relative:
    """Relative position, orientation and velocity of a grasp's two frames."""
    tip_rotation, tip_position = plant.placement(grasp.tip.frame)
    mate_rotation, mate_position = plant.placement(grasp.frame)
    tip_velocity, tip_spin = plant.velocity(grasp.tip.frame)
    mate_velocity, mate_spin = plant.velocity(grasp.frame)
    gap = tip_position - mate_position
    tip0, mate0 = start.placement(grasp.tip.frame)[0], start.placement(grasp.frame)[0]
    rest = constants.hoist(f"{grasp.path}.rest", ca.mtimes(mate0.T, tip0))
    return Relative(
        grasp,
        tip_position,
        gap,
        orientation_error(plant.scene, tip_rotation, ca.mtimes(mate_rotation, rest)),
        tip_velocity - mate_velocity - cross(mate_spin, gap),
        tip_spin - mate_spin,
    )


def build_coupling(
    plant: Plant, relative: Relative, config: Compliant, parameters: Parameters, constants: Constants
) -> Coupling:
    """Spring and damper between tip and mating point (K_g, R_g), and between their orientations if asked."""
    path = relative.grasp.path

    def number(key: str) -> ca.SX:
        return constants.hoist(f"{path}.{key}", parameters(f"{path}.{key}"))

    along, about = list(plant.scene.translation_axes), list(plant.scene.rotation_axes)
    stiffness, damping = number("stiffness"), number("damping")
    gap, velocity = _only(relative.gap, along), _only(relative.velocity, along)
    force = stiffness * gap + damping * velocity
    energy = stiffness * ca.dot(gap, gap) / 2
    dissipation = damping * ca.dot(velocity, velocity)
    torque, twist, spin = ca.SX(3, 1), _only(relative.twist, about), _only(relative.spin, about)
    if config.rotational_stiffness is not None:
        rotational = number("rotational_stiffness")
        torque = torque + rotational * twist
        energy = energy + rotational * ca.dot(twist, twist) / 2
    if config.rotational_damping is not None:
        rotational = number("rotational_damping")
        torque = torque + rotational * spin
        dissipation = dissipation + rotational * ca.dot(spin, spin)
    return Coupling(relative, force, torque, energy, dissipation)


def build_constraint(
    plant: Plant, relative: Relative, parameters: Parameters, constants: Constants
) -> Constraint:
    """Acceleration constraint of a rigid grasp, its drift stabilised (Baumgarte, critically damped)."""
    grasp = relative.grasp
    path = f"{grasp.path}.stabilisation"
    rate = constants.hoist(path, parameters(path))
    tip_drift, mate_drift = plant.drift(grasp.tip.frame), plant.drift(grasp.frame)
    tip_velocity, mate = plant.velocity(grasp.tip.frame)[0], plant.velocity(grasp.frame)
    linear = (
        tip_drift[0]
        - mate_drift[0]
        - cross(mate_drift[1], relative.gap)
        - cross(mate[1], tip_velocity - mate[0])
    )
    linear = linear + 2 * rate * relative.velocity + rate**2 * relative.gap
    along = list(plant.scene.translation_axes)
    drift, directions = [linear[along]], [unit_load(axis, rotation=False) for axis in along]
    slip = [relative.velocity[along]]
    if isinstance(grasp.config, Weld):
        about = list(plant.scene.rotation_axes)
        angular = tip_drift[1] - mate_drift[1] + 2 * rate * relative.spin + rate**2 * relative.twist
        drift.append(angular[about])
        slip.append(relative.spin[about])
        directions += [unit_load(axis, rotation=True) for axis in about]
    loads = [plant.reduced(wrenches=opposite(relative, -force, -torque)) for force, torque in directions]
    return Constraint(relative, ca.horzcat(*loads), ca.vertcat(*drift), ca.vertcat(*slip), tuple(directions))


def close_velocity(plant: Plant, constraints: Sequence[Constraint]) -> ca.SX:
    """The plant's velocity, changed so that no rigid grasp slips, at the least kinetic energy (nv x 1).

    The change is what an impulse in each grasp makes, as if all closed at once; none where nothing slips.
    """
    sense = ca.horzcat(*(constraint.sense for constraint in constraints), plant.ties)
    slip = ca.vertcat(*(constraint.slip for constraint in constraints), ca.SX(plant.ties.size2(), 1))
    factors = SymmetricFactors(-plant.articulated.negated_mobility(sense, sense))
    return plant.v + plant.articulated.motion(ca.mtimes(sense, factors.solve_negated(slip)))


def _only(vector: ca.SX, axes: list[int]) -> ca.SX:
    """Vector with the other components structurally zero."""
    kept = ca.SX(3, 1)
    for axis in axes:
        kept[axis] = vector[axis]
    return kept
