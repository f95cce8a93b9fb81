"""Initial guesses: joints interpolate to a posture that meets the goal, free bodies drift."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.formulation.stage import PlanningProblem
from optim.planning.transcription.approach_guess import SAMPLES, TargetApproach, approached
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.motion import Motion
from spacerobot.common.arrays import Array
from spacerobot.scene.scene import SceneBody

STEPS = 200
"""Number of steps of the free motion's integration."""
ITERATIONS = 200
"""Maximum number of iterations of the inverse kinematics."""
DAMPING = 1e-3
"""Damping of the normal equations of the inverse kinematics [m^2, rad^2]."""
SPREAD = 0.7
"""Standard deviation of the postures and base paths of further starts [rad or m]."""
WINDINGS = 3
"""Number of ways in which a base rotates to its attitude: the short way, the long way about the same axis,
and the short way combined with a full turn about another axis."""
STEP = 1e-3
"""Step for differentiating a base's path, as a share of the duration."""


def initial_guess(
    problem: PlanningProblem,
    lobatto: Lobatto,
    mesh: int | Mesh,
    rng: np.random.Generator | None = None,
    start: int = 0,
) -> Motion:
    """Initial motion of a solve.

    Args:
        problem: The problem.
        lobatto, mesh: Collocation, and mesh of the motion or its number of equal intervals.
        rng: Generator of a different final posture, free duration and path of each driven base; the nominal
            guess if None.
        start: Number of the start, which selects one of the :data:`WINDINGS` ways of rotation for each base,
            and the arrival of an approach.
    """
    stage, (least, greatest, duration) = problem.stage, problem.duration
    model, driven = stage.scene.model, stage.driven
    if rng is not None and least < greatest:
        duration = float(rng.uniform(least, greatest))
    mesh = Mesh.of(mesh)
    approaches = _approaches(problem, lobatto)
    # joints of a base that flies to the target keep their posture, with which the base arrives
    constant_joints = {
        j for body in stage.scene.robots if body.name in approaches for j in body.driven_joints
    }
    columns = moved = [
        column
        for joint, column in zip(driven.joints, driven.columns, strict=False)
        if joint not in constant_joints
    ]
    if approaches and least < greatest:  # another arrival for each start
        choices = next(iter(approaches.values())).durations
        duration = float(choices[start % len(choices)])
    drift_q, drift_v = drift(problem, lobatto, mesh, duration)
    first = drift_q[-1].copy()
    if rng is not None:
        step, moved = np.zeros(model.nv), list(driven.columns)
        step[moved] = rng.normal(0.0, SPREAD, len(moved))
        first = _clipped(problem, pin.integrate(model, first, step))
    ends = inverse_kinematics(problem, first, drift_v[-1], moved)
    way = np.zeros(model.nv)
    way[columns] = pin.difference(model, drift_q[-1], ends)[columns]
    share = lobatto.times(mesh, 1.0)
    blend = share**3 * (10 - 15 * share + 6 * share**2)
    slope = 30 * share**2 * (1 - share) ** 2 / duration
    bend = 60 * share * (1 - share) * (1 - 2 * share) / duration**2
    q = np.array([pin.integrate(model, at, way * b) for at, b in zip(drift_q, blend, strict=True)])
    v, a = drift_v + slope[:, None] * way, bend[:, None] * way
    if rng is not None or approaches:
        for k, body in enumerate(body for body in stage.scene.robots if driven.of_base(body.name)):
            joint = model.joints[body.root_joint]
            if body.name in approaches:
                path = approaches[body.name].path(duration)
            elif rng is not None:
                path = _base_path(problem, body, ends, duration, rng, start // WINDINGS**k % WINDINGS)
            else:
                continue
            place = slice(joint.idx_q, joint.idx_q + joint.nq)
            moving = slice(joint.idx_v, joint.idx_v + joint.nv)
            for i, s in enumerate(share):
                before, here, after = (path(s + k * STEP) for k in (-1, 0, 1))
                h = STEP * duration
                one, other = (
                    pin.log3(a.rotation.T @ b.rotation) / h for a, b in ((before, here), (here, after))
                )
                spin, gain = (one + other) / 2, (other - one) / h
                speed = here.rotation.T @ (after.translation - before.translation) / (2 * h)
                bend = (
                    here.rotation.T @ (after.translation - 2 * here.translation + before.translation) / h**2
                )
                bend -= np.cross(spin, speed)
                if joint.nv == 3:
                    angle = np.arctan2(here.rotation[1, 0], here.rotation[0, 0])
                    q[i, place] = [*here.translation[:2], np.cos(angle), np.sin(angle)]
                    v[i, moving], a[i, moving] = [*speed[:2], spin[2]], [*bend[:2], gain[2]]
                else:
                    q[i, place] = [*here.translation, *pin.Quaternion(here.rotation).coeffs()]
                    v[i, moving], a[i, moving] = [*speed, *spin], [*bend, *gain]
            if joint.nv == 6:  # of two quaternions the one that goes on from the point before
                turns = q[:, joint.idx_q + 3 : joint.idx_q + 7]
                for i in range(len(turns)):
                    before = turns[i - 1] if i else problem.fixed[joint.idx_q + 3 : joint.idx_q + 7]
                    turns[i] *= 1.0 if turns[i] @ before > 0 else -1.0
    u = np.array([_drive(problem, *at) for at in zip(q, v, a, strict=True)])
    z = np.hstack([q, v, a, u, np.zeros((len(q), stage.w.numel() + stage.s.numel()))])
    z = np.clip(z, problem.lower, problem.upper)
    z[0, : problem.fixed.size] = problem.fixed
    return Motion(problem, lobatto, mesh, duration, z).split_forces()


def is_guided(problem: PlanningProblem) -> bool:
    """Whether initial guesses follow an approach of a base to the goal's place at the moving target."""
    return any(approached(problem, body) for body in problem.stage.scene.robots)


def arrival_durations(problem: PlanningProblem, lobatto: Lobatto, count: int) -> list[float]:
    """Durations [s] to be tried in order, at most ``count``.

    Args:
        problem: The problem, with the range of the duration.
        lobatto: Collocation of the motion.
        count: Number of durations.
    """
    least, greatest, _ = problem.duration
    choices = [one.durations for one in _approaches(problem, lobatto).values()]
    if choices:
        return [float(time) for time in choices[0][:count]]
    return [float(time) for time in np.linspace(least, greatest, count + 2)[1:-1]]


def _approaches(problem: PlanningProblem, lobatto: Lobatto) -> dict[str, TargetApproach]:
    """Approaches of the bases that the goal places relative to the target, by robot."""
    stage, (least, greatest, guess) = problem.stage, problem.duration
    bodies = [body for body in stage.scene.robots if approached(problem, body)]
    if not bodies or stage.scene.target is None:
        return {}
    model = stage.scene.model
    root = model.joints[stage.scene.target.root_joint]
    sampled = Mesh.of(max(8, SAMPLES // (lobatto.points - 1)))
    drift_q, drift_v = drift(problem, lobatto, sampled, greatest)
    times = lobatto.times(sampled, greatest)
    places = [_placement(q[root.idx_q : root.idx_q + root.nq]) for q in drift_q]

    def target(time: float) -> pin.SE3:
        """Placement of the drifting target, between the samples."""
        k = int(np.clip(np.searchsorted(times, time) - 1, 0, len(times) - 2))
        share = (time - times[k]) / (times[k + 1] - times[k])
        return pin.SE3.Interpolate(places[k], places[k + 1], float(np.clip(share, 0.0, 1.0)))

    near = int(np.argmin(np.abs(times - guess)))
    approaches = {}
    for body in bodies:
        joint = model.joints[body.root_joint]
        columns = [*range(joint.idx_v, joint.idx_v + joint.nv)]
        ends = inverse_kinematics(problem, drift_q[near].copy(), drift_v[near], columns)
        mated = places[near].actInv(_placement(ends[joint.idx_q : joint.idx_q + joint.nq]))
        begin = _placement(problem.fixed[joint.idx_q : joint.idx_q + joint.nq])
        rate = stage.driven.strength(body.name, "f") / np.sqrt(3)
        rate /= sum(model.inertias[j].mass for j in (body.root_joint, *body.joints))
        approaches[body.name] = TargetApproach(begin, mated, target, (least, greatest), rate)
    return approaches


def _base_path(
    problem: PlanningProblem,
    body: SceneBody,
    ends: Array,
    duration: float,
    rng: np.random.Generator,
    winding: int,
) -> Callable[[float], pin.SE3]:
    """Placement of a driven base by the share of the duration, from its start to that of inverse kinematics.

    It has the initial velocity and spin, is at rest at the end, and follows an arc from the generator:

        R(s) = R(0) exp(f(s) T w(0)) exp(b(s) r) exp(b(s) n) exp(c(s) e),
        f = s (1 - s)^2,  b = s^3 (10 - 15 s + 6 s^2),  c = 16 s^2 (1 - s)^2,

    exp(r) is the rotation to the end, also by more than half a turn; n is a full turn about any axis, or
    zero; e is the arc's rotation. Motion along axes that are not driven is left to the solver.
    """
    model, axes = problem.stage.scene.model, problem.stage.driven.of_base(body.name)
    joint = model.joints[body.root_joint]
    flat = joint.nv == 3
    pushed, turned = (any(axis[0] == part for axis in axes) for part in "ft")
    twist = problem.fixed[model.nq + joint.idx_v : model.nq + joint.idx_v + joint.nv]
    begin, end = (_placement(q[joint.idx_q : joint.idx_q + joint.nq]) for q in (problem.fixed, ends))
    spin = np.array([0.0, 0.0, twist[2]]) if flat else twist[3:]
    speed = begin.rotation @ (np.array([*twist[:2], 0.0]) if flat else twist[:3])
    turn, full = pin.log3(begin.rotation.T @ end.rotation), np.zeros(3)
    arc, bow, axis = rng.normal(0.0, SPREAD, (3, 3))
    if flat:
        bow, axis = bow * [0, 0, 1], np.array([0.0, 0.0, 1.0])
        arc[2] = 0.0
    axis /= np.linalg.norm(axis)
    if winding == 1:
        angle = float(np.linalg.norm(turn))
        turn -= 2 * np.pi * (turn / angle if angle > 0 else axis)
    elif winding == 2:
        full = 2 * np.pi * axis
    way = end.translation - begin.translation if pushed else duration * speed
    arc *= np.linalg.norm(way) if pushed else 0.0
    if not turned:
        turn, full, bow = (np.zeros(3) for _ in range(3))

    def path(s: float) -> pin.SE3:
        f, b, c = s * (1 - s) ** 2, s**3 * (10 - 15 * s + 6 * s**2), 16 * s**2 * (1 - s) ** 2
        elapsed = duration * (f if turned else s)
        rotation = begin.rotation @ pin.exp3(elapsed * spin) @ pin.exp3(b * turn) @ pin.exp3(b * full)
        moved = begin.translation + (f * duration * speed + b * way + c * arc if pushed else s * way)
        return pin.SE3(rotation @ pin.exp3(c * bow), moved)

    return path


def _placement(q: Array) -> pin.SE3:
    """Placement of a floating joint, planar or free."""
    if q.size == 4:
        return pin.SE3(pin.exp3(np.array([0.0, 0.0, np.arctan2(q[3], q[2])])), np.array([*q[:2], 0.0]))
    return pin.SE3(pin.Quaternion(*q[[6, 3, 4, 5]]).normalized().toRotationMatrix(), q[:3])


def rescaled_motion(motion: Motion, problem: PlanningProblem, duration: float) -> Motion:
    """Initial motion from another problem's motion over the same scene, rescaled to a duration.

    Its deviation from the free drift is kept at the same shares of the duration.
    """
    model, share = problem.stage.scene.model, duration / motion.duration_s
    before = drift(problem, motion.lobatto, motion.mesh, motion.duration_s)
    after = drift(problem, motion.lobatto, motion.mesh, duration)
    z = np.empty_like(motion.z)
    parts = zip(motion.q, motion.v, motion.a, motion.u, motion.w, strict=True)
    for k, (q, v, a, u, w) in enumerate(parts):
        q = pin.integrate(model, after[0][k], pin.difference(model, before[0][k], q))
        v, a = after[1][k] + (v - before[1][k]) / share, a / share**2
        drive = u if share == 1.0 else _drive(problem, q, v, a)
        z[k] = np.concatenate([q, v, a, drive, w, np.zeros(problem.stage.s.numel())])
    z = np.clip(z, problem.lower, problem.upper)
    size = problem.fixed.size
    z[0, :size] = np.clip(z[0, :size], *problem.start)
    return Motion(problem, motion.lobatto, motion.mesh, duration, z).split_forces()


def _drive(problem: PlanningProblem, q: Array, v: Array, a: Array) -> Array:
    """Generalized forces of the drives (nu,), by Pinocchio's inverse dynamics; other rows are left out."""
    model = problem.stage.scene.model
    force = pin.rnea(model, model.createData(), q, v, a) + np.asarray(model.damping) * v
    force -= problem.stage.environment_effort(q, v)
    return np.asarray(force[list(problem.stage.driven.columns)])


def drift(
    problem: PlanningProblem, lobatto: Lobatto, mesh: int | Mesh, duration: float
) -> tuple[Array, Array]:
    """Configuration and velocity at all points without drives and with joints at rest."""
    stage, model = problem.stage, problem.stage.scene.model
    data = model.createData()
    free = np.ones(model.nv)  # 1 for velocities that are free, 0 for those of joints
    free[list(stage.driven.columns[: len(stage.driven.joints)])] = 0.0
    q, v = problem.fixed[: model.nq].copy(), problem.fixed[model.nq :] * free
    held = None
    if stage.grips:
        rows = ca.vertcat(stage.parting, stage.a[np.flatnonzero(free == 0).tolist()])
        held = ca.Function("held", [stage.q, stage.v, stage.a], [rows, ca.jacobian(rows, stage.a)])

    def falling(q: Array, v: Array) -> Array:
        """Acceleration (nv,) without drives and with joints at rest."""
        if held is None:
            return np.asarray(free * pin.aba(model, data, q, v, stage.environment_effort(q, v)))
        bias, slopes = (np.array(x.full()) for x in held(q, v, np.zeros(model.nv)))
        upper, none = np.triu(pin.crba(model, data, q)), np.zeros((len(slopes), len(slopes)))
        inertia = upper + np.triu(upper, 1).T
        matrix = np.block([[inertia, slopes.T], [slopes, none]])
        bend = pin.nle(model, data, q, v) - stage.environment_effort(q, v)
        right = -np.concatenate([bend, bias.ravel()])
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0][: model.nv])

    times, states = lobatto.times(mesh, duration), [(q, v)]
    for begin, end in itertools.pairwise(times):
        steps = max(1, round(STEPS * (end - begin) / duration))
        h = (end - begin) / steps
        for _ in range(steps):  # Heun's method on the manifold
            one = falling(q, v)
            other = falling(pin.integrate(model, q, h * v), v + h * one)
            q, v = pin.integrate(model, q, h * (v + h / 4 * (one + other))), v + h / 2 * (one + other)
        states.append((q, v))
    qs, vs = zip(*states, strict=True)
    return np.array(qs), np.array(vs)


def inverse_kinematics(problem: PlanningProblem, q: Array, v: Array, columns: list[int]) -> Array:
    """Configuration near the given one, moved along ``columns`` of v, near the goal's poses and postures."""
    stage, model = problem.stage, problem.stage.scene.model
    rows = ca.vertcat(*(row.value for row in problem.goal))
    still = np.flatnonzero(~np.array(ca.which_depends(rows, stage.v, 1, True), dtype=bool)).tolist()
    if not still:
        return q
    rows = ca.densify(rows[still])
    tangent = ca.jacobian(stage.rate, stage.v)[:, columns]
    slopes = ca.densify(ca.mtimes(ca.jacobian(rows, stage.q), tangent))
    function = ca.Function("goal", [stage.z], [rows, slopes])
    rest, shifts = np.zeros(stage.z.numel() - model.nq - model.nv), base_shifts(problem)
    for _ in range(ITERATIONS):
        residual, jacobian = (np.array(x) for x in function(np.concatenate([q, v, rest])))
        if np.abs(residual).max() < 1e-6:
            break
        normal = jacobian @ jacobian.T + DAMPING * np.eye(len(residual))
        step = np.zeros(model.nv)
        step[columns] = -(jacobian.T @ np.linalg.solve(normal, residual)).ravel()
        largest = np.abs(np.delete(step, shifts)).max(initial=0.0)
        q = _clipped(problem, pin.integrate(model, q, step / max(1.0, 5 * largest)))
    return q


def base_shifts(problem: PlanningProblem) -> list[int]:
    """Indices in v of the velocities of bases that forces drive.

    Positions are linear in them, so that inverse kinematics needs no bound of its steps along them, which may
    be as long as the distance of a rendezvous.
    """
    stage, columns = problem.stage, list[int]()
    for body in stage.scene.robots:
        if body.root_joint and stage.driven.strength(body.name, "f"):
            first, size = (
                int(of[body.root_joint]) for of in (stage.scene.model.idx_vs, stage.scene.model.nvs)
            )
            columns += range(first, first + (3 if size == 6 else 2))
    return columns


def _clipped(problem: PlanningProblem, q: Array) -> Array:
    """Configuration whose joints keep to their ranges."""
    return np.clip(q, problem.lower[: q.size], problem.upper[: q.size])
