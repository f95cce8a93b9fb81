"""Soft captures of tumbling satellites: plans of 250 draws, flown by independent equations and checked.

The problem is that of Sow, Gutow, Choset and Manchester 2024 (arXiv:2405.00867), the scenario
``soft-capture``.
``python -m benchmarks.soft_capture FILE [FIRST LAST] [--arm]`` plans draws and adds them to a file, line by
line. Draws in the file are left out, so that an interrupted run resumes. With ``--arm`` the chaser has an arm
whose tip grasps the port, ``examples/soft-capture-arm.yaml``.
"""

from __future__ import annotations

import importlib.util
import itertools
import json
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import PPoly
from scipy.spatial.transform import Rotation

from benchmarks.arm_flight import (
    Chain,
    CircularOrbit,
    Servo,
    arm_distances,
    arm_flown,
    arm_rotation,
    read_arm,
    tip_motion,
)
from benchmarks.table_row import Row
from optim.planning.search.held_joints import solver_with_joints_held
from optim.planning.search.make_plan import make_plan
from optim.planning.search.plan_solver import PlanSolver
from optim.planning.transcription.motion import Motion
from optim.planning.verification.tracking_gains import tracking_gains
from spacerobot.common.arrays import Array
from spacerobot.common.errors import NoPlanError
from spacerobot.scene import load_scene

SEED, DRAWS, IN_BENCH = 0, 250, 20
MU, AXIS = 3.986004418e14, 7738e3
RATE = float(np.sqrt(MU / AXIS**3))
"""Mean motion [rad/s]."""
PORT = 1.35
"""Distance of each port from its body's centre along its own z axis [m]."""
MASS = 1500.0
CHASER = np.array([[16.072, 3.07409e-11, 4.25544e-8], [0, 13.3014, 4.49124e-10], [0, 0, 16.0409]])
TARGET = np.array([[5.89056, -1.37725e-7, 2.97917e-8], [0, 11.4462, 0.233516], [0, 0, 11.5365]])
THRUST, SPEED, SPIN = 100.0, 1.5, 0.2
POSITION, VELOCITY = 0.35, 0.03
ARM = Path(__file__).parents[1] / "examples" / "soft-capture-arm.yaml"
NEAR = 8.0
"""Distance of the bodies' centres beyond which the arm is clear of the target [m]."""
GRASP_POSITION, GRASP_VELOCITY, GRASP_ANGLE = 0.01, 0.01, np.radians(2)
"""Largest errors of the arm's tip when it grasps [m, m/s, rad]."""
CONE, VIEW = np.radians(30), np.radians(30)
CONE_TIME = 4.0
"""Time between the first and the last of the five points, 1 s apart, at which the cone is published [s]."""
ALLOWED = 1e-3
"""Relative excess over a limit that counts as zero, as in the planner."""


@dataclass(frozen=True)
class Draw:
    """Initial conditions in rotating Hill axes.

    Attributes:
        position, velocity: Position [m] and velocity [m/s] of the chaser (3,).
        attitude: Attitude of the target, a quaternion x, y, z, w (4,).
        spin: Spin of the target, its own axes (3,) [rad/s].
    """

    position: Array
    velocity: Array
    attitude: Array
    spin: Array

    @property
    def pointing(self) -> Rotation:
        """Attitude of the chaser, whose z axis points at the target, by the shortest rotation."""
        to_target = -self.position / np.linalg.norm(self.position)
        axis = np.cross([0, 0, 1], to_target)
        angle = np.arctan2(np.linalg.norm(axis), to_target[2])
        return Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))

    def changes(self) -> dict[str, Any]:
        """Numbers of the scenario by dotted path."""
        target = Rotation.from_quat(self.attitude)
        return {
            "robots.chaser.base.position": self.position.tolist(),
            "robots.chaser.base.velocity": self.velocity.tolist(),
            "robots.chaser.base.rotation_deg": self.pointing.as_euler("xyz", degrees=True).tolist(),
            "target.base.rotation_deg": target.as_euler("xyz", degrees=True).tolist(),
            "target.base.spin_deg": np.degrees(target.apply(self.spin)).tolist(),
        }


