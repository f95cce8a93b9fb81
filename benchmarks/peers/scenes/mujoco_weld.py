"""The paper's robots hold the rectangle: a closed chain, which constant joint torques move from rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.peers.compare import Job, Outcome, PeerScene, Side, compare
from benchmarks.peers.scenes.mujoco_plant import our_plant
from spacerobot.common.arrays import Array
from spacerobot.elements import load_plugin
from spacerobot.exports.mjcf_bodies import coordinates, mjcf, pose
from spacerobot.scene import Scene, load_scene

DURATION, TOLERANCE = 4.0, 1e-5
TORQUES = (0.6, -0.4, 0.5, -0.3, 0.4, -0.5, 0.3, -0.6)
GRASPS = (("left", "rpr1", "mate_1"), ("right", "rpr2", "mate_2"))
TITLE = "the paper's closed chain, rigid, constant joint torques, 4 s"


def held() -> Scene:
    """Both grasps rigid; no control."""
    drive = {"kind": "constant_torques", "torques": TORQUES}
    load_plugin(Path(__file__).parents[1] / "open_loop.py")
    grasps = {name: {"tip": f"{robot}/tip", "frame": frame, "kind": "weld"} for name, robot, frame in GRASPS}
    return load_scene(
        "paper",
        {
            "grasps": grasps,
            "robots.*.tips": {"tip": {}},
            "robots.*.controllers": {"drive": drive},
            "simulation.duration": DURATION,
        },
    )


def measure() -> Outcome:
    """MuJoCo's weld is a stiff spring and damper, here of two steps' time constant."""
    import mujoco

    scene = held()
    sites: dict[int, str] = {}
    welds = ""
    for grasp in scene.grasps:
        ends = [scene.model.frames[frame] for frame in (grasp.tip.frame, grasp.frame)]
        for end in ends:
            sites[end.parentJoint] = (
                sites.get(end.parentJoint, "") + f'<site name="{end.name}" {pose(end.placement)}/>'
            )
        first, second = ends
        welds += f'<weld site1="{first.name}" site2="{second.name}" solimp="0.9999 0.9999 0.001"/>'
    option = (
        '<option integrator="RK4" solver="Newton" tolerance="1e-14" iterations="50">'
        '<flag contact="disable" gravity="disable"/></option>'
    )
    model = mujoco.MjModel.from_xml_string(
        mjcf(scene, more=f"{option}<equality>{welds}</equality>", inside=sites)
    )
    columns = [model.joint(scene.model.names[j]).dofadr[0] for body in scene.robots for j in body.joints]

    def ready(level: int) -> Job:
        data, step = mujoco.MjData(model), 0.02 / 2**level
        data.qpos[:], data.qvel[:] = coordinates(scene, scene.q, scene.v)
        data.qfrc_applied[columns] = TORQUES * len(scene.robots)

        def run() -> Array:
            model.opt.timestep = step
            model.eq_solref[:] = 2 * step, 1
            mujoco.mj_step(model, data, nstep=round(DURATION / step))
            return np.concatenate([data.qpos, data.qvel])

        return run

    theirs = Side(ready, lambda level: f"RK4, {20 / 2**level:g} ms, solref of two steps")
    return compare(our_plant(scene, 0.08), theirs, TOLERANCE)


SCENE = PeerScene("MuJoCo", "mujoco", TITLE, "its weld is a spring and damper, ours a constraint", measure)
