"""Neighbourhood of a reference orbit, in non-rotating axes or in Hill axes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from spacerobot.common.section import quantity
from spacerobot.dynamics.algebra import cross
from spacerobot.elements.core.contribution import Contribution, Output
from spacerobot.elements.core.registry import register
from spacerobot.elements.environments.environment import Environment, EnvironmentContext, Load
from spacerobot.elements.references.reference import DEGREE

_ITERATIONS = 7  # exact to rounding up to an eccentricity of 0.999


@dataclass(frozen=True)
class OrbitState:
    """Reference orbit at one instant; its plane is x-y of the world.

    Attributes:
        direction: Radial unit vector of the origin, world axes (3x1).
        radius: Distance of the origin from the planet's centre [m].
        rate, strength: Rotation rate of the radial direction [rad/s]; mu / r^3 [1/s^2].
        anomaly: True anomaly [rad], between -pi and pi.
    """

    direction: ca.SX
    radius: ca.SX
    rate: ca.SX
    strength: ca.SX
    anomaly: ca.SX

    @property
    def axis(self) -> ca.SX:
        """Angular velocity of the radial direction (3x1) [rad/s]."""
        return ca.vertcat(ca.SX(2, 1), self.rate)

    def hill(self, vector: ca.SX) -> ca.SX:
        """World axes to radial, along-track and cross-track (3x1 each)."""
        cos, sin = self.direction[0], self.direction[1]
        x, y = vector[0], vector[1]
        return ca.vertcat(cos * x + sin * y, cos * y - sin * x, vector[2])


@register
class Orbit(Environment):
    """Gravity near a point on a reference orbit relative to that point, and gravity gradient torques."""

    kind: Literal["orbit"] = "orbit"
    falls: ClassVar[bool] = True
    altitude: float | None = quantity(
        "m", "of the periapsis above the planet's surface; give it or `semi_major_axis`", default=None, gt=0
    )
    semi_major_axis: float | None = quantity("m", "of the reference orbit", default=None, gt=0)
    eccentricity: float = quantity("1", "of the reference orbit; 0 is a circle", default=0.0, ge=0, le=0.999)
    true_anomaly_deg: float = quantity("deg", "true anomaly at the start", default=0.0)
    gravitational_parameter: float = quantity(
        "m^3/s^2", "mu of the planet; the Earth's if not given", default=3.986004418e14, gt=0
    )
    planet_radius: float = quantity(
        "m", "of the planet's surface; the Earth's equator if not given", default=6378137.0, gt=0
    )
    model: Literal["exact", "linear"] = Field(
        default="exact",
        description="exact: difference of two inverse squares; linear: its first order in the distance "
        "(Clohessy and Wiltshire's on a circle)",
    )
    gravity_gradient: bool = Field(default=True, description="whether gravity turns bodies, each by itself")
    axes: Literal["inertial", "rotating"] = Field(
        default="inertial",
        description="world axes: inertial, or rotating with the radial, along-track and cross-track "
        "directions of a circular orbit; velocities, spins and attitudes, of sensors too, are then relative "
        "to those",
    )

    @model_validator(mode="after")
    def _check(self) -> Orbit:
        if self.axes == "rotating" and self.eccentricity:
            raise ValueError(
                "axes: found rotating, allowed: inertial on an orbit with eccentricity "
                f"{self.eccentricity:g}; or make it 0"
            )
        if (self.altitude is None) == (self.semi_major_axis is None):
            raise ValueError("give either `altitude` or `semi_major_axis`")
        if self.semi_major_axis is not None:
            nearest = self.semi_major_axis * (1 - self.eccentricity)
            if nearest <= self.planet_radius:
                raise ValueError(
                    f"semi_major_axis: the periapsis is {nearest:g} m from the planet's centre, allowed: "
                    f"above its surface, {self.planet_radius:g} m; raise it or lower `eccentricity`"
                )
        return self

    def build(self, environment: EnvironmentContext) -> Contribution:
        """Contribution: force and torque on all moving bodies, and their motion in Hill axes as outputs."""
        # present state of the reference orbit
        context = environment.context
        number, path = context.parameters, context.path
        mu, e = number(f"{path}.gravitational_parameter"), number.sparse(f"{path}.eccentricity")
        if self.semi_major_axis is not None:
            axis = number(f"{path}.semi_major_axis")
        else:
            axis = (number(f"{path}.planet_radius") + number(f"{path}.altitude")) / (1 - e)
        first = number(f"{path}.true_anomaly_deg") * DEGREE
        rate, a = context.once("rate", ca.sqrt(mu / axis) / axis), context.once("axis", axis)
        if not e.nnz():
            angle = rate * context.time
            reached = context.once("anomaly", first) + angle
            anomaly = ca.atan2(ca.sin(reached), ca.cos(reached))
            if self.axes == "rotating":
                line = ca.vertcat(1, ca.SX(2, 1))
            else:
                line = ca.vertcat(ca.cos(angle), ca.sin(angle), 0)
            orbit = OrbitState(line, a, rate, context.once("strength", mu / axis**3), anomaly)
        else:
            narrow = ca.sqrt((1 - e) * (1 + e))
            swept = ca.atan2(narrow * ca.sin(first), e + ca.cos(first))
            mean = context.once("mean", swept - e * ca.sin(swept))
            e, narrow = context.once("eccentricity", e), context.once("narrow", narrow)
            swept = eccentric_anomaly(mean + rate * context.time, e)
            near = 1 - e * ca.cos(swept)
            cos, sin = (ca.cos(swept) - e) / near, narrow * ca.sin(swept) / near
            cos0, sin0 = context.once("cos", ca.cos(first)), context.once("sin", ca.sin(first))
            line = ca.vertcat(cos * cos0 + sin * sin0, sin * cos0 - cos * sin0, 0)
            rotation_rate = rate * narrow / near**2
            orbit = OrbitState(line, a * near, rotation_rate, rate**2 / near**3, ca.atan2(sin, cos))
        pairs = []
        for load in environment.loads:
            # acceleration relative to the origin's at a place (3x1), the vertical there and mu / r^3
            place = load.com
            if self.model == "linear":
                up = ca.dot(orbit.direction, place)
                pull = -orbit.strength * (place - 3 * up * orbit.direction)
                line = orbit.direction
                strength = orbit.strength
            else:
                at = orbit.radius * orbit.direction
                s = ca.dot(place, place + 2 * at) / orbit.radius**2
                length = ca.sqrt(1 + s)
                power = (1 + s) * length
                strength, f = orbit.strength / power, s * (3 + 3 * s + s**2) / (1 + power)
                pull = -strength * (place - f * at)
                line = (at + place) / (orbit.radius * length)
            torque = ca.SX(3, 1)
            if self.gravity_gradient:
                local_line = ca.mtimes(load.rotation.T, line)
                couple = cross(local_line, ca.mtimes(load.inertia, local_line))
                torque = 3 * strength * ca.mtimes(load.rotation, couple)
            force = load.mass * pull
            if self.axes == "rotating":
                inertial_force, inertial_torque = frame_rotation_wrench(load, orbit.axis)
                force, torque = force + inertial_force, torque + inertial_torque
            pairs.append(environment.acting(load, force, torque))
        return Contribution(
            outside=tuple(wrench for wrench, _ in pairs),
            powers=tuple(power for _, power in pairs),
            outputs=(
                Output(
                    "orbit_anomaly",
                    orbit.anomaly,
                    "rad",
                    "true anomaly of the reference orbit",
                    plotted=False,
                ),
                Output(
                    "orbit_radius",
                    orbit.radius,
                    "m",
                    "distance of the world's origin from the planet's centre",
                    plotted=False,
                ),
                *_relative(orbit, environment, self.axes == "rotating"),
            ),
        )

    def mean_motion(self) -> float | None:
        """Mean motion of a circular orbit [rad/s]; None for others, and in axes that rotate."""
        if self.eccentricity or self.axes == "rotating":
            return None
        return math.sqrt(self.gravitational_parameter / self.ends()[1] ** 3)

    def assumptions(self) -> list[str]:
        """Location of the world frame."""
        axes = "its axes do not rotate: x radial, y along-track, z cross-track, as they are at the start"
        if self.axes == "rotating":
            axes = "its axes rotate with it: x radial, y along-track, z cross-track"
        return [
            f"the world's origin moves along the reference orbit and {axes}",
            "a spherical planet and nothing else; the planet does not feel the scene",
        ]

    def words(self) -> str:
        """Semi-major axis, mean motion and model."""
        periapsis, axis = self.ends()
        period = 2 * math.pi * math.sqrt(axis**3 / self.gravitational_parameter)
        shape = f"e = {self.eccentricity:g}, " if self.eccentricity else ""
        rate = math.sqrt(self.gravitational_parameter * periapsis * (1 + self.eccentricity))
        along = 1 + self.eccentricity * math.cos(math.radians(self.true_anomaly_deg))
        rate /= (periapsis * (1 + self.eccentricity) / along) ** 2
        return (
            f"{self.model} orbit, a = {axis / 1e3:.7g} km, {shape}period {period:.6g} s, turns by "
            f"{math.degrees(rate):.6g} deg/s at the start"
        )

    def ends(self) -> tuple[float, float]:
        """Distance of the periapsis from the planet's centre, and semi-major axis [m]."""
        if self.semi_major_axis is not None:
            return self.semi_major_axis * (1 - self.eccentricity), self.semi_major_axis
        nearest = self.planet_radius + (self.altitude or 0.0)
        return nearest, nearest / (1 - self.eccentricity)


