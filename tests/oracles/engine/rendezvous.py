"""Following a mating frame of the target: its second writing, by polynomials of numpy."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from spacerobot.common.arrays import Array
from spacerobot.elements.references.rendezvous import Rendezvous
from tests.oracles.engine.kinematics import Kinematics, cross, rotation_vector
from tests.oracles.engine.references import Begins, Leads, Motion, leading
from tests.oracles.engine.sight import Sight

Blend = tuple[Polynomial, Polynomial, Polynomial]
"""A polynomial and its first two derivatives."""


def _derivatives(*coefficients: float) -> Blend:
    """A polynomial and its derivatives, made once: numpy takes long to derive one."""
    first = Polynomial(coefficients)
    return first, first.deriv(), first.deriv(2)


SMOOTH = _derivatives(0, 0, 0, 10, -15, 6)
"""From 0 to 1 without velocity and acceleration at both ends."""
COAST = _derivatives(0, 1, 0, -6, 8, -3)
"""The same for a velocity of 1 at the beginning."""


@dataclass(frozen=True)
class _Frame:
    """A mating frame as it is seen: rotation (3, 3), position, velocity and spin (3,) each."""

    rotation: Array
    position: Array
    velocity: Array
    spin: Array


@leading.register
def _(rendezvous: Rendezvous, begins: Begins) -> Leads:
    return _Follower(rendezvous, begins)


class _Follower:
    """A tip's way relative to a mating frame."""

    ends: tuple[float, ...] = ()

    def __init__(self, config: Rendezvous, begins: Begins) -> None:
        self.config, self.scene, self.sight = config, begins.scene, begins.sight
        self.mated = pin.rpy.rpyToMatrix(np.radians(config.mated_deg))
        first, own = self._seen(begins.start), begins.frame
        back, apart = first.rotation.T, own.position - first.position
        self.offset = back @ apart
        self.drift = back @ (own.velocity - first.velocity - cross(first.spin, apart))
        self.turn = rotation_vector(back @ own.rotation, self.mated)
        axis = np.array(config.axis) / np.linalg.norm(config.axis)
        self.standoff, self.end = -config.standoff * axis, -config.end_distance * axis
        closing = config.duration or 5.0
        if config.closing_speed is not None:
            peak = float(SMOOTH[1](0.5))
            closing = peak * (config.standoff - config.end_distance) / config.closing_speed
        arrives = config.approach_time
        self.times = np.array([arrives, arrives + config.wait, arrives + config.wait + closing])

    def seeing(self, sight: Sight) -> _Follower:
        """The same that sees otherwise from now on."""
        found = copy.copy(self)
        found.sight = sight
        return found

    def _seen(self, kinematics: Kinematics) -> _Frame:
        """The mating frame by the robot's sensors."""
        read = (self.sight.read(f"target_{name}", kinematics) for name in ("position", "velocity", "spin"))
        return _Frame(kinematics.frame(self.sight.frame).rotation, *read)

    def at(self, t: float, within: float, kinematics: Kinematics) -> Motion:
        """Motion at time t [s], by the piece that holds at ``within`` [s]."""
        seen = self._seen(kinematics)
        arrived, begins, ends = self.times
        moved = [np.zeros(3) for _ in range(3)]
        turned = [np.zeros(3) for _ in range(3)]
        for k in range(3):
            away = _blend(SMOOTH, t, within, (0.0, arrived), k)
            near = _blend(SMOOTH, t, within, (begins, ends), k)
            coast = _blend(COAST, t, within, (0.0, arrived), k) * arrived
            moved[k] = (self.standoff - self.offset) * away + self.drift * coast
            moved[k] = moved[k] + (self.end - self.standoff) * near
            turned[k] = -self.turn * away
        moved[0], turned[0] = moved[0] + self.offset, turned[0] + self.turn
        return self._carried(kinematics, seen, moved, turned)

    def _carried(
        self, kinematics: Kinematics, seen: _Frame, moved: list[Array], turned: list[Array]
    ) -> Motion:
        """Motion in the world of a way in the mating frame, with its derivatives."""
        lever, rate, bend = (seen.rotation @ part for part in moved)
        turning, gain = seen.rotation @ turned[1], seen.rotation @ turned[2]
        linear, angular = self._drifting(kinematics, seen)
        spin = seen.spin
        acceleration = (
            linear + cross(angular, lever) + cross(spin, cross(spin, lever)) + 2 * cross(spin, rate)
        )
        return Motion(
            position=seen.position + lever,
            velocity=seen.velocity + cross(spin, lever) + rate,
            acceleration=acceleration + bend,
            rotation=seen.rotation @ pin.exp3(turned[0]) @ self.mated,
            angular_velocity=spin + turning,
            angular_acceleration=angular + cross(spin, turning) + gain,
        )

    def _drifting(self, kinematics: Kinematics, seen: _Frame) -> tuple[Array, Array]:
        """Acceleration of the mating frame and of its spin, free of torque, by the target's whole inertia."""
        target = self.scene.target
        if target is None or not target.root_joint:
            return np.zeros(3), np.zeros(3)
        whole = pin.Inertia.Zero()
        for joint in target.subtree:
            whole += kinematics.data.oMi[joint].act(self.scene.model.inertias[joint])
        momentum = whole.inertia @ seen.spin
        angular = np.linalg.solve(whole.inertia, cross(momentum, seen.spin))
        if self.scene.planar:
            angular = np.zeros(3)
        lever = seen.position - whole.lever
        linear = cross(angular, lever) + cross(seen.spin, cross(seen.spin, lever))
        return self.scene.model.gravity.linear + linear, angular


def _blend(shape: Blend, t: float, within: float, span: tuple[float, float], order: int) -> float:
    """Derivative of a given order of a polynomial that is stretched over a time."""
    begin, end = span
    if within < begin:
        return 0.0
    if within >= end:
        return float(shape[0](1.0)) if order == 0 else 0.0
    length = end - begin
    return float(shape[order]((t - begin) / length)) / length**order
