"""A small scene that compiles in no time: one planar arm of three links carries a rectangle for a second."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import yaml

from spacerobot.description.planar import planar_arm_urdf

TUNING = {
    "variables": {
        "kp": {"paths": "robots.*.tips.tip.pid.kp", "lower": 20, "upper": 400},
        "ki": {"paths": "robots.arm.tips.tip.pid.ki", "lower": 1, "upper": 300, "scale": "log"},
        "kd": {"paths": "robots.arm.tips.tip.pid.kd", "lower": 20, "upper": 100},
        "ta": {"paths": "robots.arm.tips.tip.amnesia.ta", "lower": 0.5, "upper": 20, "scale": "log"},
        "grip": {"paths": ["grasps.left.stiffness", "grasps.left.damping"], "lower": 20, "upper": 100},
    },
    "sets": {"two": ["kp", "ta"], "four": ["kp", "ki", "kd", "ta"]},
    "readings": {
        "base": {"robots.*.tips.tip.pid.feedback": "base"},
        "inertial": {"robots.*.tips.tip.pid.feedback": "inertial"},
    },
    "objective": {"kind": "ise"},
    "robustness": {"plants": 8},
    "budget": 120,
    "rival_budget": 120,
    "population": 12,
    "runs": 2,
    "starts": 2,
    "iterations": 25,
    "step": 0.01,
}


def scenario() -> dict[str, object]:
    """The scenario as plain data; URDFs by name, in the scenario's own folder."""
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
        "simulation": {"duration": 1.0, "step": 0.005, "output_step": 0.05},
        "tuning": TUNING,
    }


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    before = os.environ.get("SPACEROBOT_CACHE_DIR")
    os.environ["SPACEROBOT_CACHE_DIR"] = str(tmp_path_factory.mktemp("cache"))
    yield
    if before is None:
        del os.environ["SPACEROBOT_CACHE_DIR"]
    else:
        os.environ["SPACEROBOT_CACHE_DIR"] = before


@pytest.fixture(scope="session")
def small_file(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("small")
    text = planar_arm_urdf(
        links=3,
        link_length_m=0.35,
        link_mass_kg=5.0,
        link_inertia_kg_m2=(0.2, 0.1),
        base_mass_kg=100.0,
        base_inertia_kg_m2=10.0,
        base_radius_m=0.3,
        damping=0.1,
        name="arm",
    )
    (folder / "arm.urdf").write_text(text)
    file = folder / "small.yaml"
    file.write_text(yaml.safe_dump(scenario(), sort_keys=False))
    return file


@pytest.fixture(scope="session")
def small(small_file):
    """Function of changes that gives the small scene."""
    from spacerobot.scene import load_scene

    return lambda **changes: load_scene(small_file, {k.replace("__", "."): v for k, v in changes.items()})
