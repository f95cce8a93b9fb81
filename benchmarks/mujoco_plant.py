"""The passive plant (no grips, no control) against MuJoCo stepping it natively, at equal accuracy."""

from __future__ import annotations

import numpy as np

from benchmarks.row import Row
from benchmarks.timing import paired
from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import build_rollout
from spacerobot.scene import Scene, load_scene

DURATION, STEP, FINE = 10.0, 0.002, 0.0002
RATES_DEG = (40.0, -35.0, 30.0, -25.0, 25.0, -30.0, 35.0, -40.0)


def row() -> Row:
    """Two free-floating arms and the object, joints turning, RK4 at the same step in both."""
    import mujoco

    changes: dict[str, object] = {
        "grasps": {},
        "target.base": {"joint": "planar", "position": [0.9, 2.5, 0.0], "spin_deg": [0.0, 0.0, 20.0]},
        "robots.rpr2.base": {
            "joint": "planar",
            "rotation_deg": [0.0, 0.0, 180.0],
            "position": [4.0, 0.0, 0.0],
        },
        "robots.*.tips": {},
    }
    for i, rate in enumerate(RATES_DEG):
        changes[f"robots.*.joints.joint_{i + 1}.rate_deg"] = rate
    scene = load_scene("paper", changes)
    loop = build_closed_loop(scene)
    model = mujoco.MjModel.from_xml_string(_mjcf(scene))
    steps = round(DURATION / STEP)

    def native(step: float) -> np.ndarray:
        data = mujoco.MjData(model)
        model.opt.timestep = step
        data.qpos[:], data.qvel[:] = _to_mujoco(scene, scene.q, scene.v)
        mujoco.mj_step(model, data, nstep=round(DURATION / step))
        return np.concatenate([data.qpos, data.qvel])

    def rollout(step: float) -> object:
        return build_rollout(loop, duration_s=DURATION, step_s=step, output_step_s=DURATION, method="rk4")

    exact = native(FINE)
    ours = rollout(STEP)
    final = ours.run().state[-1]
    nq, nv = scene.model.nq, scene.model.nv
    found = np.concatenate(_to_mujoco(scene, final[:nq], final[nq : nq + nv]))
    found[:nv] = _unwrap_like(found[:nv], exact[:nv])
    errors = float(np.abs(found - exact).max()), float(np.abs(native(STEP) - exact).max())
    times = paired(ours.run, lambda: native(STEP))
    return Row(
        "passive plant, 10 s, compiled",
        f"MuJoCo {mujoco.__version__}, native RK4",
        f"{times.first_s * 1e3:.1f} ms",
        f"{times.second_s * 1e3:.1f} ms",
        times.ratio,
        "ahead",
        times.ratio > 1 and errors[0] <= 2 * errors[1] + 1e-9,
        f"both RK4, {steps} steps; errors {errors[0]:.0e} and {errors[1]:.0e}",
        {"state_errors": errors},
    )


def _mjcf(scene: Scene) -> str:
    """The scene's bodies as MuJoCo's own description."""
    model = scene.model
    children: dict[int, list[int]] = {}
    for joint in range(1, model.njoints):
        children.setdefault(int(model.parents[joint]), []).append(joint)

    def numbers(values: object) -> str:
        return " ".join(f"{x:.17g}" for x in np.ravel(values))

    def body(joint: int) -> str:
        inertia, placement = model.inertias[joint], model.jointPlacements[joint]
        about = inertia.inertia
        full = [about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2]]
        name = model.names[joint]
        if model.nvs[joint] == 3:
            joints = "".join(
                f'<joint name="{name}.{axis}" type="{kind}" axis="{direction}"/>'
                for axis, kind, direction in (
                    ("x", "slide", "1 0 0"),
                    ("y", "slide", "0 1 0"),
                    ("r", "hinge", "0 0 1"),
                )
            )
        else:
            damping = model.damping[model.idx_vs[joint]]
            joints = f'<joint name="{name}" type="hinge" axis="0 0 1" damping="{damping:.17g}"/>'
        inner = "".join(body(child) for child in children.get(joint, []))
        return (
            f'<body pos="{numbers(placement.translation)}"><inertial mass="{inertia.mass:.17g}" '
            f'pos="{numbers(inertia.lever)}" fullinertia="{numbers(full)}"/>{joints}{inner}</body>'
        )

    bodies = "".join(body(joint) for joint in children[0])
    flags = '<flag contact="disable" constraint="disable" gravity="disable"/>'
    option = f'<option integrator="RK4" timestep="{STEP}">{flags}</option>'
    return f'<mujoco><compiler angle="radian"/>{option}<worldbody>{bodies}</worldbody></mujoco>'


def _to_mujoco(scene: Scene, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """MuJoCo's coordinates: planar bases as x, y, angle with velocities in world axes."""
    position, velocity = [], []
    for joint in scene.model.joints[1:]:
        i, k = joint.idx_q, joint.idx_v
        if joint.nv == 1:
            position.append(q[i])
            velocity.append(v[k])
        else:
            c, s = q[i + 2], q[i + 3]
            position += [q[i], q[i + 1], np.arctan2(s, c)]
            velocity += [c * v[k] - s * v[k + 1], s * v[k] + c * v[k + 1], v[k + 2]]
    return np.array(position), np.array(velocity)


def _unwrap_like(angles: np.ndarray, like: np.ndarray) -> np.ndarray:
    turns = np.round((like - angles) / (2 * np.pi))
    return angles + 2 * np.pi * turns
