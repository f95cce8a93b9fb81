"""Flight of a chaser with an arm in orbit, by Kane's equations of all its links.

It shares no code with planner and simulator: the arm is read from its URDF, and the equations are

    sum_i Jv_i' (m_i a_i - f_i) + Jw_i' (I_i alpha_i + w_i x I_i w_i - n_i) = (f, t, tau)

with accelerations a_i, alpha_i, gravity f_i and the torque of the gravity gradient n_i of each link, thrust
f and torque t on the base, and torques tau of the joints. All vectors are in the base's axes. Positions are
relative to a point on the circular reference orbit, in axes that do not rotate.
"""

from __future__ import annotations

import functools
import itertools
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from spacerobot.common.arrays import Array

STEP = 0.05
"""Time between two states of a flight [s]."""


@dataclass(frozen=True, eq=False)
class ArmLink:
    """A link of the arm with the joint before it, of the base for the first.

    Attributes:
        rotation, origin: Placement of the joint in the previous link (3, 3), (3,) [m].
        axis: Axis of the joint in the link's axes (3,); zero where the joint is fixed.
        mass, com, inertia: Mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg m^2].
        lower, upper, rate, torque: Limits of the joint [rad, rad, rad/s, N m].
        cylinders: Shapes: placement (4, 4), radius and length [m].
    """

    rotation: Array
    origin: Array
    axis: Array
    mass: float
    com: Array
    inertia: Array
    lower: float
    upper: float
    rate: float
    torque: float
    cylinders: tuple[tuple[Array, float, float], ...]

    @functools.cached_property
    def turns(self) -> bool:
        """Whether its joint moves."""
        return bool(self.axis.any())

    @functools.cached_property
    def crosses(self) -> tuple[Array, Array]:
        """Matrix (3, 3) of the cross product with its joint's axis, and its square."""
        return skew(self.axis), skew(self.axis) @ skew(self.axis)


def numbers(element: ElementTree.Element | None, key: str) -> Array:
    """Vector (3,) of an attribute; zeros where it is missing."""
    text = None if element is None else element.get(key)
    return np.array([float(word) for word in (text or "0 0 0").split()])


def turned(element: ElementTree.Element | None) -> Array:
    """Rotation (3, 3) of an ``origin``: roll, pitch and yaw about fixed axes."""
    return np.asarray(Rotation.from_euler("xyz", numbers(element, "rpy")).as_matrix())


def read_arm(path: Path, position: Array, rotation_deg: Array) -> list[ArmLink]:
    """Links of a chain, in order.

    Args:
        path: The URDF.
        position, rotation_deg: Placement of its first link on the base (3,) each [m], [deg].
    """
    robot = ElementTree.parse(path).getroot()
    bodies = {str(one.get("name")): one for one in robot.findall("link")}
    joints = {str(one.find("parent").get("link")): one for one in robot.findall("joint")}  # type: ignore[union-attr]
    children = {str(one.find("child").get("link")) for one in joints.values()}  # type: ignore[union-attr]
    (name,) = set(bodies) - children
    rotation, origin = Rotation.from_euler("xyz", rotation_deg, degrees=True).as_matrix(), position
    axis, limit, chain = np.zeros(3), None, list[ArmLink]()
    while True:
        inertial, cylinders = bodies[name].find("inertial"), []
        for shape in bodies[name].findall("collision"):
            cylinder, placement = shape.find("geometry/cylinder"), np.eye(4)
            assert cylinder is not None
            placement[:3, :3], placement[:3, 3] = (
                turned(shape.find("origin")),
                numbers(shape.find("origin"), "xyz"),
            )
            cylinders.append((placement, float(cylinder.get("radius", 0)), float(cylinder.get("length", 0))))
        mass, com, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
        if inertial is not None:
            mass = float(inertial.find("mass").get("value"))  # type: ignore[union-attr, arg-type]
            com = numbers(inertial.find("origin"), "xyz")
            values = inertial.find("inertia")
            assert values is not None
            for i, j, key in (
                (0, 0, "ixx"),
                (0, 1, "ixy"),
                (0, 2, "ixz"),
                (1, 1, "iyy"),
                (1, 2, "iyz"),
                (2, 2, "izz"),
            ):
                inertia[i, j] = inertia[j, i] = float(values.get(key, 0))
        ends = [
            float(limit.get(key, 0)) if limit is not None else np.inf
            for key in ("lower", "upper", "velocity", "effort")
        ]
        chain.append(ArmLink(rotation, origin, axis, mass, com, inertia, *ends, tuple(cylinders)))
        if name not in joints:
            return chain
        joint = joints[name]
        rotation, origin = turned(joint.find("origin")), numbers(joint.find("origin"), "xyz")
        axis, limit = numbers(joint.find("axis"), "xyz"), joint.find("limit")
        name = str(joint.find("child").get("link"))  # type: ignore[union-attr]


