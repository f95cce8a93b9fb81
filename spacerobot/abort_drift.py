"""Passive safety: the least distance of a servicer and its target if an approach is aborted at any instant.

After an abort all actuators are off and brakes hold the joints, so that each body drifts as one rigid body:
its centre of mass moves straight, or by the equations of Clohessy and Wiltshire about a circular orbit, and
with the inertia I about it, the spin w and the momentum h of its wheels, in its own axes,

    I w' = -w x (I w + h).

Brakes are internal, so linear and angular momentum at the abort give velocity and spin. Torques of a gravity
gradient are left out. The distance d of two bodies is that of the nearest pair of their collision shapes
(coal); pairs whose bounding spheres are further apart are not compared. Its rate is at most

    L = |v_1 - v_2| + |w_1| r_1 + |w_2| r_2,

where r are the radii of spheres about the centres of mass, and |w|^2 <= w . I w / (least moment of inertia),
which is kept. So d(t) >= (d_i + d_i+1 - L (t_i+1 - t_i)) / 2 between two instants, and the search that
evaluates d where this bound is least (Piyavskii 1972; Shubert 1972) finds the minimum to a tolerance.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacerobot.arrays import Array
from spacerobot.errors import ScenarioError
from spacerobot.result import Result
from spacerobot.scene import Scene, SceneBody
from spacerobot.scene.overlaps import Solid, solids

TURN = 0.05
"""Greatest rotation [rad] in a step of the integration of attitudes."""


@dataclass(frozen=True)
class PassiveSafety:
    """Least distances after aborts.

    Attributes
    ----------
    time_s
        Instants of abort (n,) [s].
    distance_m
        Least distance during the drift after each (n,) [m], at most 0 where bodies collide.
    drift_s
        Time since the abort at which it is reached (n,) [s].
    pairs
        Links that are nearest then (n,).
    duration_s
        Length of the drifts [s].
    """

    time_s: Array
    distance_m: Array
    drift_s: Array
    pairs: tuple[tuple[str, str], ...]
    duration_s: float

    @property
    def worst(self) -> int:
        """Place of the abort with the least distance."""
        return int(np.argmin(self.distance_m))

    def unsafe(self, clearance_m: float) -> Array:
        """Instants of abort (m,) [s] after which bodies come nearer than a clearance [m]."""
        return self.time_s[self.distance_m < clearance_m]


def passive_safety(
    result: Result, *, duration_s: float, until_s: float | None = None, tolerance_m: float | None = None
) -> PassiveSafety:
    """Least distance of each robot to the target in free drift after an abort at each sample of a result.

    Parameters
    ----------
    result
        A simulated approach.
    duration_s
        Length of the drift [s].
    until_s
        Last instant of abort [s]; that of the first capture, else the end, if None.
    tolerance_m
        Tolerance of the distances [m]; 1 % of each, at least 1 mm, if None.

    Raises
    ------
    ScenarioError
        If there is no target, a body has no collision shape, or an environment no known drift.
    """
    scene, time = result.scene(), result.array("time")
    if until_s is None:
        captures = [event["time_s"] for event in result.summary["events"] if event["kind"] == "captured"]
        until_s = min(captures, default=float(time[-1]))
    chosen = np.flatnonzero(time <= until_s)
    # mean motion of a circular orbit [rad/s]; 0 without one
    rate = 0.0
    for name, environment in scene.scenario.environment.items():
        own = environment.mean_motion()
        if own is None:
            raise ScenarioError(
                "bodies drift in it by no closed form; allowed for passive safety: circular orbits",
                source=scene.source,
                where=f"environment.{name}",
            )
        rate = own
    if scene.target is None:
        raise ScenarioError(
            "there is none, and nothing to stay clear of", source=scene.source, where="target"
        )
    drifts = {
        body.name: _RigidDrift.of(scene, body, result, chosen, (rate, duration_s)) for body in scene.bodies
    }
    target = drifts.pop(scene.target.name)
    found = [
        min(_least(robot, target, k, tolerance_m) for robot in drifts.values()) for k in range(len(chosen))
    ]
    distances, drifted, pairs = zip(*found, strict=True)
    return PassiveSafety(time[chosen], np.array(distances), np.array(drifted), tuple(pairs), duration_s)


@dataclass(frozen=True)
class _RigidDrift:
    """A body that drifts as one rigid body after each of n aborts.

    Attributes
    ----------
    solids
        Its collision shapes.
    placements
        Of their joints at each abort, about the centre of mass, world axes.
    radius, spin
        Greatest distance of its shapes from the centre of mass (n,) [m], bound of its spin (n,) [rad/s].
    centre
        From abort and drift time [s] to the centre of mass (3,) [m].
    inertia, wheels
        About the centre of mass (n, 3, 3), momentum of its wheels (n, 3), axes of the abort.
    step, attitudes
        Time between steps [s]; quaternion and spin since the abort at each (m, n, 7).
    duration
        Length of the drift [s].
    """

    solids: tuple[Solid, ...]
    placements: tuple[dict[int, pin.SE3], ...]
    radius: Array
    spin: Array
    centre: Callable[[int, float], Array]
    inertia: Array
    wheels: Array
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
        """Of a body at samples of a result; ``drift`` has the mean motion [rad/s] and the duration [s]."""
        shapes = tuple(solids(scene, body))
        if not shapes:
            message = "has no collision shape, so its distance is not known"
            raise ScenarioError(message, source=scene.source, where=body.path)
        mean_motion, duration = drift
        model, data = scene.model, scene.model.createData()
        joints = [joint for joint in body.subtree if joint]
        wheels = np.zeros((len(chosen), 3))
        if "wheel_momentum" in result.data:
            own = result.data.wheel_momentum.sel(body=body.name).values[chosen]
            wheels = np.nan_to_num(own)
        rows, placements, radius = [], [], []
        for k, (q, v) in enumerate(zip(result.array("q")[chosen], result.array("v")[chosen], strict=True)):
            pin.forwardKinematics(model, data, q, v)
            inertias = [data.oMi[joint].act(model.inertias[joint]) for joint in joints]
            momenta = [data.oMi[j].act(model.inertias[j] * data.v[j]) for j in joints]
            whole = sum(inertias[1:], inertias[0]) if joints else pin.Inertia.Identity()
            linear = sum((one.linear for one in momenta), np.zeros(3))
            about = sum((one.angular for one in momenta), np.zeros(3)) - np.cross(whole.lever, linear)
            spin = np.linalg.solve(whole.inertia, about)
            rows.append((whole.lever, linear / whole.mass, spin, whole.inertia))
            used = {solid.joint for solid in shapes}
            shift = pin.SE3(np.eye(3), -whole.lever)
            placements.append({joint: shift * data.oMi[joint] for joint in used})
            places = placements[k]
            radius.append(max(np.linalg.norm(places[s.joint].act(s.centre)) + s.radius for s in shapes))
        place, velocity, spin, inertia = (np.array(part) for part in zip(*rows, strict=True))
        kept = np.einsum("ni,nij,nj->n", spin, inertia, spin)
        bound = np.sqrt(kept / np.linalg.eigvalsh(inertia)[:, 0])
        count = int(np.ceil(duration * bound.max() / TURN)) + 1
        now = np.concatenate([np.tile([0.0, 0, 0, 1], (len(spin), 1)), spin], axis=1)
        attitudes = [now]
        for _ in range(count):
            attitudes.append(advance_attitudes(attitudes[-1], inertia, wheels, duration / count))
        begins = result.array("time")[chosen]

        def centre(k: int, t: float) -> Array:
            return drifted_centre(place[k], velocity[k], begins[k], t, mean_motion)

        return cls(
            shapes,
            tuple(placements),
            np.array(radius),
            bound,
            centre,
            inertia,
            wheels,
            duration / count,
            np.array(attitudes),
            duration,
        )

    def placed(self, k: int, t: float) -> dict[int, pin.SE3]:
        """Placements of joints at a time [s] after abort k, world axes."""
        i = min(int(t / self.step), len(self.attitudes) - 1)
        own = slice(k, k + 1)
        now = advance_attitudes(
            self.attitudes[i, own], self.inertia[own], self.wheels[own], t - i * self.step
        )
        turn = pin.SE3(pin.Quaternion(now[0, :4]).normalized().matrix(), self.centre(k, t))
        return {joint: turn * place for joint, place in self.placements[k].items()}


def advance_attitudes(state: Array, inertia: Array, wheels: Array, step: float) -> Array:
    """Attitudes of free bodies a step later, by Runge and Kutta's method of fourth order.

    Parameters
    ----------
    state
        Quaternions (x, y, z, w) and spins in the bodies' axes (n, 7) [1, rad/s].
    inertia, wheels
        About the centres of mass (n, 3, 3) [kg m^2], momenta of wheels (n, 3) [N m s], bodies' axes.
    step
        Step [s].
    """

    def rate(state: Array) -> Array:
        turn, spin = state[:, :4], state[:, 4:]
        momentum = np.einsum("nij,nj->ni", inertia, spin) + wheels
        faster = np.linalg.solve(inertia, -np.cross(spin, momentum)[..., None])[..., 0]
        vector = (turn[:, 3:] * spin + np.cross(turn[:, :3], spin)) / 2
        scalar = -np.sum(turn[:, :3] * spin, axis=1, keepdims=True) / 2
        return np.concatenate([vector, scalar, faster], axis=1)

    first = rate(state)
    second = rate(state + step / 2 * first)
    third = rate(state + step / 2 * second)
    fourth = rate(state + step * third)
    found: Array = state + step / 6 * (first + 2 * second + 2 * third + fourth)
    return found


def drifted_centre(place: Array, velocity: Array, begin: float, t: float, rate: float) -> Array:
    """Centre of mass (3,) [m] that drifts straight, or by the equations of Clohessy and Wiltshire.

    Parameters
    ----------
    place, velocity
        At the beginning (3,) [m, m/s], world axes, of which x is radial and y along-track at time 0.
    begin, t
        Time at the beginning, and time since then [s].
    rate
        Mean motion [rad/s]; 0 without an orbit.
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
    found: Array = hill(begin + t).T @ np.array(later)
    return found


