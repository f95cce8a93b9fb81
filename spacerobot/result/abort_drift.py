"""Passive safety: the minimum distance of a servicer and its target after an abort of the approach.

After an abort, all actuators are off and brakes hold the joints, so that each body drifts as one rigid body.
Its centre of mass moves straight, or by the Clohessy-Wiltshire equations about a circular orbit. Its angular
velocity w follows, in body axes, with the inertia I about the centre of mass and the wheels' momentum h,

    I w' = -w x (I w + h).

The brakes' torques are internal, so that linear and angular momentum at the abort determine velocity and
angular velocity. Gravity-gradient torques are neglected. The distance d of two bodies is that of the nearest
pair of their collision shapes (coal); pairs whose bounding spheres are further apart are not compared. The
rate of d is bounded by

    L = |v_1 - v_2| + |w_1| r_1 + |w_2| r_2,

where r are the radii of spheres about the centres of mass. The rotation conserves w . I w, so that |w|^2 is
at most w . I w divided by the smallest principal moment of inertia. Between two instants, therefore,
d(t) >= (d_i + d_i+1 - L (t_i+1 - t_i)) / 2. A search that evaluates d where this bound is smallest (Piyavskii
1972; Shubert 1972) finds the minimum to a tolerance.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.common.tables import Table
from spacerobot.common.tabular import Tabular
from spacerobot.result import Result
from spacerobot.scene import Scene, SceneBody
from spacerobot.scene.overlaps import Solid, solids

TURN = 0.05
"""Maximum rotation in a step of the attitude integration [rad]."""

MAX_STATES = 20_000_000
"""Maximum number of integrated attitudes of a body, for all aborts together; they take 1.1 GB."""

MAX_DRIFT_S = 1e8
"""Maximum duration of a drift [s], three years."""


@dataclass(frozen=True)
class PassiveSafety(Tabular):
    """Minimum distances after aborts.

    Attributes:
        time_s: Times of abort (n,) [s].
        distance_m: Minimum distance during the drift after each abort (n,) [m]; 0 or negative if bodies
            collide.
        drift_s: Time from the abort to the minimum (n,) [s].
        pairs: Names of the nearest links at the minimum (n,).
        duration_s: Duration of the drifts [s].
    """

    time_s: Array
    distance_m: Array
    drift_s: Array
    pairs: tuple[tuple[str, str], ...]
    duration_s: float

    def __repr__(self) -> str:
        """Number of aborts and minimum distance, in one line."""
        distance = self.distance_m[self.worst]
        return f"<PassiveSafety of {len(self.time_s)} aborts: minimum distance {distance:.4g} m>"

    def content(self) -> list[Table]:
        """Table with the minimum distance of all aborts."""
        return [Table.of_pairs("passive safety", self.rows())]

    def rows(self, clearance_m: float | None = None) -> list[tuple[str, str]]:
        """Names and values: minimum distance of all aborts, and aborts that violate a clearance [m]."""
        k, time = self.worst, self.time_s
        contact = "" if self.distance_m[k] > 0 else ": they collide"
        rows = [
            ("aborts", f"{len(time)}, from {time[0]:g} s to {time[-1]:g} s"),
            ("drift after each", f"{self.duration_s:g} s"),
            (
                "minimum distance",
                f"{self.distance_m[k]:.4g} m, between {' and '.join(self.pairs[k])}{contact}",
            ),
            ("worst abort", f"at {time[k]:g} s; the minimum is {self.drift_s[k]:.4g} s later"),
        ]
        if clearance_m is not None:
            unsafe = self.unsafe(clearance_m)
            words = f"after {len(unsafe)} aborts, the first at {unsafe[0]:g} s" if len(unsafe) else "never"
            rows.append((f"nearer than {clearance_m:g} m", words))
        return rows

    @property
    def worst(self) -> int:
        """Index of the abort with the smallest minimum distance."""
        return int(np.argmin(self.distance_m))

    def unsafe(self, clearance_m: float) -> Array:
        """Times of the aborts (m,) [s] after which the distance falls below a clearance [m].

        Raises:
            SpaceRobotError: If the clearance is negative or not finite.
        """
        if not 0 <= clearance_m < np.inf:
            raise SpaceRobotError(f"clearance: found {clearance_m:g} m, allowed: 0 or more, finite")
        return self.time_s[self.distance_m < clearance_m]


def passive_safety(
    result: Result,
    *,
    duration_s: float,
    until_s: float | None = None,
    tolerance_m: float | None = None,
    progress: Callable[[str], object] | None = None,
) -> PassiveSafety:
    """Compute the minimum distance of robots and target in free drift after an abort at each sample.

    Args:
        result: Result of a simulated approach.
        duration_s: Duration of the drift [s].
        until_s: Latest time of abort [s]; that of the first capture, or the end of the simulation, if None.
        tolerance_m: Tolerance of the distances [m]; 1 % of each, but at least 1 mm, if None.
        progress: Callback with a short text.

    Returns:
        PassiveSafety: Minimum distance after each abort, over all robots.

    Raises:
        ScenarioError: If there is no target, a body has no collision shape, an environment has no closed-form
            drift, or a drift takes too many steps.
        SpaceRobotError: If a duration or tolerance is out of range, or no sample is at or before ``until_s``.
    """
    tell = progress or (lambda _: None)
    if not 0 < duration_s <= MAX_DRIFT_S:
        message = f"drift: found {duration_s:g} s, allowed: above 0, at most {MAX_DRIFT_S:g} s"
        raise SpaceRobotError(message)
    if tolerance_m is not None and not 0 < tolerance_m < np.inf:
        raise SpaceRobotError(f"tolerance: found {tolerance_m:g} m, allowed: above 0, finite")
    scene, time = result.scene(), result.array("time")
    if until_s is None:
        captures = [event["time_s"] for event in result.summary["events"] if event["kind"] == "captured"]
        until_s = min(captures, default=float(time[-1]))
    chosen = np.flatnonzero(time <= until_s)
    if not len(chosen):
        raise SpaceRobotError(
            f"until: found {until_s:g} s, allowed: from {time[0]:g} s, the first sample, on"
        )
    # mean motion of a circular orbit [rad/s]; 0 without one
    rate = 0.0
    for name, environment in scene.scenario.environment.items():
        motion = environment.mean_motion()
        if motion is None:
            raise ScenarioError(
                "bodies drift in it by no closed form; allowed for passive safety: circular orbits",
                source=scene.source,
                where=f"environment.{name}",
            )
        rate = motion
    if scene.target is None:
        raise ScenarioError(
            "there is none, and nothing to stay clear of", source=scene.source, where="target"
        )
    drifts = dict[str, _RigidDrift]()
    for body in scene.bodies:
        tell(f"attitudes of {body.name}")
        drifts[body.name] = _RigidDrift.of(scene, body, result, chosen, (rate, duration_s))
    target = drifts.pop(scene.target.name)
    closest = []
    for k in range(len(chosen)):
        tell(f"distances after aborts: {k / len(chosen):.0%}")
        closest.append(min(_least(robot, target, k, tolerance_m) for robot in drifts.values()))
    distances, drifted, pairs = zip(*closest, strict=True)
    return PassiveSafety(time[chosen], np.array(distances), np.array(drifted), tuple(pairs), duration_s)


@dataclass(frozen=True)
class _RigidDrift:
    """Drift of a body as one rigid body after each of n aborts.

    Body axes are parallel to the world axes at the abort.

    Attributes:
        solids: Collision shapes of the body.
        placements: Placements of the shapes' joints at each abort, relative to the centre of mass, world
            axes.
        radius, spin: Maximum distance of the shapes from the centre of mass (n,) [m], and upper bound of the
            angular velocity (n,) [rad/s].
        centre: Function of abort and drift time [s] for the centre of mass (3,) [m].
        terms: Components (n,) of the inertia about the centre of mass, of its inverse and of the wheels'
            momentum, body axes.
        step, attitudes: Time step [s], and quaternions and angular velocities at the steps (m, 7, n).
        duration: Duration of the drift [s].
    """

    solids: tuple[Solid, ...]
    placements: tuple[dict[int, pin.SE3], ...]
    radius: Array
    spin: Array
    centre: Callable[[int, float], Array]
    terms: tuple[Numbers, Numbers, Numbers]
    step: float
    attitudes: Array
    duration: float

    @classmethod
    def of(
        cls,
        scene: Scene,
        body: SceneBody,
        result: Result,
        chosen: npt.NDArray[np.intp],
        drift: tuple[float, float],
    ) -> _RigidDrift:
        """Drift of a body from the samples of a result.

        Args:
            scene, body, result: Scene, body and result.
            chosen: Indices of the samples (n,).
            drift: Mean motion of the orbit [rad/s] and duration [s].
        """
        shapes = tuple(solids(scene, body))
        if not shapes:
            message = "has no collision shape, so its distance is not known"
            raise ScenarioError(message, source=scene.source, where=body.path)
        mean_motion, duration = drift
        model, data = scene.model, scene.model.createData()
        joints = [joint for joint in body.subtree if joint]
        wheels = np.zeros((len(chosen), 3))
        if "wheel_momentum" in result.data:
            stored_momentum = result.data.wheel_momentum.sel(body=body.name).values[chosen]
            wheels = np.nan_to_num(stored_momentum)
        rows, placements, radius = [], [], []
        for k, (q, v) in enumerate(zip(result.array("q")[chosen], result.array("v")[chosen], strict=True)):
            pin.forwardKinematics(model, data, q, v)
            inertias = [data.oMi[joint].act(model.inertias[joint]) for joint in joints]
            momenta = [data.oMi[j].act(model.inertias[j] * data.v[j]) for j in joints]
            composite_inertia = sum(inertias[1:], inertias[0]) if joints else pin.Inertia.Identity()
            linear = sum((one.linear for one in momenta), np.zeros(3))
            about = sum((one.angular for one in momenta), np.zeros(3)) - np.cross(
                composite_inertia.lever, linear
            )
            spin = np.linalg.solve(composite_inertia.inertia, about)
            rows.append(
                (composite_inertia.lever, linear / composite_inertia.mass, spin, composite_inertia.inertia)
            )
            used = {solid.joint for solid in shapes}
            shift = pin.SE3(np.eye(3), -composite_inertia.lever)
            placements.append({joint: shift * data.oMi[joint] for joint in used})
            places = placements[k]
            radius.append(max(np.linalg.norm(places[s.joint].act(s.centre)) + s.radius for s in shapes))
        place, velocity, spin, inertia = (np.array(part) for part in zip(*rows, strict=True))
        kinetic_energy_twice = np.einsum("ni,nij,nj->n", spin, inertia, spin)
        bound = np.sqrt(kinetic_energy_twice / np.linalg.eigvalsh(inertia)[:, 0])
        steps = duration * bound.max() / TURN
        if steps * len(chosen) > MAX_STATES:
            longest = 0.9 * duration * MAX_STATES / (steps * len(chosen))
            raise ScenarioError(
                f"a drift of {duration:g} s after {len(chosen)} aborts takes {steps * len(chosen):.3g} "
                f"attitudes, allowed: {MAX_STATES:g}; drift for {longest:.3g} s or less",
                source=scene.source,
                where=body.path,
            )
        count = int(np.ceil(steps)) + 1
        terms = _rotation_terms(inertia, wheels)
        attitudes = np.empty((count + 1, 7, len(spin)))
        attitudes[0] = np.concatenate([np.tile([0.0, 0, 0, 1], (len(spin), 1)), spin], axis=1).T
        for i in range(count):
            attitudes[i + 1] = _advanced(list(attitudes[i]), terms, duration / count)
        begins = result.array("time")[chosen]

        def centre(k: int, t: float) -> Array:
            return drifted_centre(place[k], velocity[k], begins[k], t, mean_motion)

        return cls(
            shapes,
            tuple(placements),
            np.array(radius),
            bound,
            centre,
            terms,
            duration / count,
            attitudes,
            duration,
        )

    def placed(self, k: int, t: float) -> dict[int, pin.SE3]:
        """Placements of joints at a time [s] after abort k, world axes."""
        i = min(int(t / self.step), len(self.attitudes) - 1)
        inertia, inverse, wheels = ([float(part[k]) for part in parts] for parts in self.terms)
        now = _advanced(self.attitudes[i, :, k].tolist(), (inertia, inverse, wheels), t - i * self.step)
        turn = pin.SE3(pin.Quaternion(np.array(now[:4])).normalized().matrix(), self.centre(k, t))
        return {joint: turn * place for joint, place in self.placements[k].items()}


def advance_attitudes(state: Array, inertia: Array, wheels: Array, step: float) -> Array:
    """Integrate attitudes of free rigid bodies over one RK4 step.

    Args:
        state: Quaternions (x, y, z, w) and angular velocities, body axes (n, 7) [1, rad/s].
        inertia, wheels: Inertias about the centres of mass (n, 3, 3) [kg m^2] and momenta of wheels (n, 3)
            [N m s], body axes.
        step: Time step [s].

    Returns:
        numpy.ndarray: States after the step (n, 7).
    """
    return np.stack(_advanced(list(state.T), _rotation_terms(inertia, wheels), step), axis=-1)


Numbers = Sequence[Any]
"""Components, each a number or an array over bodies, so that the same formulas integrate one body or many."""


def _rotation_terms(inertia: Array, wheels: Array) -> tuple[Numbers, Numbers, Numbers]:
    """Components of inertias (9, row by row), of their inverses (9), and of the wheels' momenta (3)."""
    inverse = np.linalg.inv(inertia)
    return (
        list(inertia.reshape(-1, 9).T),
        list(inverse.reshape(-1, 9).T),
        list(wheels.reshape(-1, 3).T),
    )


