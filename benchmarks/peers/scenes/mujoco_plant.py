"""Two free-floating arms and the object, joints turning: no grasps, no control."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.compare import Job, Outcome, PeerScene, Side, compare, our_side
from spacerobot.common.arrays import Array
from spacerobot.exports.mjcf_bodies import coordinates, mjcf
from spacerobot.scene import Scene, load_scene

DURATION, TOLERANCE = 10.0, 1e-7
RATES_DEG = (40.0, -35.0, 30.0, -25.0, 25.0, -30.0, 35.0, -40.0)
FLAGS = '<flag contact="disable" constraint="disable" gravity="disable"/>'


def passive() -> Scene:
    """The paper's robots apart from each other and from the object."""
    changes: dict[str, object] = {
        "grasps": {},
        "target.base": {"joint": "planar", "position": [0.9, 2.5, 0.0], "spin_deg": [0.0, 0.0, 20.0]},
        "robots.rpr2.base": {
            "joint": "planar",
            "rotation_deg": [0.0, 0.0, 180.0],
            "position": [4.0, 0.0, 0.0],
        },
        "robots.*.tips": {},
        "simulation.duration": DURATION,
    }
    for i, rate in enumerate(RATES_DEG):
        changes[f"robots.*.joints.joint_{i + 1}.rate_deg"] = rate
    return load_scene("paper", changes)


def our_plant(scene: Scene, step_s: float) -> Side:
    """Ours, with the final state in MuJoCo's coordinates."""
    nq, nv = scene.model.nq, scene.model.nv

    def state(x: Array) -> Array:
        return np.concatenate(coordinates(scene, x[:nq], x[nq : nq + nv]))

    return our_side(scene, step_s, state)


def measure() -> Outcome:
    """MuJoCo steps natively by RK4."""
    import mujoco

    scene = passive()
    option = f'<option integrator="RK4">{FLAGS}</option>'
    model = mujoco.MjModel.from_xml_string(mjcf(scene, more=option))

    return compare(our_plant(scene, 0.08), their_plant(scene, model, 20, DURATION), TOLERANCE)


def their_plant(scene: Scene, model: Any, step_ms: float, duration_s: float) -> Side:
    """MuJoCo's side: a model simulated from where a scene begins, in steps that are halved level by level."""
    import mujoco

    def ready(level: int) -> Job:
        data, step = mujoco.MjData(model), step_ms / 1e3 / 2**level
        data.qpos[:], data.qvel[:] = coordinates(scene, scene.q, scene.v)

        def run() -> Array:
            model.opt.timestep = step
            mujoco.mj_step(model, data, nstep=round(duration_s / step))
            return np.concatenate([data.qpos, data.qvel])

        return run

    return Side(ready, lambda level: f"RK4, {step_ms / 2**level:g} ms")


TITLE = "two free-floating arms of eight links, an object, joint damping, 10 s"
SCENE = PeerScene("MuJoCo", "mujoco", TITLE, "", measure)
