"""Contacts: pairs of opposite forces by coal's distances between shapes that Pinocchio places."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.optimize import brentq
from scipy.special import lambertw

from spacerobot.common.arrays import Array
from spacerobot.elements import Contact
from spacerobot.elements.contacts.hunt_crossley import HuntCrossley
from spacerobot.pinocchio_engine.crowned_distance import shape_distance
from spacerobot.scene.scene import SceneContact, SceneShape
from tests.oracles.engine.kinematics import Kinematics, cross
from tests.oracles.engine.laws import refusal


@dataclass(frozen=True)
class Touch:
    """A pair of shapes, and what it does.

    Attributes:
        pair: The two shapes.
        gap: Signed distance [m].
        normal, point: From the first to the second, and where it acts (3,) each, world axes.
        velocity: Of the second relative to the first there (3,) [m/s].
    """

    pair: tuple[SceneShape, SceneShape]
    gap: float
    normal: Array
    point: Array
    velocity: Array

    @property
    def opening(self) -> float:
        """Rate of the gap [m/s]."""
        return float(self.normal @ self.velocity)


@dataclass(frozen=True)
class Pressure:
    """Force on the second shape (3,) [N], its part along the normal [N], energy [J] and lost power [W]."""

    touch: Touch
    force: Array
    normal_force: float
    energy: float
    dissipation: float


def touches(kinematics: Kinematics, contact: SceneContact) -> Iterator[Touch]:
    """Every pair of shapes of a contact."""
    for pair in contact.pairs:
        frames = [kinematics.frame(shape.frame) for shape in pair]
        places = [pin.SE3(frame.rotation, frame.position) for frame in frames]
        gap, normal, point = shape_distance(pair, places, contact.config.crown)
        speeds = [f.velocity[:3] + cross(f.velocity[3:], point - f.position) for f in frames]
        yield Touch(pair, gap, normal, point, speeds[1] - speeds[0])


@functools.singledispatch
def contact_of(config: Contact, touch: Touch) -> Pressure:
    """What a pair of shapes does at one instant, of each kind of contact."""
    del touch
    raise refusal(config)


@contact_of.register
def _(config: HuntCrossley, touch: Touch) -> Pressure:
    """Hunt and Crossley's normal force and regularised friction."""
    if touch.gap >= 0:
        return Pressure(touch, np.zeros(3), 0.0, 0.0, 0.0)
    depth, rate = -touch.gap, -touch.opening
    elastic = config.stiffness * depth**config.exponent
    pressed = max(elastic * (1 + dissipation_of(config) * rate), 0.0)
    across = touch.velocity - touch.opening * touch.normal
    regular = np.sqrt(across @ across + config.slip_velocity**2)
    force = pressed * (touch.normal - config.friction * across / regular)
    stored = config.stiffness * depth ** (config.exponent + 1) / (config.exponent + 1)
    return Pressure(touch, force, pressed, stored, -float(force @ touch.velocity) - elastic * rate)


@functools.singledispatch
def dissipation_of(config: Contact) -> float:
    """Reciprocal of the speed of parting at which a force would begin to pull [s/m]; 0 if it never does."""
    raise refusal(config)


@dissipation_of.register
def _(config: HuntCrossley) -> float:
    """The coefficient a, of a coefficient of restitution by bisection of its closed form."""
    if config.restitution is None or config.restitution_speed is None:
        return config.dissipation or 0.0
    return _speed_ratio(config.restitution) / config.restitution_speed


@functools.cache
def _speed_ratio(restitution: float) -> float:
    """Dissipation times speed of approach; both bounds are those of its limits, towards 0 and 1."""
    bounds = 0.5 * (1 - restitution), 2 / restitution
    return float(brentq(lambda x: restitution_of(x) - restitution, *bounds, xtol=1e-300, rtol=1e-15))


def restitution_of(x: float) -> float:
    """Coefficient of restitution of two free bodies, of the dissipation times their speed of approach.

    ``-(1 - e x) exp(e x - 1) = -(1 + x) exp(-(1 + x))``, solved by Lambert's W.
    """
    above = 1 + x
    return float((1 + lambertw(-above * np.exp(-above)).real) / x)
