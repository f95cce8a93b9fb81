"""Environments: wrenches from outside on everything that moves, in Pinocchio's numbers."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from spacerobot.common.arrays import Array
from spacerobot.elements import Environment
from spacerobot.elements.environments.orbit import Orbit
from spacerobot.scene import Scene
from tests.oracles.engine.actuation import Push
from tests.oracles.engine.kinematics import Kinematics, cross
from tests.oracles.engine.laws import refusal


@dataclass(frozen=True)
class Surroundings:
    """Wrenches from outside, the power that they put in [W], and what is observed by name."""

    wrenches: tuple[Push, ...]
    power: float
    seen: dict[str, Array]


@functools.singledispatch
def environment_of(config: Environment, scene: Scene, kinematics: Kinematics, t: float) -> Surroundings:
    """What an environment does at time t [s], of each kind."""
    del scene, kinematics, t
    raise refusal(config)


@environment_of.register
def _(config: Orbit, scene: Scene, kinematics: Kinematics, t: float) -> Surroundings:
    """Newton's gravity at two places, one taken from the other; torques by the whole inertia tensor."""
    centre, speed, anomaly = _origin(config, t)
    mu, distance = config.gravitational_parameter, float(np.linalg.norm(centre))
    found, power = [], 0.0
    plane = np.array([1.0, 1.0, 0.0]) if scene.planar else np.ones(3)
    for joint, inertia in enumerate(kinematics.model.inertias.tolist()):
        if joint == 0 or inertia.mass == 0:
            continue
        place, motion = kinematics.data.oMi[joint], kinematics.data.v[joint]
        com = place.act(inertia.lever)
        tensor = place.rotation @ inertia.inertia @ place.rotation.T
        if config.model == "exact":
            there = centre + com
            far = float(np.linalg.norm(there))
            pull = mu * (centre / distance**3 - there / far**3)
        else:
            there, far = centre, distance
            pull = mu * (3 * centre * (centre @ com) / distance**5 - com / distance**3)
        torque = 3 * mu / far**5 * cross(there, tensor @ there) * config.gravity_gradient
        force, torque = inertia.mass * pull * plane, torque * (1 - plane if scene.planar else plane)
        found.append(Push(joint, force, torque, com))
        spin = place.rotation @ motion.angular
        velocity = place.rotation @ (motion.linear + cross(motion.angular, inertia.lever))
        power += float(force @ velocity + torque @ spin)
    seen = {"orbit_anomaly": np.array([anomaly]), "orbit_radius": np.array([distance])}
    return Surroundings(tuple(found), power, seen | _hill(scene, kinematics, centre, speed))


def _hill(scene: Scene, kinematics: Kinematics, centre: Array, speed: Array) -> dict[str, Array]:
    """Bodies' root links in the axes of radius and angular momentum, and as these see them move."""
    normal = cross(centre, speed)
    up, across = centre / np.linalg.norm(centre), normal / np.linalg.norm(normal)
    axes = np.array([up, cross(across, up), across])
    turning = normal / (centre @ centre)
    frames = [kinematics.frame(body.root_frame) for body in scene.bodies]
    places = [axes @ frame.position for frame in frames]
    speeds = [axes @ (frame.velocity[:3] - cross(turning, frame.position)) for frame in frames]
    return {"hill_position": np.concatenate(places), "hill_velocity": np.concatenate(speeds)}


def _origin(config: Orbit, t: float) -> tuple[Array, Array, float]:
    """World's origin from the planet's centre [m], velocity [m/s] and true anomaly [rad] at time t [s]."""
    nearest, axis = config.ends()
    mu, e = config.gravitational_parameter, config.eccentricity
    first = np.radians(config.true_anomaly_deg)
    half = np.arctan2(np.sqrt(1 - e) * np.sin(first / 2), np.sqrt(1 + e) * np.cos(first / 2))
    mean = 2 * half - e * np.sin(2 * half) + np.sqrt(mu / axis**3) * t
    mean = (mean + np.pi) % (2 * np.pi) - np.pi
    swept = float(brentq(lambda x: x - e * np.sin(x) - mean, -4.0, 4.0, xtol=1e-15, rtol=1e-15))
    anomaly = 2 * np.arctan2(np.sqrt(1 + e) * np.sin(swept / 2), np.sqrt(1 - e) * np.cos(swept / 2))
    semilatus = nearest * (1 + e)
    angle, radius = anomaly - first, semilatus / (1 + e * np.cos(anomaly))
    up, along = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
    speed = np.sqrt(mu / semilatus) * (e * np.sin(anomaly) * up + (1 + e * np.cos(anomaly)) * along)
    return radius * up, speed, float(np.arctan2(np.sin(anomaly), np.cos(anomaly)))
