"""Two spacecraft joined by an arm: Basilisk's robotic grappling scenario with ``constraintDynamicEffector``.

The numbers are those of ``examples/scenarioRoboticGrappling.py`` on Basilisk's branch
``feature/effector-branching-scenarios``: 750 kg each, arm and levers of 0.1 m, without an orbit. The file
holds the pair from the start, at rest; grappling and berthing are announced in it and not written. Here a
torque on the chaser moves the pair.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.peers.basilisk import hub_state
from benchmarks.peers.compare import Job, Outcome, PeerScene, Side, compare, our_side
from spacerobot.common.arrays import Array
from spacerobot.elements import load_plugin
from spacerobot.scene import Scene, load_scene

DURATION, TOLERANCE = 60.0, 1e-4
MASS, INERTIA, LEVER, ARM = 750.0, (900.0, 800.0, 600.0), 0.1, 0.1
TORQUE = (0.5, 1.5, -1.0)


def vehicle(name: str, site: str, x: float) -> str:
    """MJCF of a spacecraft with the place where it is held on its x axis."""
    inertia = " ".join(map(str, INERTIA))
    return (
        f'<mujoco><worldbody><body name="{name}"><freejoint/><inertial pos="0 0 0" mass="{MASS}" '
        f'diaginertia="{inertia}"/><site name="{site}" pos="{x} 0 0"/></body></worldbody></mujoco>'
    )


def held_pair() -> Scene:
    """Return ours: the chaser's arm ends in a rigid grasp."""
    load_plugin(Path(__file__).parents[1] / "open_loop.py")
    gap = 2 * LEVER + ARM
    with tempfile.TemporaryDirectory() as folder:
        for name, site, x in (("chaser", "hand", LEVER + ARM), ("client", "berth", -LEVER)):
            (Path(folder) / f"{name}.xml").write_text(vehicle(name, site, x), encoding="utf-8")
        scenario = Path(folder) / "grapple.yaml"
        scenario.write_text(
            f"""
name: grapple
robots:
  chaser:
    urdf: chaser.xml
    base: {{joint: free_flyer}}
    tips: {{hand: {{}}}}
    controllers: {{push: {{kind: constant_base_torque, torque: {list(TORQUE)}}}}}
    actuators: {{base: {{kind: base_wrench}}}}
target: {{urdf: client.xml, base: {{joint: free_flyer, position: [{gap}, 0, 0]}}}}
grasps: {{berth: {{tip: chaser/hand, frame: berth, kind: weld}}}}
simulation: {{duration: {DURATION}}}
""",
            encoding="utf-8",
        )
        return load_scene(scenario)


def measure() -> Outcome:
    """Basilisk's gain grows as its step falls, so that its spring and damper become the constraint."""
    from Basilisk.simulation import constraintDynamicEffector, extForceTorque, spacecraft, svIntegrators
    from Basilisk.utilities import SimulationBaseClass, macros

    scene = held_pair()

    def ready(level: int) -> Job:
        step = 0.1 / 2**level
        simulation = SimulationBaseClass.SimBaseClass()
        simulation.CreateNewProcess("process").addTask(
            simulation.CreateNewTask("task", macros.sec2nano(step))
        )
        pair: list[Any] = []
        for x in (0.0, 2 * LEVER + ARM):
            body = spacecraft.Spacecraft()
            body.hub.mHub, body.hub.IHubPntBc_B = MASS, np.diag(INERTIA).tolist()
            body.hub.r_CN_NInit = [x, 0.0, 0.0]
            simulation.AddModelToTask("task", body)
            pair.append(body)
        pair[0].setIntegrator(svIntegrators.svIntegratorRK4(pair[0]))
        pair[0].syncDynamicsIntegration(pair[1])
        arm, push = constraintDynamicEffector.ConstraintDynamicEffector(), extForceTorque.ExtForceTorque()
        arm.setR_P1B1_B1([LEVER, 0.0, 0.0])
        arm.setR_P2B2_B2([-LEVER, 0.0, 0.0])
        arm.setR_P2P1_B1Init([ARM, 0.0, 0.0])
        arm.setAlpha(0.2 / step)
        arm.setBeta(0.2 / step)
        push.extTorquePntB_B = [[x] for x in TORQUE]
        for body in pair:
            body.addDynamicEffector(arm)
        pair[0].addDynamicEffector(push)
        simulation.AddModelToTask("task", arm)
        simulation.AddModelToTask("task", push)
        simulation.InitializeSimulation()
        simulation.ConfigureStopTime(macros.sec2nano(DURATION))

        def run() -> Array:
            simulation.ExecuteSimulation()
            return np.concatenate([hub_state(body) for body in pair])

        return run

    nq = scene.model.nq

    def state(x: Array) -> Array:
        parts = []
        for joint in scene.model.joints[1:]:
            place, rate = x[joint.idx_q :][:7], x[nq + joint.idx_v :][:6]
            rotation = pin.Quaternion(place[3:7]).toRotationMatrix()
            parts += [place[:3], rotation @ rate[:3], rotation.ravel(), rate[3:]]
        return np.concatenate(parts)

    theirs = Side(ready, lambda level: f"RK4, {100 / 2**level:g} ms, gain {2 * 2**level:g} rad/s")
    return compare(our_side(scene, 0.4, state), theirs, TOLERANCE)


SCENE = PeerScene(
    "Basilisk",
    "bsk",
    "robotic grappling: two spacecraft of 750 kg joined by an arm, torque on one, 60 s",
    "held from the start; forces of `constraintDynamicEffector` at the ends of the arm leave out its moment, "
    "angular momentum ends 0.3 % above the largest impulse of the torque; without an arm they differ by 3e-4",
    measure,
)
