"""A rigid hub that eight thrusters push in pulses: Basilisk's ``thrusterDynamicEffector``."""

from __future__ import annotations

import numpy as np

import spacerobot as sr
from benchmarks.peers.basilisk import BasiliskModel, basilisk_side, hub_state, our_hub, rigid_hub, spacecraft
from benchmarks.peers.compare import Outcome, PeerScene, compare

DURATION, TOLERANCE, THRUST = 16.0, 1e-7, 3.0
ARMS = ((0.6, 0.9, 0.5), (0.6, -0.9, -0.5), (-0.6, 0.9, -0.5), (-0.6, -0.9, 0.5))
NOZZLES = {
    f"{way}{i}": {"position": list(arm), "direction": (-np.sign(arm) * np.array(along)).tolist()}
    for i, arm in enumerate(ARMS)
    for way, along in (("x", (1, 0, 0)), ("z", (0, 0, 1)))
}
JETS = {"mode": "pulsed", "thrust": THRUST, "period": DURATION, "resolution": 0.05, "specific_impulse": 220}
PULSED: dict[str, object] = {
    "robots.servicer.controllers": {"spin": {"kind": "base_attitude", "kd": 60, "feed_forward": 0}},
    "robots.servicer.actuators": {"jets": {"kind": "thrusters", "nozzles": NOZZLES} | JETS},
}


def measure() -> Outcome:
    """One command at the start; Basilisk takes the on-times that ours has decided."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import thrusterDynamicEffector

    scene = rigid_hub(PULSED, DURATION)
    memory = sr.simulate(scene).data.z.sel(time=DURATION / 2, method="nearest")
    # Less by 1e-12 s, so that a pulse ends with its last step and does not act on the next one's first stage:
    # Basilisk allows a remaining time of -1e-9 times what of the step has passed.
    ends = [float(memory.sel(controller=f"servicer/jets.off_at[{i}]")) for i in range(len(NOZZLES))]
    times = [end - 1e-12 for end in ends]

    def build() -> BasiliskModel:
        body, jets = spacecraft(scene), thrusterDynamicEffector.ThrusterDynamicEffector()
        for nozzle in NOZZLES.values():
            one = thrusterDynamicEffector.THRSimConfig()
            one.thrLoc_B = [[x] for x in nozzle["position"]]
            one.thrDir_B = [[x] for x in nozzle["direction"]]
            one.MaxThrust, one.updateOnly = THRUST, True  # without the exhaust's damping of the spin
            jets.addThruster(one)
        message, payload = messaging.THRArrayOnTimeCmdMsg(), messaging.THRArrayOnTimeCmdMsgPayload()
        payload.OnTimeRequest = times
        message.write(payload)
        jets.cmdsInMsg.subscribeTo(message)
        body.addDynamicEffector(jets)
        return BasiliskModel(body, lambda: hub_state(body), after=(jets,), references=(message,))

    outcome = compare(our_hub(scene, 0.8), basilisk_side(build, 0.8, DURATION), TOLERANCE)
    outcome.numbers["on_times_s"] = times
    return outcome


SCENE = PeerScene(
    "Basilisk",
    "bsk",
    "hub with eight pulsed thrusters, 16 s",
    "`thrusterDynamicEffector`; its step must divide the pulses",
    measure,
)