@dataclass(frozen=True, eq=False)
class Chain:
    """A base with an arm.

    Attributes:
        mass, inertia: Of the base, about its origin, which is its centre of mass.
        links: The arm.
    """

    mass: float
    inertia: Array
    links: list[ArmLink]

    @property
    def moving(self) -> list[ArmLink]:
        """Links behind a moving joint, in order."""
        return [link for link in self.links if link.turns]

    @functools.cached_property
    def masses(self) -> Array:
        """Masses (bodies,) of the base and of the links that have one [kg]."""
        return np.array([self.mass, *(link.mass for link in self.links if link.mass)])

    @functools.cached_property
    def mobility(self) -> Array:
        """Whether a joint moves a body (bodies, n): 1 or 0."""
        joints = np.cumsum([link.turns for link in self.links])
        before = [0, *(count for count, link in zip(joints, self.links, strict=True) if link.mass)]
        return np.array([np.arange(len(self.moving)) < count for count in before], dtype=float)

    def placements(self, angles: Array) -> list[tuple[Array, Array]]:
        """Rotation (3, 3) and origin (3,) of each link in the base's axes."""
        rotation, origin, placed, k = np.eye(3), np.zeros(3), [], 0
        for link in self.links:
            origin, rotation = origin + rotation @ link.origin, rotation @ link.rotation
            if link.turns:
                one, two = link.crosses
                rotation = rotation @ (np.eye(3) + np.sin(angles[k]) * one + (1 - np.cos(angles[k])) * two)
                k += 1
            placed.append((rotation, origin))
        return placed

    def motion(self, angles: Array, rates: Array, spin: Array, speed: Array) -> ChainMotion:
        """Motion of all bodies at a state.

        Args:
            angles, rates: Of the joints (n,) each [rad], [rad/s].
            spin, speed: Of the base (3,) each, its own axes [rad/s], [m/s].
        """
        count, placed = len(angles), list(zip(self.links, self.placements(angles), strict=True))
        axes = np.array([r @ link.axis for link, (r, _) in placed if link.turns])
        origins = np.array([o for link, (_, o) in placed if link.turns])
        heavy = [(link, r, o) for link, (r, o) in placed if link.mass]
        centres = np.array([np.zeros(3), *(o + r @ link.com for link, r, o in heavy)])
        inertias = np.array([self.inertia, *(r @ link.inertia @ r.T for link, r, _ in heavy)])
        # relative to the base: spin before each joint, rate of its axis, velocities of origin and centres
        turned = axes * rates[:, None]
        turns = cross(np.cumsum(turned, axis=0) - turned, axes)
        earlier = np.tril(np.ones((count, count)), -1)
        moves = np.einsum("jk,jkx->jx", earlier, cross(turned[None], origins[:, None] - origins[None]))
        arms = centres[:, None] - origins[None]
        linear, angular = np.zeros((2, len(centres), 3, 6 + count))
        linear[:, :, :3] = angular[:, :, 3:6] = np.eye(3)
        linear[:, :, 3:6] = cross(np.eye(3)[None], centres[:, None]).transpose(0, 2, 1)
        linear[:, :, 6:] = (self.mobility[..., None] * cross(axes[None], arms)).transpose(0, 2, 1)
        angular[:, :, 6:] = (self.mobility[..., None] * axes[None]).transpose(0, 2, 1)
        velocities, relative = linear[:, :, 6:] @ rates, angular[:, :, 6:] @ rates
        curved = cross(turns[None], arms) + cross(axes[None], velocities[:, None] - moves[None])
        accelerations = cross(spin, speed) + cross(spin, cross(spin, centres)) + 2 * cross(spin, velocities)
        accelerations = accelerations + np.einsum("bk,bkx,k->bx", self.mobility, curved, rates)
        turnings = cross(spin, relative) + np.einsum("bk,kx,k->bx", self.mobility, turns, rates)
        spins = spin + relative
        return ChainMotion(linear, angular, centres, inertias, spins, accelerations, turnings)

    def equations(self, motion: ChainMotion) -> tuple[Array, Array]:
        """Matrix M and bias b of M s' + b = loads, for the generalized speeds s = (speed, spin, rates).

        Args:
            motion: Motion of all bodies.
        """
        momenta = np.einsum("bij,bjk->bik", motion.inertias, motion.angular)
        matrix = np.einsum("b,bik,bil->kl", self.masses, motion.linear, motion.linear)
        matrix += np.einsum("bik,bil->kl", motion.angular, momenta)
        torques = np.einsum("bij,bj->bi", motion.inertias, motion.turnings)
        torques += cross(motion.spins, np.einsum("bij,bj->bi", motion.inertias, motion.spins))
        return matrix, self.loads(motion, motion.accelerations, torques)

    def loads(self, motion: ChainMotion, accelerations: Array, torques: Array) -> Array:
        """Generalized forces (6 + n,) of accelerations and torques on the bodies (bodies, 3) each."""
        forces = self.masses[:, None] * accelerations
        return np.asarray(
            np.einsum("bik,bi->k", motion.linear, forces) + np.einsum("bik,bi->k", motion.angular, torques)
        )


