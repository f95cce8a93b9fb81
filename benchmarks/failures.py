"""Failures of each joint of the paper's robots, without and with a brake: ``python -m benchmarks.failures``.

Prints the table of docs/validation/failures.md: 16 joints that lock, swing free or keep half their torque at
2 s; the last two also with a brake that holds the failed joint 0.1 s later.
"""

from __future__ import annotations

import numpy as np

import spacerobot as sr
from benchmarks.table_row import markdown_head

FAILED_S, BRAKED_S = 2.0, 2.1
COLUMNS = {
    "locked": ("locked", False),
    "free": ("free", False),
    "free, braked": ("free", True),
    "half torque": ("weak", False),
    "half torque, braked": ("weak", True),
}


def cell(robot: str | None, joint: str, mode: str, *, braked: bool) -> str:
    """Greatest tip error [mm], rotation of a base [deg] and joint torque [N m]; or when it diverged."""
    failure = {"kind": "joint_failure", "joint": joint, "mode": mode, "at": FAILED_S}
    brake = {"brake": {"kind": "joint_failure", "joint": joint, "mode": "locked", "at": BRAKED_S}}
    actuators = {"failure": failure} | (brake if braked else {})
    scene = sr.load_scene("paper", {f"robots.{robot}.actuators": actuators} if robot else {})
    result = sr.simulate(scene, backend="interpreted")
    status, data = result.summary["status"], result.data
    if status["state"] != "completed" or not status["trusted"]:
        return f"lost at {status['reached_s']:.1f} s" if status["state"] == "diverged" else "lost"
    tips = 1e3 * float(np.linalg.norm(data.tip_error.values, axis=-1).max())
    turned = np.degrees(float(np.abs(data.body_rotation.values[..., 2]).max()))
    return f"{tips:.1f} / {turned:.0f} / {float(np.abs(data.joint_torque.values).max()):.0f}"


def main() -> None:
    """Print the table as Markdown."""
    print(*markdown_head(["joint", *COLUMNS]), sep="\n")
    print(f"| none | {cell(None, '', 'free', braked=False)} |" + " |" * (len(COLUMNS) - 1), flush=True)
    for robot in ("rpr1", "rpr2"):
        for number in range(1, 9):
            joint = f"joint_{number}"
            cells = [cell(robot, joint, mode, braked=braked) for mode, braked in COLUMNS.values()]
            print(f"| {robot}/{joint} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
