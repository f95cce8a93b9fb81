"""The same task by several controllers: how far the free base is turned and moved, and what it takes."""

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


WAYS: dict[str, dict[str, Any]] = {
    "PID + amnesia (paper)": {
        f"{TIP}.pid": {"kp": 300, "ki": 250, "kd": 200, "feedback": "base"},
        f"{TIP}.amnesia": {"ge": 500, "ta": 3},
        f"{TIP}.orientation_pid": {"kp": 30, "ki": 25, "kd": 20},  # the paper leads no orientation: ours
        f"{TIP}.orientation_amnesia": {"ge": 500, "ta": 3},
        f"{ARM}.joint_pd": {"kp": 0, "kd": 20},
    },
    "generalized Jacobian": resolved_rate(),
    "reaction null space, attitude": resolved_rate(keeps="attitude"),
    "reaction null space, base": resolved_rate(keeps="base"),
}


def main(
    folder: Path = Path("out/examples/disturbance"), duration_s: float = 14.0, names: Any = (*WAYS, "plan")
) -> None:
    """A table and a figure; the plan is found first, of what the scenario's ``plan`` section asks for."""
    shared = {"simulation.duration": duration_s}
    results = {}
    for name in (name for name in names if name in WAYS):
        print("simulating:", name)
        results[name] = sr.simulate(sr.load_scene(TASK, shared | WAYS[name]))
    if "plan" in names:
        sr.plan(
            sr.load_scene(TASK), folder / "plan", progress=print
        )  # writes also the scenario that follows the plan
        results["plan"] = sr.simulate(sr.load_scene(folder / "plan" / "followed.yaml", shared))
    print(f"{'way':30s}base turns   base moves   torque rms   greatest   rest within 0.1 mm   tip at the end")
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


if __name__ == "__main__":
    main()