def draws(count: int = DRAWS) -> list[Draw]:
    """Draws on safety ellipses of 15 to 25 m radially and 10 to 25 m across the orbit, up to 10 deg/s."""
    rng, table = np.random.default_rng(SEED), []
    for _ in range(count):
        sides = rng.choice([-1.0, 1.0], 6)
        a, b = rng.uniform(15, 25), rng.uniform(10, 25)
        x, z = sides[0] * a * rng.uniform(0.5, 1), sides[1] * b * rng.uniform(0.5, 1)
        u, w = sides[2] * RATE * np.sqrt(a**2 - x**2), sides[3] * RATE * np.sqrt(b**2 - z**2)
        direction, attitude = rng.normal(size=3), rng.normal(size=4)
        spin = np.radians(10) * rng.uniform() * direction / np.linalg.norm(direction)
        table.append(
            Draw(
                np.array([x, 2 * u / RATE, z]),
                np.array([u, -2 * RATE * x, w]),
                attitude / np.linalg.norm(attitude),
                spin,
            )
        )
    return table


def symmetric(upper: Array) -> Array:
    """Symmetric matrix from its upper triangle."""
    return np.asarray(upper + np.triu(upper, 1).T)


def flown(draw: Draw, wrench: Callable[[Array | float], Array], knots: Array) -> tuple[Array, Array, Array]:
    """Times (n,), states of chaser (n, 13) and target (n, 7) under a wrench, by independent equations.

    The chaser's centre moves by the exact relative equations of two bodies in Hill axes, with x = (position,
    velocity); attitudes x, y, z, w are relative to inertial axes and spins, in own axes, too, so that the
    bodies obey Euler's equations with the torque of the gravity gradient. At the start both axes coincide.

    Args:
        draw: Initial conditions.
        wrench: Force and torque (6,) on the chaser, its own axes, at a time [s].
        knots: Times at which the wrench jumps, first and last among them [s].
    """
    inertias = symmetric(CHASER), symmetric(TARGET)

    def turning(state: Array, inertia: Array, up: Array, torque: Array) -> Array:
        q, w = state[:4], state[4:]
        n = Rotation.from_quat(q).inv().apply(up)
        torque = torque + 3 * RATE**2 * np.cross(n, inertia @ n)
        rate = 0.5 * np.concatenate([q[3] * w + np.cross(q[:3], w), [-q[:3] @ w]])
        return np.concatenate([rate, np.linalg.solve(inertia, torque - np.cross(w, inertia @ w))])

    def rates(t: float, x: Array) -> Array:
        force = wrench(t)
        hill = Rotation.from_rotvec([0, 0, RATE * t])  # from Hill to inertial axes
        push = hill.inv().apply(Rotation.from_quat(x[6:10]).apply(force[:3])) / MASS
        place, speed = x[:3], x[3:6]
        away = np.array([AXIS, 0, 0]) + place
        pull = -MU * away / np.linalg.norm(away) ** 3
        pull += [RATE**2 * away[0] + 2 * RATE * speed[1], RATE**2 * away[1] - 2 * RATE * speed[0], 0]
        up = hill.apply([1.0, 0, 0])
        chaser = turning(x[6:13], inertias[0], up, force[3:])
        return np.concatenate([speed, pull + push, chaser, turning(x[13:], inertias[1], up, np.zeros(3))])

    frame = np.array([0, 0, RATE])
    target, chaser = Rotation.from_quat(draw.attitude), draw.pointing
    x = np.concatenate(
        [
            draw.position,
            draw.velocity,
            chaser.as_quat(),
            chaser.inv().apply(frame),
            draw.attitude,
            draw.spin + target.inv().apply(frame),
        ]
    )
    times, states = [0.0], [x]
    for begin, end in itertools.pairwise(knots):
        inside = np.linspace(begin, end, max(2, int(np.ceil((end - begin) / 0.05)) + 1))
        solution = solve_ivp(rates, (begin, end), x, "DOP853", inside, rtol=1e-9, atol=1e-10)
        x = solution.y[:, -1]
        times += inside[1:].tolist()
        states += list(solution.y.T[1:])
    trajectory = np.array(states)
    return np.array(times), trajectory[:, :13], trajectory[:, 13:]


