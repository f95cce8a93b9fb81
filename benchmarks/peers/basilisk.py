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
    """Changes: four wheels of the servicer, which deliver a constant torque on its base [N m]."""
    load_plugin(Path(__file__).with_name("open_loop.py"))
    wheels = {"kind": "reaction_wheels", "pyramid": {"wheels": 4, "tilt_deg": 35.26}, "inertia": 0.08}
    return {
        "robots.servicer.controllers": {"push": {"kind": "constant_base_torque", "torque": torque}},
        "robots.servicer.actuators": {"wheels": wheels | {"speeds": [100, -100, 100, -100]}},
    }


@dataclass(frozen=True)
class BasiliskModel:
    """Simulation objects.

    Attributes:
        body: Dynamic object.
        state: Function that returns the final state.
        after: Modules that run after the body.
        references: Objects that must not be deleted during the simulation.
        start: Function that is called after the initialisation.
    """

    body: Any
    state: Callable[[], Array]
    after: tuple[Any, ...] = ()
    references: tuple[Any, ...] = ()
    start: Callable[[], None] = lambda: None


def basilisk_side(build: Callable[[], BasiliskModel], step_s: float, duration_s: float) -> Side:
    """Side of Basilisk's RK4 in one task whose period is the step; the simulation is model for each run."""
    from Basilisk.simulation import svIntegrators
    from Basilisk.utilities import SimulationBaseClass, macros

    def ready(level: int) -> Job:
        simulation = SimulationBaseClass.SimBaseClass()
        task = simulation.CreateNewTask("task", macros.sec2nano(step_s / 2**level))
        simulation.CreateNewProcess("process").addTask(task)
        model = build()
        model.body.setIntegrator(svIntegrators.svIntegratorRK4(model.body))
        for module in (model.body, *model.after):
            simulation.AddModelToTask("task", module)
        simulation.InitializeSimulation()
        model.start()
        simulation.ConfigureStopTime(macros.sec2nano(duration_s))

        def run() -> Array:
            simulation.ExecuteSimulation()
            return model.state()

        return run

    return Side(ready, lambda level: f"RK4, {step_s / 2**level * 1e3:g} ms")


def rigid_hub(changes: dict[str, object], duration_s: float) -> Scene:
    """Scene of the rotating servicer with all joints locked, and a distant satellite."""
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
    """Basilisk's hub with the inertia of the scene's first body plus ``more``, and its motion."""
    from Basilisk.simulation import spacecraft as module

    body, inertia = module.Spacecraft(), scene.model.inertias[1]
    body.hub.mHub = inertia.mass
    body.hub.r_BcB_B = inertia.lever.tolist()
    body.hub.IHubPntBc_B = (inertia.inertia + more).tolist()
    rotation = pin.Quaternion(scene.q[3:7])
    body.hub.r_CN_NInit = (scene.q[:3] + rotation * inertia.lever).tolist()
    body.hub.v_CN_NInit = (rotation * (scene.v[:3] + np.cross(scene.v[3:6], inertia.lever))).tolist()
    body.hub.sigma_BNInit = (rotation.vec() / (1 + rotation.w)).tolist()
    body.hub.omega_BN_BInit = scene.v[3:6].tolist()
    return body


def hub_state(body: Any, speeds: Sequence[float] = ()) -> Array:
    """Position, velocity, attitude matrix and spin of the hub, and the speeds of its wheels."""
    message = body.scStateOutMsg.read()
    s = np.array(message.sigma_BN)
    attitude = pin.Quaternion(*np.r_[1 - s @ s, 2 * s] / (1 + s @ s)).toRotationMatrix()
    return np.concatenate([message.r_BN_N, message.v_BN_N, attitude.ravel(), message.omega_BN_B, speeds])


def our_hub(scene: Scene, step_s: float, speeds: Callable[[Array], Array] | None = None) -> Side:
    """Side of our rollout in the same quantities as :func:`hub_state`."""
    nq = scene.model.nq

    def state(x: Array) -> Array:
        rotation, v = pin.Quaternion(x[3:7]).toRotationMatrix(), x[nq : nq + 6]
        last = [] if speeds is None else speeds(x)
        return np.concatenate([x[:3], rotation @ v[:3], rotation.ravel(), v[3:], last])

    return our_side(scene, step_s, state)