def _rotation_rate(state: Numbers, terms: tuple[Numbers, Numbers, Numbers]) -> Numbers:
    """Rates of quaternion and angular velocity: q' = q (w, 0) / 2, w' = -I^-1 (w x (I w + h))."""
    (a, b, c, d, e, f, g, h, i), (p, q, r, s, t, u, v, y, z), (h1, h2, h3) = terms
    q1, q2, q3, q4, w1, w2, w3 = state
    m1 = a * w1 + b * w2 + c * w3 + h1
    m2 = d * w1 + e * w2 + f * w3 + h2
    m3 = g * w1 + h * w2 + i * w3 + h3
    n1, n2, n3 = m2 * w3 - m3 * w2, m3 * w1 - m1 * w3, m1 * w2 - m2 * w1
    return (
        (q4 * w1 + q2 * w3 - q3 * w2) / 2,
        (q4 * w2 + q3 * w1 - q1 * w3) / 2,
        (q4 * w3 + q1 * w2 - q2 * w1) / 2,
        -(q1 * w1 + q2 * w2 + q3 * w3) / 2,
        p * n1 + q * n2 + r * n3,
        s * n1 + t * n2 + u * n3,
        v * n1 + y * n2 + z * n3,
    )


def _advanced(state: Numbers, terms: tuple[Numbers, Numbers, Numbers], step: float) -> Numbers:
    """Quaternion and angular velocity (7) after one RK4 step."""
    half, sixth = step / 2, step / 6
    first = _rotation_rate(state, terms)
    second = _rotation_rate([x + half * k for x, k in zip(state, first, strict=True)], terms)
    third = _rotation_rate([x + half * k for x, k in zip(state, second, strict=True)], terms)
    fourth = _rotation_rate([x + step * k for x, k in zip(state, third, strict=True)], terms)
    slopes = zip(state, first, second, third, fourth, strict=True)
    return [x + sixth * (k1 + 2 * k2 + 2 * k3 + k4) for x, k1, k2, k3, k4 in slopes]