def violations(times: Array, chaser: Array, target: Array, wrenches: Array) -> dict[str, float]:
    """Largest relative excess of each constraint; for hulls the smallest distance, negated [m].

    Args:
        times, chaser, target: A flight, as :func:`flown` returns it.
        wrenches: Force and torque on the chaser (n, 6), its own axes.
    """
    hill = Rotation.from_rotvec(np.outer(times, [0, 0, RATE]))
    bodies = [hill.inv() * Rotation.from_quat(one) for one in (chaser[:, 6:10], target[:, :4])]  # Hill axes
    spins = [b.apply(w) - [0, 0, RATE] for b, w in zip(bodies, (chaser[:, 10:], target[:, 4:]), strict=True)]
    ports = [chaser[-1, :3], np.zeros(3)] + PORT * np.array([body[-1].apply([0.0, 0, 1]) for body in bodies])
    # of the chaser's port, and of the target's point there
    moving = [np.cross(spin[-1], ports[0] - c) for spin, c in zip(spins, (chaser[-1, :3], 0), strict=True)]
    moving[0] += chaser[-1, 3:6]
    return path_violations(times, chaser, target, wrenches) | {
        "position": float(np.linalg.norm(ports[0] - ports[1]) / POSITION - 1),
        "velocity": float(np.linalg.norm(moving[0] - moving[1]) / VELOCITY - 1),
    }


def path_violations(times: Array, chaser: Array, target: Array, wrenches: Array) -> dict[str, float]:
    """Excesses of :func:`violations` other than those at the end."""
    import coal

    hill = Rotation.from_rotvec(np.outer(times, [0, 0, RATE]))
    bodies = [hill.inv() * Rotation.from_quat(one) for one in (chaser[:, 6:10], target[:, :4])]  # Hill axes
    place, speed = chaser[:, :3], chaser[:, 3:6]
    axes = [body.apply([0.0, 0, 1]) for body in bodies]
    # the chaser's centre in the cone of the target's port, as published
    away = place - PORT * axes[1]
    along = np.einsum("ij,ij->i", away, axes[1])
    across = np.linalg.norm(away - along[:, None] * axes[1], axis=1)
    late = times >= times[-1] - CONE_TIME
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", axes[0], -place) / np.linalg.norm(place, axis=1), -1, 1))
    spin = bodies[0].apply(chaser[:, 10:]) - [0, 0, RATE]
    shapes, gaps = hulls(), []
    for k in range(len(times)):
        result = coal.DistanceResult()
        chaser_at = coal.Transform3s(bodies[0][k].as_matrix(), place[k])
        target_at = coal.Transform3s(bodies[1][k].as_matrix(), np.zeros(3))
        coal.distance(shapes[0], chaser_at, shapes[1], target_at, coal.DistanceRequest(), result)
        gaps.append(result.min_distance)
    return {
        "thrust": float(np.linalg.norm(wrenches[:, :3], axis=1).max() / THRUST - 1),
        "speed": float(np.linalg.norm(speed, axis=1).max() / SPEED - 1),
        "spin": float(np.linalg.norm(spin, axis=1).max() / SPIN - 1),
        "view": float(angle.max() / VIEW - 1),
        "cone": float((np.arctan2(across, along)[late]).max() / CONE - 1),
        "hulls": -float(min(gaps)),
    }


def hulls() -> list[Any]:
    """Hulls of chaser and target."""
    import coal

    pads, shapes = load_scene("soft-capture").scenario.pads, []
    for name in ("chaser", "target"):
        points = coal.StdVec_Vec3s()
        points.extend([np.array(point) for point in pads[name].points])
        shapes.append(coal.Convex.convexHull(points, False, ""))
    return shapes


def wrench_of(motion: Motion) -> Callable[[Array | float], Array]:
    """Force and torque of a plan on the chaser (6,) at a time [s], or (n, 6) at times (n,)."""
    knots, points = np.array(motion.mesh.knots) * motion.duration_s, motion.lobatto.points
    coefficients = np.array(motion.lobatto.basis)  # (points, powers), lowest first
    rows = np.arange(motion.intervals)[:, None] * (points - 1) + np.arange(points)
    polynomials = np.einsum("kp,nku->npu", coefficients, motion.u[rows])

    def wrench(time: Array | float) -> Array:
        n = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, motion.intervals - 1)
        place = (time - knots[n]) / (knots[n + 1] - knots[n])
        powers = np.asarray(place)[..., None] ** np.arange(coefficients.shape[1])
        return np.einsum("...p,...pu->...u", powers, polynomials[n])

    return wrench


def scenario(*, arm: bool) -> str | Path:
    """Scenario of a chaser with or without an arm."""
    return ARM if arm else "soft-capture"


def compile_problem(*, arm: bool = False) -> None:
    """Compile the functions of the problem, which are the same for all draws."""
    solver = PlanSolver.of(load_scene(scenario(arm=arm)), "compiled")
    solver_with_joints_held(solver)


