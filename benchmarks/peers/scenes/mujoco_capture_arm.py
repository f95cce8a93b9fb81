"""The capture arm of mjorbit's benchmark: a bus with two links beside a tumbling cube, sinusoidal commands.

The numbers are those of ``benchmarks/capture_arm`` of mjorbit. Left out are what has no counterpart in both
programs: armature (an inertia that takes no part in the motion of the base), the contact of a sphere that
begins 0.16 m inside the cube, and the gravity of the orbit, which MuJoCo has not.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.peers.compare import Job, Outcome, PeerScene, Side, compare
from benchmarks.peers.scenes.mujoco_plant import our_plant
from spacerobot.common.arrays import Array
from spacerobot.elements import load_plugin
from spacerobot.exports.mjcf_bodies import coordinates
from spacerobot.scene import Scene, load_scene

DURATION, TOLERANCE = 10.0, 1e-6
KP, KV, AMPLITUDE, FREQUENCY = (80.0, 60.0), (6.0, 4.0), (0.5, 1.0), (0.5, 0.7)
SPIN = (0.1, 0.05, 0.2)
CHASER = """
<body name="spacecraft">
  <freejoint/>
  <geom type="box" size="0.5 0.3 0.3" mass="200"/>
  <body name="upper" pos="0.5 0 0">
    <joint name="shoulder" axis="0 1 0" damping="0.5"/>
    <geom type="capsule" fromto="0 0 0 0.8 0 0" size="0.04" mass="5"/>
    <body name="fore" pos="0.8 0 0">
      <joint name="elbow" axis="0 1 0" damping="0.5"/>
      <geom type="capsule" fromto="0 0 0 0.6 0 0" size="0.03" mass="3"/>
      <geom type="sphere" pos="0.6 0 0" size="0.08" mass="1"/>
      <site name="hand" pos="0.6 0 0"/>
    </body>
  </body>
</body>"""
CUBE = """
<body name="cube" pos="2 0 0">
  <freejoint/>
  <geom type="box" size="0.18 0.18 0.18" mass="50"/>
</body>"""
HEAD = '<mujoco><compiler angle="radian"/><option gravity="0 0 0" integrator="RK4">'
HEAD += '<flag contact="disable"/></option><worldbody>'


def actuators() -> str:
    """Position actuators of both joints."""
    each = zip(("shoulder", "elbow"), KP, KV, strict=True)
    servos = "".join(f'<position joint="{joint}" kp="{kp}" kv="{kv}"/>' for joint, kp, kv in each)
    return f"<actuator>{servos}</actuator>"


def capture_arm(changes: Mapping[str, object] | None = None) -> Scene:
    """Return ours, its robots read from MJCF, with changes by dotted path."""
    load_plugin(Path(__file__).parents[1] / "open_loop.py")
    with tempfile.TemporaryDirectory() as folder:
        for name, bodies in (("chaser", CHASER), ("cube", CUBE)):
            text = f"{HEAD}{bodies}</worldbody></mujoco>"
            (Path(folder) / f"{name}.xml").write_text(text, encoding="utf-8")
        scenario = Path(folder) / "capture-arm.yaml"
        servo = {"kind": "sine_position", "kp": KP, "kv": KV, "amplitude": AMPLITUDE, "frequency": FREQUENCY}
        numbers = ", ".join(
            f"{key}: {value if key == 'kind' else list(value)}" for key, value in servo.items()
        )
        spin = np.degrees(SPIN).tolist()
        scenario.write_text(
            f"""
name: capture-arm
robots:
  chaser: {{urdf: chaser.xml, base: {{joint: free_flyer}}, controllers: {{servo: {{{numbers}}}}}}}
target: {{urdf: cube.xml, base: {{joint: free_flyer, position: [2, 0, 0], spin_deg: {spin}}}}}
simulation: {{duration: {DURATION}}}
""",
            encoding="utf-8",
        )
        return load_scene(scenario, changes)


def measure() -> Outcome:
    """MuJoCo steps natively by its rollout; commands are those of the middle of each step."""
    import mujoco
    from mujoco import rollout

    scene = capture_arm()
    model = mujoco.MjModel.from_xml_string(f"{HEAD}{CHASER}{CUBE}</worldbody>{actuators()}</mujoco>")

    def ready(level: int) -> Job:
        step = 0.02 / 2**level
        model.opt.timestep, data = step, mujoco.MjData(model)
        position, velocity = coordinates(scene, scene.q, scene.v)
        start = np.concatenate([[0.0], position, velocity])[None, :]
        middles = (np.arange(round(DURATION / step)) + 0.5) * step
        commands = np.array(AMPLITUDE) * np.sin(2 * np.pi * np.outer(middles, FREQUENCY))

        def run() -> Array:
            states, _ = rollout.rollout(model, data, initial_state=start, control=commands[None])
            return np.asarray(states[0, -1, 1:])

        return run

    theirs = Side(ready, lambda level: f"RK4, {20 / 2**level:g} ms, `mujoco.rollout`")
    return compare(our_plant(scene, 0.16), theirs, TOLERANCE)


SCENE = PeerScene(
    "MuJoCo",
    "mujoco",
    "mjorbit's capture arm: bus, two links under position control, tumbling cube, 10 s",
    "without armature, contact and orbit, whose laws differ",
    measure,
)
