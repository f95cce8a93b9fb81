"""Common functions of scenes with Basilisk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.peers.compare import Job, Side, our_side
from spacerobot.common.arrays import Array
from spacerobot.elements import load_plugin
from spacerobot.scene import Scene, load_scene


def driven(torque: tuple[float, float, float]) -> dict[str, object]:
    """Four wheels of the servicer and a constant torque on its base that they deliver [N m]."""
    load_plugin(Path(__file__).with_name("open_loop.py"))
    wheels = {"kind": "reaction_wheels", "pyramid": {"wheels": 4, "tilt_deg": 35.26}, "inertia": 0.08}
    return {
        "robots.servicer.controllers": {"push": {"kind": "constant_base_torque", "torque": torque}},
        "robots.servicer.actuators": {"wheels": wheels | {"speeds": [100, -100, 100, -100]}},
    }


@dataclass(frozen=True)
class Built:
    """A dynamic object, its final state, modules after it, what has to be kept, how it starts."""

    body: Any
    state: Callable[[], Array]
    after: tuple[Any, ...] = ()
    kept: tuple[Any, ...] = ()
    start: Callable[[], None] = lambda: None


def basilisk_side(build: Callable[[], Built], step_s: float, duration_s: float) -> Side:
    """A simulation by Basilisk's RK4, one task whose period is the step; built once for each run."""
    from Basilisk.simulation import svIntegrators
    from Basilisk.utilities import SimulationBaseClass, macros

    def ready(level: int) -> Job:
        simulation = SimulationBaseClass.SimBaseClass()
        task = simulation.CreateNewTask("task", macros.sec2nano(step_s / 2**level))
        simulation.CreateNewProcess("process").addTask(task)
        built = build()
        built.body.setIntegrator(svIntegrators.svIntegratorRK4(built.body))
        for model in (built.body, *built.after):
            simulation.AddModelToTask("task", model)
        simulation.InitializeSimulation()
        built.start()
        simulation.ConfigureStopTime(macros.sec2nano(duration_s))

        def run() -> Array:
            simulation.ExecuteSimulation()
            return built.state()

        return run

    return Side(ready, lambda level: f"RK4, {step_s / 2**level * 1e3:g} ms")


def rigid_hub(changes: dict[str, object], duration_s: float) -> Scene:
    """The servicer with all joints locked, turning at first, and a satellite far away."""
    joints = {f"{side}_joint_{k}": {"locked": True} for side in ("left", "right") for k in range(1, 8)}
    base = {"joint": "free_flyer", "spin_deg": [2.0, -1.0, 1.5]}
    target = {"urdf": "satellite_box.urdf", "base": {"joint": "free_flyer", "position": [9.0, 0.0, 0.0]}}
    return load_scene(
        "servicer",
        {
            "grasps": {},
            "target": target,
            "robots.servicer.tips": {},
            "robots.servicer.base": base,
            "robots.servicer.joints": joints,
            "simulation.duration": duration_s,
        }
        | changes,
    )


def spacecraft(scene: Scene, more: Array | float = 0.0) -> Any:
    """Basilisk's hub with the inertia, more added, and the motion of the scene's first body."""
    from Basilisk.simulation import spacecraft as module

    body, inertia = module.Spacecraft(), scene.model.inertias[1]
    body.hub.mHub = inertia.mass
    body.hub.r_BcB_B = inertia.lever.tolist()
    body.hub.IHubPntBc_B = (inertia.inertia + more).tolist()
    turned = pin.Quaternion(scene.q[3:7])
    body.hub.r_CN_NInit = (scene.q[:3] + turned * inertia.lever).tolist()
    body.hub.v_CN_NInit = (turned * (scene.v[:3] + np.cross(scene.v[3:6], inertia.lever))).tolist()
    body.hub.sigma_BNInit = (turned.vec() / (1 + turned.w)).tolist()
    body.hub.omega_BN_BInit = scene.v[3:6].tolist()
    return body


def hub_state(body: Any, speeds: Sequence[float] = ()) -> Array:
    """Position, velocity, attitude matrix and spin of the hub, and the speeds of its wheels."""
    found = body.scStateOutMsg.read()
    s = np.array(found.sigma_BN)
    attitude = pin.Quaternion(*np.r_[1 - s @ s, 2 * s] / (1 + s @ s)).toRotationMatrix()
    return np.concatenate([found.r_BN_N, found.v_BN_N, attitude.ravel(), found.omega_BN_B, speeds])


def our_hub(scene: Scene, step_s: float, speeds: Callable[[Array], Array] | None = None) -> Side:
    """Ours, in the same quantities."""
    nq = scene.model.nq

    def state(x: Array) -> Array:
        turned, v = pin.Quaternion(x[3:7]).toRotationMatrix(), x[nq : nq + 6]
        last = [] if speeds is None else speeds(x)
        return np.concatenate([x[:3], turned @ v[:3], turned.ravel(), v[3:], last])

    return our_side(scene, step_s, state)