def planned(draw: Draw, *, arm: bool = False) -> dict[str, Any]:
    """Plan a draw, fly it and check it: status, processor time [s], duration [s], impulse [N s], excesses.

    The functions of the problem are compiled already; see :func:`compile_problem`.
    """
    scene = load_scene(scenario(arm=arm), draw.changes())
    began = time.process_time()
    try:
        plan = make_plan(scene, backend="compiled")
    except NoPlanError as fault:
        return {"status": "no plan", "cpu_s": time.process_time() - began, "why": fault.message}
    spent, motion = time.process_time() - began, plan.motion
    knots, drives = np.array(motion.mesh.knots) * motion.duration_s, wrench_of(motion)
    numbers: dict[str, float] = {}
    if arm:
        excess, numbers = arm_violations(draw, motion)
    else:
        times, chaser, target = flown(draw, drives, knots)
        excess = violations(times, chaser, target, drives(times))
    fine = np.linspace(0, motion.duration_s, 20 * int(np.ceil(motion.duration_s / 0.05)))
    forces = drives(fine)[:, -6:-3]
    return {
        "status": "verified" if all(value <= ALLOWED for value in excess.values()) else "violated",
        "cpu_s": spent,
        "duration_s": motion.duration_s,
        "impulse_Ns": float(np.trapezoid(np.linalg.norm(forces, axis=1), fine)),
        "iterations": sum(run.iterations for run in plan.runs),
        "excess": excess,
        **numbers,
    }


def arm_violations(draw: Draw, motion: Motion) -> tuple[dict[str, float], dict[str, float]]:
    """Excesses of a plan with an arm as of :func:`violations`, and further numbers, on an independent flight.

    The base's wrench acts without feedback. The joints follow the plan by the feedback of ``followed.yaml``.
    Excesses of distances are negated distances [m]; those of joints' positions are relative to their ranges.
    """
    scene = motion.problem.stage.scene
    (body,) = scene.robots
    mount = body.config.mounts["arm"]
    links = read_arm(
        Path(__file__).parents[1] / "urdf" / mount.urdf,
        np.array(mount.position),
        np.array(mount.rotation_deg),
    )
    chain, orbit = Chain(MASS, symmetric(CHASER), links), CircularOrbit(MU, AXIS)
    count = len(chain.moving)
    knots, drives = np.array(motion.mesh.knots) * motion.duration_s, wrench_of(motion)
    # positions and rates of the planned joints are polynomials of degree 4 in each interval
    nodes = np.linspace(0, 1, 5)
    joints = [scene.model.joints[joint] for joint in motion.problem.stage.driven.joints]
    q, v = motion.parts(motion.at(motion.mesh, nodes))[:2]
    angles, rates = q[:, [joint.idx_q for joint in joints]], v[:, [joint.idx_v for joint in joints]]

    def course(values: Array) -> PPoly:
        """Polynomials through values (intervals 5, n) at the nodes."""
        by_interval = values.reshape(motion.intervals, len(nodes), count)
        local = np.einsum("pj,njk->pnk", np.linalg.inv(np.vander(nodes)), by_interval)
        powers = np.arange(len(nodes) - 1, -1, -1)[:, None, None]
        return PPoly(local / np.diff(knots)[:, None] ** powers, knots)

    gains = tracking_gains(motion, body.name)
    servo = Servo(
        lambda t: drives(t)[:count],
        course(angles),
        course(rates),
        *(np.full(count, gains[key]) for key in ("kp", "kd")),
        np.array([link.torque for link in chain.moving]),
    )
    _, _, target = flown(draw, lambda _: np.zeros(6), knots)
    pointing = draw.pointing
    start = [
        draw.position,
        pointing.as_quat(),
        pointing.inv().apply(draw.velocity + np.cross([0, 0, RATE], draw.position)),
    ]
    start += [pointing.inv().apply([0, 0, RATE]), angles[0], rates[0]]
    times, states = arm_flown(chain, orbit, np.concatenate(start), lambda t: drives(t)[count:], servo, knots)
    # as states of `flown`, which are in Hill axes
    hill, attitude = Rotation.from_rotvec(np.outer(times, [0, 0, RATE])), Rotation.from_quat(states[:, 3:7])
    place = hill.inv().apply(states[:, :3])
    speed = hill.inv().apply(attitude.apply(states[:, 7:10])) - np.cross([0, 0, RATE], place)
    chaser = np.hstack([place, speed, states[:, 3:7], states[:, 10:13]])
    joint_torques = np.array(
        [servo(*one) for one in zip(times, states[:, 13 : 13 + count], states[:, 13 + count :], strict=True)]
    )
    limits = {
        key: np.array([getattr(link, key) for link in chain.moving])
        for key in ("lower", "upper", "rate", "torque")
    }
    joint_angles, width = states[:, 13 : 13 + count], limits["upper"] - limits["lower"]
    outside = np.maximum(limits["lower"] - joint_angles, joint_angles - limits["upper"])
    # tip and port at the end, in axes that do not rotate
    tip, axis, moving, held = tip_motion(chain, states[-1])
    object_attitude = Rotation.from_quat(target[-1, :4])
    port, spin = object_attitude.apply([0, 0, PORT]), object_attitude.apply(target[-1, 4:])
    off, slip = float(np.linalg.norm(tip - port)), float(np.linalg.norm(moving - np.cross(spin, tip)))
    angle = float(np.arccos(np.clip(axis @ -port / PORT, -1, 1)))
    excess = path_violations(times, chaser, target, drives(times)[:, count:]) | {
        "position": off / GRASP_POSITION - 1,
        "velocity": slip / GRASP_VELOCITY - 1,
        "orientation": float(angle / GRASP_ANGLE - 1),
        "joint range": float((outside / width).max()),
        "joint rate": float((np.abs(states[:, 13 + count :]) / limits["rate"]).max() - 1),
        "joint torque": float((np.abs(joint_torques) / limits["torque"]).max() - 1),
    }
    near = np.linalg.norm(place, axis=1) < NEAR
    attitudes = (attitude, Rotation.from_quat(target[:, :4]))
    excess |= arm_distances(chain, states, attitudes, hulls(), near)
    numbers = {
        "tip_error_m": off,
        "tip_speed_m_s": slip,
        "tip_angle_deg": float(np.degrees(angle)),
        "base_slip_m_s": float(np.linalg.norm(held - np.cross(spin, tip))),
        "arm_rotation_deg": float(np.degrees(arm_rotation(chain, times, states))),
        "joint_motion_deg": float(np.degrees(np.ptp(joint_angles, axis=0).max())),
        "joint_torque_Nm": float(np.abs(joint_torques).max()),
    }
    return excess, numbers


