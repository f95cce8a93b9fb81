"""Identification of a held object: ``python -m benchmarks.identification``.

Prints the tables of docs/validation/identification.md: errors of the ten parameters over noise draws after
60 s of two motions, with the standard deviations and the errors of unweighted least squares on the same
data; the same for ``examples/excitation.yaml`` with its own motion and the tuned one; and tip errors of
``caught-unknown`` with a known, assumed or identified object, under feed-forward and under model predictive
control.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

import spacerobot as sr
from optim.identification import _held, _Momentum, _named, _regression
from spacerobot.common.arrays import Array

DRAWS = 12
HEAVIER = {"target.links.body.mass": 140, "target.links.body.com": [0.03, -0.01, 0.02]}
AXES = (((25, 0, 0), (0, 0.1, 0.1)), ((0, 25, 0), (0.1, 0, -0.1)), ((0, 0, 25), (-0.1, -0.1, 0)))
HELD = "robots.servicer.estimators.held"
SURE = {f"{HELD}.mass_deviation": 1e-6, f"{HELD}.com_deviation": 1e-7, f"{HELD}.inertia_deviation": 1e-6}
TRUE = {"mass": 140, "com": [0.02, -0.01, 0.02], "inertia": [28.5, 27.1, 24.2, 0.6, -0.4, 0.5]}
LAWS = ("pid", "amnesia", "orientation_pid", "orientation_amnesia")
GOAL_M, GOAL_DEG = np.array([2.0375, 0.51, 0.15]), [-25, 36, -72]
JAM = {"kind": "joint_failure", "joint": "left_joint_3", "mode": "locked", "at": 20}
JAMMED = {
    "robots.servicer.actuators": {"jam": JAM},
    "plan.goals": {"there": {"tip": "servicer/left_tip", "position": GOAL_M.tolist()}},
}
CASES: dict[str, dict[str, Any]] = {
    "known": {f"{HELD}.{key}": value for key, value in TRUE.items()} | SURE,
    "assumed, not identified": SURE,
    "identified": {},
    "no feed-forward": {"robots.servicer.tips.left_tip.controllers.payload.feed_forward": 0},
}


def turning_phases(seconds: float) -> dict[str, Any]:
    """Phases that turn the satellite about one axis after another and back, each in `seconds`."""
    results = {}
    for k in range(round(60 / seconds)):
        axis, sign = k % len(AXES), 1 - 2 * (k // len(AXES) % 2)
        rotation, way = (sign * np.array(vector) for vector in AXES[axis])
        line = {"kind": "line", "displacement": way.tolist(), "rotation_deg": rotation.tolist()}
        section = {"reference": line | {"duration": 0.9 * seconds}}
        results[f"turn_{k}"] = {"target": section, "until": {"time": seconds}}
    return results


# star tracker 29 urad at 4 Hz and gyro 0.316 urad/s^0.5 (the presets' sources), 19-bit encoders and their
# differences over 0.1 s; all as samples at 10 Hz; relative navigation as in SensorNoise()
PUBLISHED = sr.SensorNoise(attitude=4.6e-5, rate=1e-6, joint=3.5e-6, joint_rate=4.9e-5)


def plain(result: sr.Result, seed: int, noise: sr.SensorNoise) -> Array:
    """Mass, centre of mass and inertia by unweighted least squares from the data of the same draw."""
    scene = result.scene()
    momentum = _Momentum(result, scene, *_held(scene), result.array("time") >= 0)
    deviation = np.sqrt(momentum.variances(noise))
    random_numbers = np.random.Generator(np.random.Philox(seed)).normal(
        size=(len(momentum.states), len(deviation))
    )
    states = [
        momentum.moved(x, deviation * each) for x, each in zip(momentum.states, random_numbers, strict=True)
    ]
    return _named(_regression(momentum, states, np.zeros_like(deviation))[0][:10])


def accuracy(what: str, result: sr.Result, noise: sr.SensorNoise | None = None) -> None:
    """Print the errors of identifications from one motion."""
    noise = noise or sr.SensorNoise()
    identifications = [sr.identify(result, noise=noise, seed=seed) for seed in range(DRAWS)]
    truth = identifications[0].truth
    mean = truth[4:7].mean()
    scale = np.array([truth[0], *[np.sqrt(1.5 * mean / truth[0])] * 3, *[mean] * 6])
    errors = 100 * np.array([(one.values - truth) / scale for one in identifications])
    others = 100 * np.array([(plain(result, seed, noise) - truth) / scale for seed in range(DRAWS)])
    percent = 100 * np.array([one.deviations / scale for one in identifications]).mean(axis=0)
    with_all, without = (np.median(np.abs(each)) for each in (errors, others))
    print(f"\n{what}: {with_all:.2f} % median of all, {without:.2f} % by plain least squares\n")
    print("| [%] | median | 95 % | standard deviation | scatter | plain least squares: median |")
    print("|---|---|---|---|---|---|")
    names = ["mass", *(f"com_{axis}" for axis in "xyz")]
    names += [f"inertia_{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")]
    for i, name in enumerate(names):
        sizes = np.abs(errors[:, i])
        row = np.median(sizes), np.quantile(sizes, 0.95), percent[i], errors[:, i].std()
        row += (np.median(np.abs(others[:, i])),)
        print(f"| {name} | " + " | ".join(f"{value:.2f}" for value in row) + " |", flush=True)


def turns(seconds: float) -> sr.Result:
    """Simulation of 60 s of turns, each in `seconds`."""
    times = {"duration": 60, "step": 0.05, "output_step": 0.1}
    changes = HEAVIER | {"simulation": times, "phases": turning_phases(seconds)}
    return sr.simulate(sr.load_scene("servicer", changes), backend="interpreted")


def excited() -> None:
    """Print the errors of the motion of ``examples/excitation.yaml`` and of the tuned motion."""
    scene = sr.load_scene("examples/excitation.yaml")
    for what, each in (("its own motion", scene), ("tuned", sr.tune(scene).scene)):
        result = sr.simulate(each)
        deviation = result.array("held_deviation")[-1, 0]
        accuracy(f"excitation, {what}: greatest relative deviation {100 * deviation:.2f} %", result)


def carried() -> None:
    """Print the tip errors over the phase in which the object is carried."""
    print("\n| object | position, rms [mm] | greatest [mm] | orientation, rms [mrad] | greatest [mrad] |")
    print("|---|---|---|---|---|")
    for name, changes in CASES.items():
        result = sr.simulate(sr.load_scene("caught-unknown", changes))
        time, ends = result.array("time"), [event["time_s"] for event in result.summary["events"]]
        in_phase = time >= ends[-1] - 10.001
        row = []
        for output in ("tip_error", "tip_orientation_error"):
            size = 1e3 * np.linalg.norm(result.array(output)[in_phase, 0], axis=-1)
            row += [np.sqrt(np.mean(size**2)), size.max()]
        print(f"| {name} | " + " | ".join(f"{value:.2f}" for value in row) + " |", flush=True)


def replanning() -> dict[str, Any]:
    """Changes of ``caught-unknown`` by which one arm carries the object under model predictive control."""
    servicer, goal = "robots.servicer", {"tip": "servicer/left_tip", "position": GOAL_M.tolist()}
    lead = {"kind": "mpc", "period": 1, "min_horizon": 2, "iterations": 60, "kp": 0.4, "kd": 0.4}
    encoder = {"kind": "linear", "errors": {"period": 0.01, "resolution": 1e-5}}
    tips = {"left_tip": dict.fromkeys(LAWS) | {"controllers": {"payload": None}}}
    changes: dict[str, Any] = {f"{servicer}.joints.right_joint_{i}.locked": True for i in range(1, 8)}
    for name, phase in sr.load_scene("caught-unknown").scenario.phases.items():
        section = phase.robots["servicer"] | {"controllers": {"lead": None}}
        changes[f"phases.{name}.robots"] = {"servicer": {"tips": tips} if name == "carry" else section}
    return changes | {
        f"{servicer}.controllers": {"lead": lead | {"sampled": {"period": 0.01}}},
        f"{servicer}.sensors.joint_position": encoder,
        f"{servicer}.sensors.joint_rate": {"kind": "linear", "errors": {"period": 0.01, "noise": 1e-5}},
        "plan": {
            "duration": 8,
            "intervals": 12,
            "goals": {"there": goal | {"rotation_deg": GOAL_DEG}},
            "costs": {"torque": 0.02, "joint_acceleration": 1, "joint_rate": 1},
        },
    }


def at_goal(result: sr.Result) -> tuple[float, float]:
    """Position and orientation errors of the tip at the end of the plan [m, rad]."""
    scene, begins = result.scene(), [e["time_s"] for e in result.summary["events"] if e["who"] == "carry"]
    data, place = scene.model.createData(), int(np.argmin(np.abs(result.array("time") - begins[0] - 8)))
    pin.framesForwardKinematics(scene.model, data, result.array("q")[place])
    tip = data.oMf[scene.tips[0].frame]
    rotation = pin.log3(pin.rpy.rpyToMatrix(np.radians(GOAL_DEG)).T @ tip.rotation)
    return float(np.linalg.norm(tip.translation - GOAL_M)), float(np.linalg.norm(rotation))


def replanned() -> None:
    """Print the tip errors under model predictive control."""
    print("\n| object in the plans | position [mm] | orientation [mrad] | plans | without solution |")
    print("|---|---|---|---|---|")
    cases = {name: CASES[name] for name in ("known", "assumed, not identified", "identified")}
    for name, changes in (cases | {"identified, joint locked, orientation free": JAMMED}).items():
        result = sr.simulate(sr.load_scene("caught-unknown", replanning() | changes))
        (place, turn), statistics = at_goal(result), result.summary["mpc"]
        row = f"{1e3 * place:.1f} | {1e3 * turn:.1f} | {statistics['plans']} | {statistics['missed']}"
        print(f"| {name} | {row} |", flush=True)


def main() -> None:
    """Print the tables as Markdown."""
    carried()
    replanned()
    for seconds in (20.0, 5.0):
        result, motion = turns(seconds), f"{60 / seconds:.0f} turns of {seconds:g} s"
        accuracy(motion, result)
        accuracy(f"{motion}, published sensors", result, PUBLISHED)
    excited()


if __name__ == "__main__":
    main()
