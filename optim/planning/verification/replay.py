"""Replay of a plan's torques by the integrators of rollouts, without and with feedback."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from optim.planning.formulation.grasps import spring_wrench, tip_slip
from optim.planning.formulation.stage import Stage, spring_forces
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.motion import Motion
from optim.planning.verification.tracking_gains import tracking_gains
from optim.problem.derived_loop import DerivedLoop
from spacerobot.common.arrays import Array
from spacerobot.compiled.numeric_function import NumericFunction
from spacerobot.dynamics import (
    ArticulatedBody,
    Inertias,
    configuration_derivative,
    forward_kinematics,
    normalise,
)
from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.dynamics.joints import sparse
from spacerobot.rollout import Rollout, build_rollout

LONGEST_STEP = 0.01
"""Largest integration step of the replay [s]."""
STABLE = 2.5
"""Largest product of integration step and fastest rate; the method of order 4 is stable up to 2.8."""
STIFF = 5000.0
"""Rate above which an implicit method integrates [1/s]."""
ERROR = 1e-9
"""Local error of the implicit method, relative to each state and [m, rad, m/s, rad/s]."""


@functools.lru_cache(maxsize=4)
def _loop(stage: Stage, lobatto: Lobatto) -> DerivedLoop:
    """A scene whose drive is a polynomial of time, with joint PD to the plan, over one interval.

    Its parameters are the initial state, the length of the interval, the gains of the joints, their planned
    positions at its start, and the drive, joint rates and accelerations at each of its points. Time is a
    fraction of the interval, so that one loop serves intervals of all lengths.
    """
    model, driven = stage.scene.model, stage.driven
    nx, nu = model.nq + model.nv, len(driven.columns)
    joints, points = len(driven.joints), lobatto.points
    count = 1 + 3 * joints + (nu + 2 * joints) * points
    t, x, parameters = ca.SX.sym("t"), ca.SX.sym("x", nx), ca.SX.sym("c", count)
    q, v = x[: model.nq], x[model.nq :]
    sizes = [1, joints, joints, joints, points * nu, points * joints, points * joints]
    length, kp, kd, first, *rest = ca.vertsplit(parameters, np.cumsum([0, *sizes]).tolist())
    drive, rates, accelerations = (ca.reshape(part, part.numel() // points, points) for part in rest)
    place = t
    torque = _summed(lobatto.basis, place, drive)
    target = first + length * _summed(lobatto.primitives, place, rates)
    rate = rates[:, 0] + length * _summed(lobatto.primitives, place, accelerations)
    force = -sparse(np.asarray(model.damping)) * v - spring_forces(stage.scene, q)
    for k, column in enumerate(driven.columns):
        force[column] += torque[k]
    for k, joint in enumerate(driven.joints):
        column = driven.columns[k]
        # how far it is behind [rad or m], the short way round if it is unbounded
        joint_model, near = model.joints[joint], q[model.joints[joint].idx_q]
        behind = target[k] - near
        if joint_model.nq == 2:
            c, s, other = ca.cos(target[k]), ca.sin(target[k]), q[joint_model.idx_q + 1]
            behind = ca.atan2(s * near - c * other, c * near + s * other)
        force[column] += kp[k] * behind + kd[k] * (rate[k] - v[column])
    if stage.environment is not None:
        force = force + stage.environment(q, v)
    # forward dynamics with the grasps that hold
    moving = forward_kinematics(model, q, v)
    for spring in stage.springs:
        wrench = ca.vertcat(*spring_wrench(stage.scene, moving, spring))
        force = force + ca.jtimes(tip_slip(stage.scene, moving, [spring]), v, wrench, True)
    body = ArticulatedBody.factorise(model, moving, Inertias.from_model(model))
    acceleration = free = body.acceleration(force)
    if stage.grips:
        parting = tip_slip(stage.scene, moving, stage.grips)
        slopes = ca.jacobian(parting, v)
        drift = ca.jtimes(parting, q, configuration_derivative(model, q, v))
        response = ca.horzcat(*(body.response(row.T) for row in ca.vertsplit(slopes)))
        factors = SymmetricFactors(ca.mtimes(slopes, response))
        wrench = factors.solve_negated(ca.mtimes(slopes, free) + drift)
        acceleration = free + ca.mtimes(response, wrench)
    change = ca.vertcat(configuration_derivative(model, q, v), acceleration)
    p, none = ca.SX.sym("p", nx + parameters.numel()), ca.SX(0, 1)
    names = tuple(f"p{i}" for i in range(p.numel()))
    xdot, e = ca.SX.sym("xdot", nx), ca.SX.sym("e")
    at, at_names = [t, x, parameters], ["t", "x", "c"]
    return DerivedLoop(
        parameter_paths=names,
        parameter_values=np.ones(p.numel()),
        state_names=tuple(f"x{i}" for i in range(nx)),
        nq=model.nq,
        nv=model.nv,
        setup=ca.Function("setup", [p], [p[:nx], p[nx:]], ["p"], ["x0", "c"]),
        dynamics=ca.Function("dynamics", at, [ca.densify(length * change)], at_names, ["xdot"]),
        normalise=ca.Function("normalise", [x], [ca.vertcat(normalise(model, q), v)], ["x"], ["n"]),
        outputs=ca.Function("outputs", at, [v], at_names, ["velocity"]),
        gaps=ca.Function("gaps", [p], [none], ["p"], ["gap"]),
        guards=ca.Function("guards", [*at, xdot], [none] * 3, [*at_names, "xdot"], ["g", "rate", "speed"]),
        update=ca.Function("update", [*at, e], [x], [*at_names, "e"], ["x_after"]),
        rows=ca.Function("rows", at, [none], at_names, ["row"]),
    )


def replay_motion(
    motion: Motion, backend: str = "auto", starts: tuple[Array, Array] | None = None
) -> tuple[Array, Array]:
    """States (intervals + 1, nq + nv) at the knots when a plan's drive acts without feedback, and with it.

    Args:
        motion: The plan.
        backend: ``auto``, ``compiled`` or ``interpreted``.
        starts: States (nq + nv,) to begin with, of the one and of the other; the plan's own if not given.
    """
    driven = motion.problem.stage.driven
    robots = [name.partition("/")[0] for name in driven.names[: len(driven.joints)]]
    gains = {name: tracking_gains(motion, name) for name in dict.fromkeys(robots)}
    feedback = np.array([[gains[robot][key] for robot in robots] for key in ("kp", "kd")]).ravel()
    if starts is None:
        starts = (np.concatenate([motion.q[0], motion.v[0]]),) * 2
    step, replays = steps_of(motion, backend), []
    for start, applied_gains in zip(starts, (0 * feedback, feedback), strict=True):
        states = [start]
        for n in range(motion.intervals):
            states.append(step(n, states[-1], applied_gains))
        replays.append(np.array(states))
    return replays[0], replays[1]


def steps_of(motion: Motion, backend: str = "auto") -> Callable[[int, Array, Array], Array]:
    """Function that integrates one interval of a plan by an integrator of rollouts.

    Published URDFs have joints of 1 N m s/rad that move 4e-6 kg m^2, so that a rate decays at 250 000 1/s. An
    explicit method would need millions of steps for a motion of a minute. From :data:`STIFF` on, Radau's
    method of order 5 (Hairer and Wanner, Solving Ordinary Differential Equations II) integrates instead. It
    is stable for every step, so that its error estimate alone determines the steps.

    The function's arguments are the index of the interval, the state (nq + nv,) at its start, and the gains
    ``kp`` and ``kd`` of all joints (2 joints,). It returns the state at the end.

    Args:
        motion: The plan.
        backend: ``auto``, ``compiled`` or ``interpreted``.
    """
    lengths = motion.duration_s * motion.mesh.widths
    rates: dict[bytes, float] = {}  # by gains

    def step(n: int, state: Array, gains: Array) -> Array:
        """State at the end of an interval."""
        key = gains.tobytes()
        if key not in rates:
            rates[key] = fastest_rate(motion, gains)
        # joint positions where an interval begins; drive, joint rates and accelerations at its points
        driven, model = motion.problem.stage.driven, motion.problem.stage.scene.model
        rows = slice(n * (motion.lobatto.points - 1), (n + 1) * (motion.lobatto.points - 1) + 1)
        columns = list(driven.columns[: len(driven.joints)])
        q, v, a, u, _ = (part[rows] for part in motion.parts(motion.z))
        first = [joint_angle(model.joints[joint], q[0]) for joint in driven.joints]
        interval = np.concatenate([first, u.ravel(), v[:, columns].ravel(), a[:, columns].ravel()])
        parameters = np.concatenate([[lengths[n]], gains, interval])
        if rates[key] > STIFF:
            return _implicit(motion.problem.stage, motion.lobatto, state, parameters)
        steps = max(4, math.ceil(lengths[n] * max(1 / LONGEST_STEP, rates[key] / STABLE)))
        rollout = _rollout(motion.problem.stage, motion.lobatto, steps, backend)
        return np.array(rollout.run(np.concatenate([state, parameters])).state[-1])

    return step


def fastest_rate(motion: Motion, gains: Array) -> float:
    """Fastest rate at which joint rates decay along a plan [1/s], at its start, middle and end.

    Light wrists with the damping of published URDFs have rates of thousands per second, which limit the step
    of explicit methods long after the motion itself would.

    Args:
        motion: The plan.
        gains: ``kp`` and ``kd`` of all joints (2 joints,).

    Returns:
        float: Largest eigenvalue of M^-1 D, D being the joints' damping and ``kd``, to two figures: the
            number of steps must not follow its last bits.
    """
    stage = motion.problem.stage
    model, joints = stage.scene.model, len(stage.driven.joints)
    damping = np.array(model.damping, dtype=float)
    damping[list(stage.driven.columns[:joints])] += gains[joints:]
    data, fastest = model.createData(), 0.0
    for row in (0, len(motion.q) // 2, len(motion.q) - 1):
        mobility = np.triu(pin.computeMinverse(model, data, np.array(motion.q[row])))
        mobility += np.triu(mobility, 1).T
        # D^1/2 M^-1 D^1/2 is symmetric and has the eigenvalues of M^-1 D
        root = np.sqrt(damping)
        fastest = max(fastest, float(np.linalg.eigvalsh(root[:, None] * mobility * root)[-1]))
    return float(f"{fastest:.2g}")


@functools.lru_cache(maxsize=8)
def _rollout(stage: Stage, lobatto: Lobatto, steps: int, backend: str) -> Rollout:
    """Rollout over an interval; all meshes and all segments of a plan share it."""
    return build_rollout(
        _loop(stage, lobatto),
        duration_s=1.0,
        step_s=1 / steps,
        output_step_s=1.0,
        backend=backend,  # type: ignore[arg-type]
    )


@functools.lru_cache(maxsize=4)
def _rate_functions(stage: Stage, lobatto: Lobatto) -> tuple[NumericFunction, NumericFunction]:
    """Rate of the state over an interval, and its derivative by the state."""
    dynamics = _loop(stage, lobatto).dynamics
    t, x, c = (ca.SX.sym(dynamics.name_in(i), dynamics.numel_in(i)) for i in range(3))
    rate = dynamics(t, x, c)
    derivative = ca.densify(ca.jacobian(rate, x))
    return NumericFunction(ca.Function("rate", [t, x, c], [rate])), NumericFunction(
        ca.Function("derivative", [t, x, c], [derivative])
    )


def _implicit(stage: Stage, lobatto: Lobatto, state: Array, parameters: Array) -> Array:
    """State at the end of an interval, by Radau's method."""
    rate, derivative = _rate_functions(stage, lobatto)
    solution = solve_ivp(
        lambda t, x: rate(t, x, parameters)[0],
        (0.0, 1.0),
        state,
        method="Radau",
        jac=lambda t, x: derivative(t, x, parameters)[0],
        rtol=ERROR,
        atol=ERROR,
    )
    # a failure is a state off the plan, which the verification refuses
    end = solution.y[:, -1] if solution.success else np.full(state.size, np.nan)
    return np.asarray(_loop(stage, lobatto).normalise(end).full()).ravel()