def row() -> list[Row]:
    """Row of the first draws, against the published convex formulation."""
    compile_problem()
    results = [planned(draw) for draw in draws()[:IN_BENCH]]
    verified = [one for one in results if one["status"] == "verified"]
    ours = statistics.median(one["cpu_s"] for one in results)
    what = f"{IN_BENCH} soft captures planned, position and attitude"
    note = f"{len(verified)} of {IN_BENCH} verified by an independent flight"
    numbers: dict[str, Any] = {"ours": results}
    missing = [name for name in ("cvxpy", "clarabel") if importlib.util.find_spec(name) is None]
    if missing:
        note += f"; theirs not measured: {', '.join(missing)} missing, `pip install 'spacerobot[convex]'`"
        return [Row(what, "convex program of the translation", f"{ours:.2f} s", note=note, numbers=numbers)]
    from benchmarks import soft_capture_convex as convex

    theirs = [convex.solved(draw) for draw in draws()[:IN_BENCH]]
    safe = [one for one in theirs if one["status"] == "safe"]
    median = statistics.median(one["cpu_s"] for one in theirs)
    note += f"; {len(safe)} of {IN_BENCH} safe by theirs"
    return [
        Row(
            what,
            "convex program of the translation, CVXPY and Clarabel",
            f"{ours:.2f} s",
            f"{median:.2f} s",
            ours / median,
            note=note,
            numbers=numbers | {"theirs": theirs},
        )
    ]


def missing_draws(path: Path, first: int, last: int) -> list[int]:
    """Indices of the draws from ``first`` to below ``last`` that are not in a file of results."""
    lines = path.read_text().splitlines() if path.exists() else []
    measured = {json.loads(line)["draw"] for line in lines}
    return [k for k in range(first, last) if k not in measured]


def main() -> None:
    """Plan draws and append their results to a file."""
    arm = "--arm" in sys.argv
    path, *numbers = (word for word in sys.argv[1:] if word != "--arm")
    first, last = (int(number) for number in numbers) if numbers else (0, DRAWS)
    compile_problem(arm=arm)
    for k in missing_draws(Path(path), first, last):
        line = json.dumps({"draw": k, **planned(draws()[k], arm=arm)})
        with Path(path).open("a") as file:
            file.write(line + "\n")


if __name__ == "__main__":
    main()