def eccentric_anomaly(mean: ca.SX, eccentricity: ca.SX) -> ca.SX:
    """Eccentric anomaly E [rad] of a mean anomaly: E - e sin E = M (1x1 each), between -pi and pi.

    Newton's method with the next order (Halley), a fixed number of times.
    """
    mean = mean - 2 * ca.pi * ca.floor(mean / (2 * ca.pi) + 0.5)
    e, swept = eccentricity, mean + 0.85 * eccentricity * ca.sign(mean)
    for _ in range(_ITERATIONS):
        sin, slope = e * ca.sin(swept), 1 - e * ca.cos(swept)
        open_ = swept - sin - mean
        swept = swept - open_ * slope / (slope**2 - 0.5 * open_ * sin)
    return swept


def frame_rotation_wrench(load: Load, axis: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Inertial force and torque on a load in world axes that rotate at a constant rate.

    Let u be the velocity of its centre of mass p and w its spin, relative to axes that rotate with W; its
    inertial spin is w + W. Newton's and Euler's equations then become those of the relative motion with

        F = -m (2 W x u + W x (W x p)),
        T = -(w x I W - I (w x W) + W x I (w + W)),

    the Coriolis and centrifugal force, and the rate of I (w + W) due to the rotation of the axes.

    Args:
        load: Load of one joint.
        axis: Angular velocity W of the world's axes (3x1) [rad/s].
    """
    force = -load.mass * (2 * cross(axis, load.velocity) + cross(axis, cross(axis, load.com)))
    w, turn = ca.mtimes(load.rotation.T, load.spin), ca.mtimes(load.rotation.T, axis)
    torque = cross(w, ca.mtimes(load.inertia, turn)) - ca.mtimes(load.inertia, cross(w, turn))
    torque = torque + cross(turn, ca.mtimes(load.inertia, w + turn))
    return force, -ca.mtimes(load.rotation, torque)


def _relative(orbit: OrbitState, environment: EnvironmentContext, rotating: bool) -> Iterator[Output]:
    """Position and velocity of the bodies' root links in Hill axes, which rotate."""
    axes = "radial, along-track, cross-track"
    for name, frame in environment.roots.items():
        place, speed = environment.plant.placement(frame)[1], environment.plant.velocity(frame)[0]
        hill_velocity = orbit.hill(speed if rotating else speed - cross(orbit.axis, place))
        yield Output("hill_position", orbit.hill(place), "m", f"position of bodies: {axes}", "body", name)
        yield Output("hill_velocity", hill_velocity, "m/s", f"velocity of bodies: {axes}", "body", name)