def joint_angle(joint: Any, q: Array) -> float:
    """Position of a joint of one degree of freedom [rad or m]; between minus and plus pi if unbounded."""
    at = joint.idx_q
    return float(np.arctan2(q[at + 1], q[at]) if joint.nq == 2 else q[at])


def tip_errors(motion: Motion, states: Array) -> Mapping[str, Array]:
    """Distance [m] of each planned robot's tips from the plan at each knot (intervals + 1,).

    The error of a robot without tips or joints, and of a held object, is that of its root link, with a
    rotation of 1 rad counted as 1 m, because a tip at the centre of mass does not show the rotation. Joints
    of flexible links have entries too, also with 1 rad as 1 m, because a link that swings against the driven
    joint before it hardly moves the tip.
    """
    scene = motion.problem.stage.scene
    model, data = scene.model, scene.model.createData()
    knots = motion.q[:: motion.lobatto.points - 1]
    led = {tip.body.name for tip in scene.tips if tip.body.driven_joints}
    tips = {tip.label: tip.frame for tip in scene.tips}
    bodies = scene.bodies if motion.problem.stage.grips else scene.robots
    roots = {body.name: body.root_frame for body in bodies if body.name not in led}
    bending = {model.names[joint]: model.joints[joint] for body in bodies for joint in body.passive}
    errors: dict[str, list[float]] = {label: [] for label in (*tips, *roots, *bending)}
    for planned, replayed_q in zip(knots, states[:, : model.nq], strict=True):
        placements = []
        for q in (planned, replayed_q):
            pin.framesForwardKinematics(model, data, np.array(q))
            placements.append({label: data.oMf[frame].copy() for label, frame in (tips | roots).items()})
        for label, joint in bending.items():
            errors[label].append(abs(joint_angle(joint, planned) - joint_angle(joint, replayed_q)))
        for label in (*tips, *roots):
            one, other = (placed[label] for placed in placements)
            turned = pin.log3(one.rotation.T @ other.rotation) if label in roots else np.zeros(3)
            error = np.linalg.norm(one.translation - other.translation) + np.linalg.norm(turned)
            errors[label].append(float(error))
    return {label: np.array(values) for label, values in errors.items()}


def _summed(polynomials: Sequence[Array], place: ca.SX, values: ca.SX) -> ca.SX:
    """Sum (n x 1) of the columns of values (n x s), each times its polynomial at ``place`` in 0 .. 1.

    The coefficients of a polynomial begin with the constant one.
    """
    total = ca.SX(values.size1(), 1)
    for k, row in enumerate(polynomials):
        weight = ca.SX(0)
        for coefficient in row[::-1]:
            weight = weight * place + coefficient
        total = total + weight * values[:, k]
    return total