def _least(
    robot: _RigidDrift, target: _RigidDrift, k: int, tolerance: float | None
) -> tuple[float, float, tuple[str, str]]:
    """Least distance after abort k, when it is reached, and the links that are nearest then."""
    duration = robot.duration
    grid = np.linspace(0, duration, 65)
    between = np.array([robot.centre(k, t) - target.centre(k, t) for t in grid])
    jumps = np.linalg.norm(np.diff(between, axis=0), axis=1)
    # chords of a curved path are shorter than it: by the bend over half an interval
    bends = np.abs(np.diff(between, 2, axis=0)).sum(axis=1).max()
    speed = (jumps.max() + bends) / grid[1]
    slope = speed + robot.spin[k] * robot.radius[k] + target.spin[k] * target.radius[k]

    def sampled(t: float) -> tuple[float, float, tuple[str, str]]:
        """Distance [m] of the nearest shapes, the time [s] and their links."""
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
            at = [joint * own for (_, joint), own in zip((ones[i], others[j]), placed, strict=True)]
            forms = [coal.Transform3s(place.rotation, place.translation) for place in at]
            shapes = ones[i][0].geometry, others[j][0].geometry
            coal.distance(shapes[0], forms[0], shapes[1], forms[1], coal.DistanceRequest(), apart)
            if apart.min_distance < distance:
                distance, pair = float(apart.min_distance), (ones[i][0].link, others[j][0].link)
        return distance, t, pair

    first, last = sampled(0.0), sampled(duration)
    best = min(first, last)
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
