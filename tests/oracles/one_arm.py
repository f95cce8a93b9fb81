"""A small scene that compiles in no time: one planar arm of three links carries a rectangle for a second."""

from __future__ import annotations

from pathlib import Path

import yaml

from spacerobot.description.planar import PlanarBase, PlanarLink, planar_arm_urdf


def scenario(**sections: object) -> dict[str, object]:
    """The scenario as plain data, with further sections or others in place."""
    joints = {f"joint_{i}": {"angle_deg": angle} for i, angle in ((1, 40), (2, -70), (3, 60))}
    circle = {"kind": "circle", "radius": 0.05, "duration": 0.8, "end_deg": 120}
    pid = {"kp": 150, "ki": 60, "kd": 40}
    tip = {"pid": pid, "amnesia": {"ge": 60, "ta": 4}, "reference": circle}
    return {
        "name": "small",
        "robots": {
            "arm": {"urdf": "arm.urdf", "base": {"joint": "planar"}, "joints": joints, "tips": {"tip": tip}}
        },
        "target": {"urdf": "rectangle.urdf", "base": {"joint": "planar", "close_grasp": "left"}},
        "grasps": {"left": {"tip": "arm/tip", "frame": "mate_1", "kind": "compliant"}},
        "simulation": {"duration": 1.0, "step": 0.01, "output_step": 0.01},
        **sections,
    }


def write(folder: Path, **sections: object) -> Path:
    """The scenario's file, its arm beside it."""
    arm = planar_arm_urdf(
        links=3,
        link=PlanarLink(length_m=0.35, mass_kg=5.0, inertia_kg_m2=(0.2, 0.1)),
        base=PlanarBase(mass_kg=100.0, inertia_kg_m2=10.0, radius_m=0.3),
        damping=0.1,
        name="arm",
    )
    (folder / "arm.urdf").write_text(arm)
    file = folder / "small.yaml"
    file.write_text(yaml.safe_dump(scenario(**sections), sort_keys=False))
    return file
