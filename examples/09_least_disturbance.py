"""One task with several controllers: rotation and translation of the free base, and joint torque."""

from pathlib import Path
from typing import Any

import numpy as np

import spacerobot as sr
import viz
from viz import figures

TASK = Path(__file__).with_name("reach.yaml")
ARM, TIP = "robots.arm", "robots.arm.tips.tip"


def resolved_rate(**options: Any) -> dict[str, Any]:
    """Joint rates by the generalized Jacobian."""
    return {f"{ARM}.controllers.lead": {"kind": "resolved_rate", "damping": 0.02} | options}


CONTROLLERS: dict[str, dict[str, Any]] = {
    "PID + amnesia (paper)": {
        f"{TIP}.pid": {"kp": 300, "ki": 250, "kd": 200, "feedback": "base"},
        f"{TIP}.amnesia": {"ge": 500, "ta": 3},
        f"{TIP}.orientation_pid": {
            "kp": 30,
            "ki": 25,
            "kd": 20,
        },  # not in the paper, which has no orientation control
        f"{TIP}.orientation_amnesia": {"ge": 500, "ta": 3},
        f"{ARM}.joint_pd": {"kp": 0, "kd": 20},
    },
    "generalized Jacobian": resolved_rate(),
    "reaction null space, attitude": resolved_rate(keeps="attitude"),
    "reaction null space, base": resolved_rate(keeps="base"),
}


def main(
    folder: Path = Path("out/examples/disturbance"),
    duration_s: float = 14.0,
    names: Any = (*CONTROLLERS, "plan"),
) -> None:
    """Simulate all controllers and a plan; print a table and draw a figure."""
    shared = {"simulation.duration": duration_s}
    results = {}
    for name in (name for name in names if name in CONTROLLERS):
        print("simulating:", name)
        results[name] = sr.simulate(sr.load_scene(TASK, shared | CONTROLLERS[name]))
    if "plan" in names:
        # writes followed.yaml too, the scenario that follows the plan
        sr.plan(sr.load_scene(TASK), folder / "plan", progress=sr.print_progress)
        results["plan"] = sr.simulate(sr.load_scene(folder / "plan" / "followed.yaml", shared))
    print(f"{'controller':30s}base turns   base moves   rms torque   peak       ", end="")
    print("settled to 0.1 mm   final tip error")
    for name, result in results.items():
        data = result.data
        turned = np.degrees(np.linalg.norm(data.body_rotation[:, 0], axis=1)).max()
        moved = 1e3 * np.linalg.norm(data.body_position[:, 0] - data.body_position[0, 0], axis=1).max()
        torque, rms = abs(data.joint_torque.values), float(np.sqrt((data.joint_torque**2).mean()))
        away = np.linalg.norm(data.tip_position[:, 0] - data.tip_reference[-1, 0], axis=1)
        rests = data.time.values[np.flatnonzero(away > 1e-4)[-1]] if away[-1] < 1e-4 else np.nan
        print(f"{name:30s}{turned:7.2e} deg {moved:7.2e} mm{rms:9.3f} N m{torque.max():9.2f} N m", end="")
        print(f"{rests:14.2f} s{1e3 * away[-1]:19.4f} mm")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "disturbance.png").write_bytes(figures.to_bytes(figures.disturbance(results), "png"))
    *_, last = results.values()
    viz.write_recording(last, folder / "film.gif", frames_per_s=5, speed=3, size_px=(480, 300))
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
