"""Registration of environments in Gymnasium."""

from __future__ import annotations

from typing import Any

_TARGET = "phases.reach.robots.servicer.tips.left_tip.reference"
CAPTURE: dict[str, Any] = {
    "scenario": "capture",
    "changes": {
        "description": "The left arm of a free-flying servicer of 575 kg follows the targets of a policy "
        "until it grips a satellite of 100 kg that tumbles at 3 deg/s.",
        **{
            f"robots.servicer.tips.*.{key}": None
            for key in ("pid", "amnesia", "orientation_pid", "orientation_amnesia")
        },
        # compliant: the policy's targets jump, and noise of exploration must not
        "robots.servicer.tips.*.controllers": {
            "soft": {"kind": "impedance", "stiffness": [50] * 3, "damping": [20] * 3},
            "orientation_soft": {"kind": "impedance", "stiffness": [5] * 3, "damping": [1.5] * 3},
        },
        "grasps": {
            "left": {
                "tip": "servicer/left_tip",
                "frame": "mate_left",
                "kind": "weld",
                "begins": "open",
                "capture": {
                    "distance": 0.05,
                    "misalignment_deg": 10,
                    "closing_speed": 0.05,
                    "lateral_speed": 0.05,
                    "spin_deg": 5,
                    "dwell": 0.1,
                },
            }
        },
        "phases": {
            "reach": {
                "captures": ["left"],
                "robots": {
                    "servicer": {"tips": {"left_tip": {"reference": {"kind": "line", "duration": 0.1}}}}
                },
                "until": {"captured": ["left"]},
                "timeout": 20,
                "on_timeout": "end",
            }
        },
        "simulation.step": 0.01,
    },
    "observations": [
        "grasp_gap",
        "grasp_misalignment",
        "tip_position[servicer/left_tip]",
        "tip_velocity[servicer/left_tip]",
        "body_rotation",
        "base_spin",
    ],
    "actions": {f"{_TARGET}.displacement.*": 0.8, f"{_TARGET}.rotation_deg.*": 40.0},
    "reward": {"grasp_gap": -1.0, "grasp_misalignment": -0.5, "action": -0.01, "events.captured": 10.0},
    "terminations": ["captured"],
    "duration": 20.0,
    "draws": {
        f"{name}_{axis}": {"paths": f"target.base.{key}.{axis}", "apply": "offset", "lower": -by, "upper": by}
        for name, key, by in (("position", "position", 0.05), ("spin", "spin_deg", 0.5))
        for axis in range(3)
    },
}
"""Capture of the tumbling satellite by the servicer's left arm, whose compliant tip follows a target."""

ENVIRONMENTS: dict[str, dict[str, Any]] = {"spacerobot/Scene-v0": {}, "spacerobot/Capture-v0": CAPTURE}
"""Arguments of :func:`spacerobot.learning.make_environment` by name; ``Scene-v0`` accepts any scenario."""


def register_environments() -> None:
    """Register the shipped environments, if Gymnasium is installed."""
    try:
        from gymnasium.envs.registration import register, registry
    except ImportError:
        return
    for name, arguments in ENVIRONMENTS.items():
        if name not in registry:
            register(
                name,
                entry_point="spacerobot.learning:make_environment",
                vector_entry_point="spacerobot.learning:make_vector_environment",
                kwargs=arguments,
            )