def drifted_centre(place: Array, velocity: Array, begin: float, t: float, rate: float) -> Array:
    """Centre of mass (3,) [m] after a drift, straight or by the Clohessy-Wiltshire equations.

    Args:
        place, velocity: Initial position and velocity (3,) [m, m/s], world axes, of which x is radial and y
            along-track at time 0.
        begin, t: Time at the beginning of the drift, and time since then [s].
        rate: Mean motion of the orbit [rad/s]; 0 without an orbit.
    """
    if not rate:
        return place + t * velocity

    def hill(time: float) -> Array:
        cos, sin = np.cos(rate * time), np.sin(rate * time)
        return np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])

    (x, y, z), first = hill(begin) @ place, hill(begin)
    u, v, w = first @ velocity - rate * np.array([-y, x, 0])
    cos, sin, angle = np.cos(rate * t), np.sin(rate * t), rate * t
    later = (
        (4 - 3 * cos) * x + (sin * u + 2 * (1 - cos) * v) / rate,
        6 * (sin - angle) * x + y + (-2 * (1 - cos) * u + (4 * sin - 3 * angle) * v) / rate,
        cos * z + sin / rate * w,
    )
    centre: Array = hill(begin + t).T @ np.array(later)
    return centre


def _least(
    robot: _RigidDrift, target: _RigidDrift, k: int, tolerance: float | None
) -> tuple[float, float, tuple[str, str]]:
    """Minimum distance [m] after abort k, drift time of the minimum [s], and names of the nearest links."""
    duration = robot.duration
    grid = np.linspace(0, duration, 65)
    between = np.array([robot.centre(k, t) - target.centre(k, t) for t in grid])
    jumps = np.linalg.norm(np.diff(between, axis=0), axis=1)
    # speed bound from chords, which are shorter than the curved path; second differences bound the deficit
    bends = np.abs(np.diff(between, 2, axis=0)).sum(axis=1).max()
    speed = (jumps.max() + bends) / grid[1]
    slope = speed + robot.spin[k] * robot.radius[k] + target.spin[k] * target.radius[k]

    def sampled(t: float) -> tuple[float, float, tuple[str, str]]:
        """Distance of the nearest shapes [m] at a time, the time [s], and the names of their links."""
        robots = robot.placed(k, t)
        targets = target.placed(k, t)
        ones = [(one, robots[one.joint]) for one in robot.solids]
        others = [(other, targets[other.joint]) for other in target.solids]
        near = sorted(
            (float(np.linalg.norm(p.act(a.centre) - r.act(b.centre))) - a.radius - b.radius, i, j)
            for i, (a, p) in enumerate(ones)
            for j, (b, r) in enumerate(others)
        )
        distance, pair = np.inf, ("", "")
        for bound, i, j in near:
            if bound > distance:
                break
            apart = coal.DistanceResult()
            placed = [solid.placement for solid, _ in (ones[i], others[j])]
            at = [
                joint * placement for (_, joint), placement in zip((ones[i], others[j]), placed, strict=True)
            ]
            forms = [coal.Transform3s(place.rotation, place.translation) for place in at]
            shapes = ones[i][0].geometry, others[j][0].geometry
            coal.distance(shapes[0], forms[0], shapes[1], forms[1], coal.DistanceRequest(), apart)
            if apart.min_distance < distance:
                distance, pair = float(apart.min_distance), (ones[i][0].link, others[j][0].link)
        return distance, t, pair

    first, last = sampled(0.0), sampled(duration)
    best = min(first, last)
    # Piyavskii-Shubert: between two samples, d >= (d_1 + d_2 - L (t_2 - t_1)) / 2, reached where the lines of
    # slope -L and +L through them meet; a heap of intervals, the lowest bound first
    open_ = [((first[0] + last[0] - slope * duration) / 2, first, last)]
    while open_ and best[0] > 0:
        bound, left, right = heapq.heappop(open_)
        if bound > best[0] - (max(1e-3, 0.01 * best[0]) if tolerance is None else tolerance):
            break
        at = (left[1] + right[1]) / 2 + (left[0] - right[0]) / (2 * slope)
        middle = sampled(at)
        best = min(best, middle)
        for one, other in ((left, middle), (middle, right)):
            heapq.heappush(open_, ((one[0] + other[0] - slope * (other[1] - one[1])) / 2, one, other))
    return best