@dataclass(frozen=True)
class ChainMotion:
    """Motion of the bodies of a chain in the base's axes, the base first.

    Attributes:
        linear, angular: Velocity and spin by generalized speed (bodies, 3, 6 + n) each.
        centres, inertias: Centres of mass (bodies, 3) [m], and inertias about them (bodies, 3, 3) [kg m^2].
        spins: Of the bodies (bodies, 3) [rad/s].
        accelerations, turnings: Of the bodies where the generalized speeds are constant (bodies, 3) each
            [m/s^2], [rad/s^2].
    """

    linear: Array
    angular: Array
    centres: Array
    inertias: Array
    spins: Array
    accelerations: Array
    turnings: Array


def skew(vector: Array) -> Array:
    """Matrix (3, 3) of the cross product with a vector (3,)."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def rotation_of(quaternion: Array) -> Array:
    """Rotation (3, 3) of a quaternion x, y, z, w, which need not have the length one."""
    q = quaternion / np.sqrt(quaternion @ quaternion)
    one = skew(q[:3])
    return np.eye(3) + 2 * (q[3] * one + one @ one)


def cross(one: Array, other: Array) -> Array:
    """Cross products (..., 3), faster than numpy's own for few vectors."""
    x, y, z = one[..., 0], one[..., 1], one[..., 2]
    u, v, w = other[..., 0], other[..., 1], other[..., 2]
    first = y * w - z * v
    product = np.empty((*first.shape, 3))
    product[..., 0], product[..., 1], product[..., 2] = first, z * u - x * w, x * v - y * u
    return product


@dataclass(frozen=True)
class Servo:
    """Torques of the joints: those of the plan, and feedback to its positions and rates.

    Attributes:
        torque, position, rate: Of the plan at a time [s], (n,) each.
        kp, kd: Gains (n,) [N m/rad], [N m s/rad].
        limits: Largest torques (n,) [N m].
    """

    torque: Callable[[float], Array]
    position: Callable[[float], Array]
    rate: Callable[[float], Array]
    kp: Array
    kd: Array
    limits: Array

    def __call__(self, time: float, angles: Array, rates: Array) -> Array:
        """Torques (n,) [N m]."""
        feedback = self.kp * (self.position(time) - angles) + self.kd * (self.rate(time) - rates)
        return np.clip(self.torque(time) + feedback, -self.limits, self.limits)


@dataclass(frozen=True)
class CircularOrbit:
    """A circular reference orbit.

    Attributes:
        mu, radius: Gravitational parameter [m^3/s^2] and radius [m].
    """

    mu: float
    radius: float

    @property
    def rate(self) -> float:
        """Mean motion [rad/s]."""
        return float(np.sqrt(self.mu / self.radius**3))

    def pull(self, time: float, places: Array) -> tuple[Array, Array]:
        """Gravity relative to that at the reference (n, 3) [m/s^2], and unit vectors up (n, 3).

        Args:
            time: Time [s]; at zero the reference is on the x axis.
            places: Positions (n, 3) relative to the reference, in axes that do not rotate [m].
        """
        angle = self.rate * time
        reference = self.radius * np.array([np.cos(angle), np.sin(angle), 0.0])
        away = reference + places
        distances = np.linalg.norm(away, axis=1, keepdims=True)
        return -self.mu * away / distances**3 + self.rate**2 * reference, away / distances


