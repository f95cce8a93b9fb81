"""The published convex formulation of soft captures, written with CVXPY and the cone solver Clarabel.

Sow, Gutow, Choset and Manchester 2024 (arXiv:2405.00867), with the numbers of their published example: the
translation alone in Clohessy and Wiltshire's equations, steps of 1 s, thrust held; the chaser points at the
target. The first program has no hulls; each further one linearises the scaling at which the hulls touch,
until it is at least 1 at all points. The number of points grows from 40 to 350, by 10.
``python -m benchmarks.soft_capture_convex FILE [FIRST LAST]`` solves draws.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm, sqrtm
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from benchmarks.soft_capture import DRAWS, MASS, PORT, RATE, TARGET, Draw, draws, missing_draws, symmetric
from spacerobot.common.arrays import Array
from spacerobot.scene import load_scene

STEP, FEWEST, MOST, FINER = 1.0, 40, 350, 10
THRUST_WEIGHT, SLACK_WEIGHT = 5.0, 750.0
SCALING, ITERATIONS = 1.3, 14
THRUST, SPEED, SPIN, FAR = 100.0, 1.5, 0.2, 100.0
POSITION, VELOCITY, CONE, CONE_STEPS = 0.35, 0.03, np.radians(30), 5


def halfspaces(name: str) -> tuple[Array, Array]:
    """Normals (n, 3) and distances (n,) [m] of a hull's faces."""
    points = np.array(load_scene("soft-capture").scenario.pads[name].points)
    planes = np.unique(np.round(ConvexHull(points).equations, 9), axis=0)
    return planes[:, :3], -planes[:, 3]


def tumble(draw: Draw, count: int) -> tuple[list[Rotation], Array]:
    """Attitudes of the target and its spins (count, 3), own axes, at all points, without torques."""
    inertia = symmetric(TARGET)

    def rates(_: float, x: Array) -> Array:
        q, w = x[:4], x[4:]
        turn = 0.5 * np.concatenate([q[3] * w + np.cross(q[:3], w), [-q[:3] @ w]])
        return np.concatenate([turn, np.linalg.solve(inertia, -np.cross(w, inertia @ w))])

    times = np.arange(count) * STEP
    x = np.concatenate([draw.attitude, draw.spin])
    states = solve_ivp(rates, (0, times[-1]), x, "DOP853", times, rtol=1e-10, atol=1e-12).y.T
    return [Rotation.from_quat(q[:4]) for q in states], states[:, 4:]


def transition() -> tuple[Array, Array]:
    """State transition (6, 6) and input (6, 3) of a step with held thrust."""
    n, a, b = RATE, np.zeros((6, 6)), np.zeros((6, 3))
    a[:3, 3:], b[3:] = np.eye(3), np.eye(3) / MASS
    a[3, 0], a[3, 4], a[4, 3], a[5, 2] = 3 * n**2, 2 * n, -2 * n, -(n**2)
    exponential = expm(np.block([[a, b], [np.zeros((3, 9))]]) * STEP)
    return exponential[:6, :6], exponential[:6, 6:]


def pointing(places: Array) -> list[Rotation]:
    """Attitudes of the chaser, which points at the target, each the shortest rotation from the one before."""
    look = -places / np.linalg.norm(places, axis=1)[:, None]
    attitudes, before = [], np.array([0.0, 0, 1])
    for direction in look:
        axis = np.cross(before, direction)
        size = np.linalg.norm(axis)
        turn = np.arctan2(size, before @ direction) * axis / size if size > 1e-12 else np.zeros(3)
        step = Rotation.from_rotvec(turn)
        attitudes.append(step * attitudes[-1] if attitudes else step)
        before = direction
    return attitudes


def scaling(place: Array, chaser: Rotation, target: Rotation, hulls: Any) -> tuple[float, Array]:
    """Scaling at which the hulls touch, and its slope (3,) by the chaser's position with a pointing attitude.

    The smallest s with A_t R_t' x <= s b_t and A_c R_c' (x - p) <= s b_c is a linear program. The multipliers
    m of the chaser's rows give its slopes: with g = R_c A_c' m and y = x - p, -g by p and g x y by a rotation
    of the chaser; a step dp rotates the direction of sight d by d x (dp - d d'dp) / -|p|.
    """
    (normals_c, sizes_c), (normals_t, sizes_t) = hulls
    faces_c, faces_t = normals_c @ chaser.as_matrix().T, normals_t @ target.as_matrix().T
    rows = np.vstack([np.column_stack([faces_t, -sizes_t]), np.column_stack([faces_c, -sizes_c])])
    right = np.concatenate([np.zeros(len(sizes_t)), faces_c @ place])
    best = linprog([0, 0, 0, 1], rows, right, bounds=[(None, None)] * 3 + [(0, None)], method="highs")
    multipliers = -best.ineqlin.marginals[len(sizes_t) :]
    pull, lever = faces_c.T @ multipliers, best.x[:3] - place
    distance = np.linalg.norm(place)
    sight = -place / distance
    across = -(np.eye(3) - np.outer(sight, sight)) / distance
    turn = np.array([np.cross(sight, column) for column in across.T]).T
    return float(best.x[3]), -pull + np.cross(pull, lever) @ turn


