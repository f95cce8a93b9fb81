"""A plan's torques, replayed by the rollouts' own methods over forward dynamics."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.polynomial import polynomial

from optim.planning.motion import Motion
from optim.planning.stage import Driven
from spacerobot.arrays import Array
from spacerobot.dynamics import (
    ArticulatedBody,
    Inertias,
    configuration_derivative,
    forward_kinematics,
    normalise,
)
from spacerobot.dynamics.joints import sparse
from spacerobot.rollout import build_rollout
from spacerobot.scene import Scene

LONGEST_STEP = 0.01
"""[s] Of the replay."""


@dataclass(frozen=True)
class OpenLoop:
    """A scene whose drive is a polynomial of time, as rollouts know closed loops.

    Parameters are the state at the beginning, the interval's length, and the drive at each of its points.
    """

    parameter_paths: tuple[str, ...]
    parameter_values: Array
    state_names: tuple[str, ...]
    nq: int
    nv: int
    setup: ca.Function
    dynamics: ca.Function
    normalise: ca.Function
    outputs: ca.Function
    gaps: ca.Function
    guards: ca.Function
    update: ca.Function
    nz: int = 0
    jumps: tuple[int, ...] = ()
    switches: tuple[int, ...] = ()
    events: tuple[()] = ()
    fine: tuple[tuple[int, float], ...] = ()
    max_gaps: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(cls, scene: Scene, driven: Driven, nodes: Array) -> OpenLoop:
        """Loop of a scene over one interval with these nodes."""
        model = scene.model
        nx, nu = model.nq + model.nv, len(driven.columns)
        t, x, given = ca.SX.sym("t"), ca.SX.sym("x", nx), ca.SX.sym("c", 1 + nu * len(nodes))
        q, v = x[: model.nq], x[model.nq :]
        drive = _between(nodes, t / given[0], ca.reshape(given[1:], nu, len(nodes)))
        force = -sparse(np.asarray(model.damping)) * v
        for k, column in enumerate(driven.columns):
            force[column] += drive[k]
        kinematics = forward_kinematics(model, q, v)
        body = ArticulatedBody.factorise(model, kinematics, Inertias.from_model(model))
        rate = ca.vertcat(configuration_derivative(model, q, v), body.acceleration(force))
        p, none = ca.SX.sym("p", nx + given.numel()), ca.SX(0, 1)
        names = tuple(f"p{i}" for i in range(p.numel()))
        xdot, e = ca.SX.sym("xdot", nx), ca.SX.sym("e")
        at, at_names = [t, x, given], ["t", "x", "c"]
        return cls(
            names,
            np.ones(p.numel()),
            tuple(f"x{i}" for i in range(nx)),
            model.nq,
            model.nv,
            ca.Function("setup", [p], [p[:nx], p[nx:]], ["p"], ["x0", "c"]),
            ca.Function("dynamics", at, [ca.densify(rate)], at_names, ["xdot"]),
            ca.Function("normalise", [x], [ca.vertcat(normalise(model, q), v)], ["x"], ["n"]),
            ca.Function("outputs", at, [v], at_names, ["velocity"]),
            ca.Function("gaps", [p], [none], ["p"], ["gap"]),
            ca.Function("guards", [*at, xdot], [none, none], [*at_names, "xdot"], ["g", "rate"]),
            ca.Function("update", [*at, e], [x], [*at_names, "e"], ["x_after"]),
        )


def replay(motion: Motion, backend: str = "auto") -> Array:
    """States (intervals + 1, nq + nv) at the knots when a plan's drive acts without feedback."""
    problem, scene = motion.problem, motion.problem.stage.scene
    length, points = motion.duration_s / motion.intervals, motion.lobatto.points
    loop = OpenLoop.of(scene, problem.stage.driven, motion.lobatto.nodes)
    steps = max(4, math.ceil(length / LONGEST_STEP))
    rollout = build_rollout(
        loop,
        duration_s=length,
        step_s=length / steps,
        output_step_s=length,
        backend=backend,  # type: ignore[arg-type]
    )
    x, u = problem.fixed, motion.u
    found = [x]
    for n in range(motion.intervals):
        first = n * (points - 1)
        p = np.concatenate([x, [length], u[first : first + points].ravel()])
        x = np.array(rollout.run(p).state[-1])
        found.append(x)
    return np.array(found)


def tip_errors(motion: Motion, states: Array) -> Mapping[str, Array]:
    """Distance [m] of each planned robot's tips from the plan at each knot (intervals + 1,).

    A robot without tips counts by its root link, whose turning by a radian counts as a metre.
    """
    scene = motion.problem.stage.scene
    model, data = scene.model, scene.model.createData()
    knots = motion.q[:: motion.lobatto.points - 1]
    led = {tip.body.name for tip in scene.tips}
    tips = {tip.label: tip.frame for tip in scene.tips}
    roots = {body.name: body.root_frame for body in scene.robots if body.name not in led}
    errors: dict[str, list[float]] = {label: [] for label in (*tips, *roots)}
    for planned, found in zip(knots, states[:, : model.nq], strict=True):
        placements = []
        for q in (planned, found):
            pin.framesForwardKinematics(model, data, np.array(q))
            placements.append({label: data.oMf[frame].copy() for label, frame in (tips | roots).items()})
        for label, values in errors.items():
            one, other = (placed[label] for placed in placements)
            turned = pin.log3(one.rotation.T @ other.rotation) if label in roots else np.zeros(3)
            values.append(float(np.linalg.norm(one.translation - other.translation) + np.linalg.norm(turned)))
    return {label: np.array(values) for label, values in errors.items()}


def _between(nodes: Array, place: ca.SX, values: ca.SX) -> ca.SX:
    """Value (nu x 1) at a place in 0 .. 1 of the polynomials through values (nu x s) at nodes."""
    found = ca.SX(values.size1(), 1)
    for k, node in enumerate(nodes):
        others = np.delete(nodes, k)
        row = polynomial.polyfromroots(others) / np.prod(node - others)
        weight = ca.SX(0)
        for coefficient in row[::-1]:
            weight = weight * place + coefficient
        found = found + weight * values[:, k]
    return found
