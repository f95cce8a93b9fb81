"""Failed joints that momentum observers detect: ``python -m benchmarks.detection``.

Prints the table of docs/validation/failures.md: the paper's 16 joints, free or with half torque from 2 s on.
"""

from __future__ import annotations

import numpy as np

import spacerobot as sr

FAILED_S = 2.0
ROBOTS = ("rpr1", "rpr2")
MODES = {"free": "free", "half torque": "weak"}
OBSERVER = {
    "kind": "momentum_observer",
    "period": 0.01,
    "bandwidth": 10,
    "joint_noise": 5e-6,
    "spin_noise": 1e-6,
    "velocity_noise": 1e-6,
    "allowance": 0.02,
    "false_alarms": 0.01,
}


def cell(robot: str = "", joint: str = "", mode: str = "") -> str:
    """Largest tip error [mm], base rotation [deg] and joint torque [N m], and delay of each alarm [s].

    Without a robot no joint fails. The delay of a false alarm is nan.
    """
    actuators = {name: {"observer": dict(OBSERVER)} for name in ROBOTS}
    if robot:
        failure = {"kind": "joint_failure", "joint": joint, "mode": mode, "at": FAILED_S}
        actuators[robot] |= {"failure": failure}
    scene = sr.load_scene(
        "paper", {f"robots.{name}.actuators": actuator for name, actuator in actuators.items()}
    )
    result = sr.simulate(scene, backend="interpreted")
    if not result.completed:
        return f"lost at {result.summary['status']['reached_s']:.1f} s"
    data, events = result.data, result.summary["events"]
    tips = 1e3 * float(np.linalg.norm(data.tip_error.values, axis=-1).max())
    rotation = np.degrees(float(np.abs(data.body_rotation.values[..., 2]).max()))
    text = f"{tips:.1f} / {rotation:.0f} / {float(np.abs(data.joint_torque.values).max()):.0f}"
    alarms = [event.get("delay_s", np.nan) for event in events if event["kind"] == "detected"]
    return " / ".join([text, *(f"{delay:.2f}" for delay in alarms)])


def main() -> None:
    """Print the table as Markdown."""
    print("| joint | " + " | ".join(MODES) + " |\n|---|" + "---|" * len(MODES))
    print(f"| none | {cell()} |" + " |" * (len(MODES) - 1), flush=True)
    for robot in ROBOTS:
        for number in range(1, 9):
            cells = [cell(robot, f"joint_{number}", mode) for mode in MODES.values()]
            print(f"| {robot}/joint_{number} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