def program(
    draw: Draw, count: int, motion: Any, near: tuple[Array, Array, Array] | None
) -> tuple[Array, Array] | None:
    """States (count, 6) and thrusts (count - 1, 3) of one convex program; None if infeasible.

    Args:
        draw, count: Initial conditions, and the number of points.
        motion: Attitudes of the target and its spins.
        near: Positions (count, 3) about which the scaling is linearised, the scaling (count,) there, and its
            slopes (count, 3); None for the program without hulls.
    """
    import cvxpy as cp

    attitudes, spins = motion
    a, b = transition()
    x, u, r = cp.Variable((count, 6)), cp.Variable((count - 1, 3)), cp.Variable(count)
    cost = THRUST_WEIGHT * cp.sum(cp.abs(u)) + cp.sum(r)
    last = attitudes[count - 1]
    port = last.apply([0, 0, PORT])
    moving = last.apply(np.cross(spins[count - 1], [0, 0, PORT]))
    rules = [
        x[0] == np.concatenate([draw.position, draw.velocity]),
        x[1:] == x[:-1] @ a.T + u @ b.T,
        cp.norm(x[:, 3:], axis=1) <= SPEED,
        cp.norm(u, axis=1) <= THRUST,
        cp.norm(x[-1, :3] - 2 * port) <= POSITION,
        # product of spin and lever, rotated to Hill axes; their code uses it in the target's own axes
        cp.norm(x[-1, 3:] - moving) <= VELOCITY,
        r <= FAR,
        cp.norm(x[:, :3], axis=1) <= r,
    ]
    for k in range(count - CONE_STEPS, count):
        turn = attitudes[k].as_matrix()
        away = turn.T @ (x[k, :3] - turn[:, 2] * PORT)
        rules.append(cp.norm(away[:2]) * np.tan(np.pi / 2 - CONE) <= away[2])
    # published relaxation of the limited rotation of the line of sight between steps
    half = np.real(sqrtm(np.block([[np.eye(3), -0.5 * np.eye(3)], [-0.5 * np.eye(3), np.eye(3)]])))
    c = -0.5 * np.cos(SPIN * STEP)
    least = np.linalg.eigvalsh(np.real(sqrtm(np.array([[1, c], [c, 1]])))).min()
    pairs = cp.hstack([x[1:, :3], x[:-1, :3]])
    rules.append(cp.norm(pairs @ half.T, axis=1) <= least / np.sqrt(2) * (r[1:] + r[:-1]))
    if near is not None:
        places, scalings, slopes = near
        slack = cp.Variable(count, nonneg=True)
        cost += SLACK_WEIGHT * cp.sum(slack)
        change = cp.sum(cp.multiply(slopes, x[:, :3] - places), axis=1)
        rules.append((scalings + change + slack)[1:] >= SCALING)
    problem = cp.Problem(cp.Minimize(cost), rules)
    try:
        problem.solve(solver=cp.CLARABEL, max_threads=1)
    except cp.SolverError:
        return None
    if problem.status not in ("optimal", "optimal_inaccurate"):
        return None
    return x.value, u.value


def solved(draw: Draw) -> dict[str, Any]:
    """Status, processor times [s], duration [s] and impulse [N s] of a draw by the published procedure."""
    hulls = halfspaces("chaser"), halfspaces("target")
    motion = tumble(draw, MOST)
    began = time.process_time()
    for count in range(FEWEST, MOST + 1, FINER):
        start = time.process_time()
        solution, near = program(draw, count, motion, None), None
        for iteration in range(ITERATIONS):
            if solution is None:
                break
            x, u = solution
            attitudes = pointing(x[:, :3])
            pairs = [scaling(x[k, :3], attitudes[k], motion[0][k], hulls) for k in range(count)]
            scalings, slopes = np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])
            if scalings.min() >= 1:
                end = time.process_time()
                return {
                    "status": "safe",
                    "cpu_s": end - began,
                    "last_cpu_s": end - start,
                    "duration_s": (count - 1) * STEP,
                    "iterations": iteration,
                    "impulse_Ns": float(np.linalg.norm(u, axis=1).sum() * STEP),
                }
            near = x[:, :3], scalings, slopes
            solution = program(draw, count, motion, near)
    return {"status": "infeasible", "cpu_s": time.process_time() - began}


def main() -> None:
    """Solve draws and append their results to a file."""
    path, *numbers = sys.argv[1:]
    first, last = (int(number) for number in numbers) if numbers else (0, DRAWS)
    for k in missing_draws(Path(path), first, last):
        line = json.dumps({"draw": k, **solved(draws()[k])})
        with Path(path).open("a") as file:
            file.write(line + "\n")


if __name__ == "__main__":
    main()