def arm_flown(
    chain: Chain,
    orbit: CircularOrbit,
    start: Array,
    wrench: Callable[[float], Array],
    servo: Servo,
    knots: Array,
) -> tuple[Array, Array]:
    """Times (m,) and states (m, 13 + 2 n) of a flight, every :data:`STEP`.

    A state is the position relative to the reference and the attitude x, y, z, w, in axes that do not rotate,
    velocity and spin in the base's axes, and the joints' angles and rates.

    Args:
        chain, orbit: The chaser, and its reference orbit.
        start: First state.
        wrench: Force and torque (6,) on the base at a time [s], its own axes.
        servo: Torques of the joints.
        knots: Times at which the wrench jumps, first and last among them [s].
    """
    count = len(chain.moving)

    def rates(time: float, x: Array) -> Array:
        """Derivative of a state."""
        q, speed, spin = x[3:7], x[7:10], x[10:13]
        angles, joint_rates = x[13 : 13 + count], x[13 + count :]
        rotation = rotation_of(q)
        motion = chain.motion(angles, joint_rates, spin, speed)
        matrix, bias = chain.equations(motion)
        pulls, ups = (each @ rotation for each in orbit.pull(time, x[:3] + motion.centres @ rotation.T))
        gradient = 3 * orbit.rate**2 * cross(ups, np.einsum("bij,bj->bi", motion.inertias, ups))
        force = np.concatenate([wrench(time), servo(time, angles, joint_rates)]) - bias
        force += chain.loads(motion, pulls, gradient)
        change = np.linalg.solve(matrix, force)
        attitude = 0.5 * np.concatenate([q[3] * spin + cross(q[:3], spin), [-q[:3] @ spin]])
        return np.concatenate([rotation @ speed, attitude, change[:6], joint_rates, change[6:]])

    x, times, states = start, [0.0], [start]
    for begin, end in itertools.pairwise(knots):
        inside = np.linspace(begin, end, max(2, int(np.ceil((end - begin) / STEP)) + 1))
        solved = solve_ivp(rates, (begin, end), x, "DOP853", inside, rtol=1e-7, atol=1e-9)
        x = solved.y[:, -1]
        times += inside[1:].tolist()
        states += list(solved.y.T[1:])
    return np.array(times), np.array(states)


def tip_motion(chain: Chain, state: Array) -> tuple[Array, Array, Array, Array]:
    """Position, x axis and velocity (3,) each of the last link, and its velocity if the joints were at rest.

    Args:
        chain: The chaser.
        state: A state of a flight; the results are in axes that do not rotate, too.
    """
    count = len(chain.moving)
    rotation, spin = Rotation.from_quat(state[3:7]).as_matrix(), state[10:13]
    placed = chain.placements(state[13 : 13 + count])
    tip, held = placed[-1][1], state[7:10] + cross(spin, placed[-1][1])
    joints = [place for link, place in zip(chain.links, placed, strict=True) if link.turns]
    axes = np.array([r @ link.axis for link, (r, _) in zip(chain.moving, joints, strict=True)])
    moved = cross(axes, tip - np.array([origin for _, origin in joints])).T @ state[13 + count :]
    return (
        state[:3] + rotation @ tip,
        rotation @ placed[-1][0][:, 0],
        rotation @ (held + moved),
        rotation @ held,
    )


def arm_rotation(chain: Chain, times: Array, states: Array) -> float:
    """Largest angle by which the joints' motion alone turns a base that floats freely [rad].

    Without external forces and momentum, M_b s_b + M_m rates = 0 gives the base's spin.
    """
    count, turned, largest = len(chain.moving), Rotation.identity(), 0.0
    none = np.zeros(3)
    for step, state in zip(np.diff(times), states, strict=False):
        matrix, _ = chain.equations(chain.motion(state[13 : 13 + count], np.zeros(count), none, none))
        speeds = -np.linalg.solve(matrix[:6, :6], matrix[:6, 6:] @ state[13 + count :])
        turned = turned * Rotation.from_rotvec(step * speeds[3:])
        largest = max(largest, turned.magnitude())
    return float(largest)


def arm_distances(
    chain: Chain, states: Array, attitudes: tuple[Rotation, Rotation], hulls: list[Any], near: Array
) -> dict[str, float]:
    """Least distances, negated [m], of the arm's shapes from the hulls of chaser and target.

    Args:
        chain: The chaser.
        states: States of a flight.
        attitudes: Of chaser and target, in axes that do not rotate.
        hulls: Of chaser and target, coal's shapes.
        near: Whether the target is near at a state (n,).
    """
    import coal

    shapes = [coal.Cylinder(radius, length) for link in chain.links for _, radius, length in link.cylinders]
    none, least = coal.Transform3s.Identity(), [np.inf, np.inf]
    for k, state in enumerate(states):
        placed, places = chain.placements(state[13 : 13 + len(chain.moving)]), []
        for link, (rotation, origin) in zip(chain.links, placed, strict=True):
            places += [(rotation @ at[:3, :3], origin + rotation @ at[:3, 3]) for at, _, _ in link.cylinders]
        relative = (attitudes[1][k].inv() * attitudes[0][k]).as_matrix()
        away = attitudes[1][k].inv().apply(state[:3])
        for shape, (rotation, origin) in zip(shapes, places, strict=True):
            for side, at in enumerate(((rotation, origin), (relative @ rotation, away + relative @ origin))):
                if side and not near[k]:
                    continue
                result = coal.DistanceResult()
                coal.distance(shape, coal.Transform3s(*at), hulls[side], none, coal.DistanceRequest(), result)
                least[side] = min(least[side], result.min_distance)
    return {"arm to chaser": -least[0], "arm to target": -least[1]}
