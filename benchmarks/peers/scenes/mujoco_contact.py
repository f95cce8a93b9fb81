"""The ball against the fist once more, by MuJoCo's contact: a spring and a damper of constant restitution."""

from __future__ import annotations

import math

from scipy.optimize import brentq

from benchmarks.peers.compare import Outcome, PeerScene, compare
from benchmarks.peers.scenes.drake_contact import DURATION, STIFFNESS, TITLE, bounce, spheres
from benchmarks.peers.scenes.mujoco_plant import our_plant, their_plant
from spacerobot.exports.mjcf_bodies import mjcf, numbers
from spacerobot.scene import load_scene

TOLERANCE, STIFF = 1e-4, 5000.0  # [1/s^2] about the stiffness of ours over the masses that meet


def damping_ratio(restitution: float) -> float:
    """Of a linear spring and damper that part when their force is zero.

    From m d'' + c d' + k d = 0, d(0) = 0 to m d'' = 0: e = exp(-2 z / s atan(s / z)), s = sqrt(1 - z^2).
    """

    def miss(z: float) -> float:
        s = math.sqrt(1 - z * z)
        return math.exp(-2 * z / s * math.atan(s / z)) - restitution

    return float(brentq(miss, 1e-6, 0.99))


def measure() -> Outcome:
    """Both lose the same part of the speed at which they meet; their forces differ in between."""
    import mujoco

    shipped = load_scene("bounce").scenario.contacts["bump"]
    restitution, speed = shipped.restitution, shipped.restitution_speed
    law = {"stiffness": STIFFNESS, "exponent": 1, "restitution": restitution, "restitution_speed": speed}
    scene = bounce({"kind": "hunt_crossley"} | law)
    solref = f"{-STIFF:.17g} {-2 * damping_ratio(restitution) * math.sqrt(STIFF):.17g}"
    geoms = {
        joint: f'<geom type="sphere" size="{radius}" pos="{numbers(centre)}" condim="1" solref="{solref}" '
        'solimp="0.9999 0.9999 0.001"/>'
        for joint, centre, radius in spheres(scene)
    }
    option = '<option integrator="RK4" tolerance="1e-14" iterations="50"><flag gravity="disable"/></option>'
    model = mujoco.MjModel.from_xml_string(mjcf(scene, more=option, inside=geoms))

    return compare(our_plant(scene, 0.04), their_plant(scene, model, 4, DURATION), TOLERANCE)


SCENE = PeerScene(
    "MuJoCo",
    "mujoco",
    TITLE,
    "another law: a linear spring and damper whose restitution is that of ours at 0.25 m/s",
    measure,
)
