"""Plans made by hand: smooth joint motions from rest to rest and the base as it reacts, by Pinocchio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import xarray as xr

from spacerobot.scene import Scene

STEPS = 8  # between two knots
AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def smooth(t: float, duration: float) -> tuple[float, float, float]:
    """From 0 to 1 with neither rate nor acceleration at both ends, with its first two derivatives."""
    u = t / duration
    return (
        u**3 * (10 - 15 * u + 6 * u * u),
        30 * (u * (1 - u)) ** 2 / duration,
        60 * u * (1 - u) * (1 - 2 * u) / duration**2,
    )


def plan_of(scene: Scene, turns: dict[str, float], duration: float, knots: int) -> xr.Dataset:
    """Plan that turns joints (``robot/joint``) [rad] of a scene at rest; damping is made up for."""
    model, state = scene.model, (np.array(scene.q), np.zeros(scene.model.nv))
    driven = {
        f"{b.name}/{b.joint_name(model, j)}": model.idx_vs[j] for b in scene.robots for j in b.free_joints
    }
    free = [i for i in range(model.nv) if i not in driven.values()]
    damping = np.zeros(model.nv)
    for body in scene.robots:
        for j in body.free_joints:
            damping[model.idx_vs[j]] = body.config.joints[body.joint_name(model, j)].damping

    def acceleration(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        a = np.zeros(model.nv)
        for label, turn in turns.items():
            a[driven[label]] = turn * smooth(t, duration)[2]
        inertia, bias = pin.crba(model, model.createData(), q), pin.nle(model, model.createData(), q, v)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        if free:
            a[free] = np.linalg.solve(inertia[np.ix_(free, free)], -(inertia @ a + bias)[free])
        return a

    def step(t: float, h: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k1 = acceleration(t, q, v)
        q2 = pin.integrate(model, q, h / 2 * v)
        k2 = acceleration(t + h / 2, q2, v + h / 2 * k1)
        q3 = pin.integrate(model, q, h / 2 * v + h * h / 4 * k1)
        k3 = acceleration(t + h / 2, q3, v + h / 2 * k2)
        k4 = acceleration(t + h, pin.integrate(model, q, h * v + h * h / 2 * k2), v + h * k3)
        return pin.integrate(model, q, h * v + h * h / 6 * (k1 + k2 + k3)), v + h / 6 * (
            k1 + 2 * k2 + 2 * k3 + k4
        )

    times, rows = np.linspace(0, duration, knots), []
    h = times[1] / STEPS
    for k, t in enumerate(times):
        q, v = state
        effort = pin.rnea(model, model.createData(), q, v, acceleration(t, q, v)) + damping * v
        rows.append((q, v, effort))
        for i in range(STEPS if k < knots - 1 else 0):
            state = step(t + i * h, h, *state)
    return dataset(scene, times, driven, rows)


def dataset(scene: Scene, times: np.ndarray, driven: dict[str, int], rows: list) -> xr.Dataset:
    """What a plan's file holds for those who follow it."""
    model, data = scene.model, scene.model.createData()
    places = {int(joint.idx_v): joint for joint in model.joints[1:] if joint.nv == 1}

    def position(joint: pin.JointModel, q: np.ndarray) -> float:
        own = q[joint.idx_q : joint.idx_q + joint.nq]
        return own[0] if joint.nq == 1 else np.arctan2(own[1], own[0])

    tips = {name: [] for name in ("tip_position", "tip_velocity", "tip_rotation", "tip_spin")}
    for q, v, _ in rows:
        pin.forwardKinematics(model, data, q, v)
        pin.updateFramePlacements(model, data)
        motions = [pin.getFrameVelocity(model, data, tip.frame, AXES) for tip in scene.tips]
        places_now = [data.oMf[tip.frame] for tip in scene.tips]
        tips["tip_position"].append([place.translation.copy() for place in places_now])
        tips["tip_velocity"].append([motion.linear.copy() for motion in motions])
        tips["tip_rotation"].append([pin.log3(place.rotation) for place in places_now])
        tips["tip_spin"].append([motion.angular.copy() for motion in motions])
    joints = {
        "joint_position": np.unwrap(
            [[position(places[i], q) for i in driven.values()] for q, _, _ in rows], axis=0
        ),
        "joint_rate": np.array([v[list(driven.values())] for _, v, _ in rows]),
        "torque": np.array([effort[list(driven.values())] for _, _, effort in rows]),
    }
    variables = {name: (("time", "joint"), values) for name, values in joints.items()}
    variables |= {name: (("time", "tip", "axis"), np.array(values)) for name, values in tips.items()}
    coordinates = {
        "time": times,
        "joint": list(driven),
        "tip": [tip.label for tip in scene.tips],
        "axis": list("xyz"),
    }
    return xr.Dataset(variables, coordinates)


def write_plan(plan: xr.Dataset, file: Path) -> Path:
    """Write a plan's file."""
    plan.to_netcdf(file, engine="netcdf4")
    return file
