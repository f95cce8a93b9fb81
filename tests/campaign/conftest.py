"""A small scene that compiles in no time: one planar arm of three links carries a rectangle for a second."""

import os

import pytest
import yaml

from spacerobot.description.planar import planar_arm_urdf

CAMPAIGN = {
    "parameters": {
        "mass": {"paths": "target.links.body.mass", "lower": 10, "upper": 30},
        "spin": {"paths": "target.base.spin_deg.2", "lower": -2, "upper": 2},
        "com": {"paths": "target.links.body.com.0", "kind": "normal", "mean": 0, "std": 0.01},
        "grip": {"paths": "grasps.*.stiffness", "apply": "factor", "lower": 0.5, "upper": 2},
    },
    "gains": {"soft": {"robots.*.tips.tip.pid.kp": 50}, "stiff": {"robots.*.tips.tip.pid.kp": 300}},
    "samples": 100,
    "limits": {"grip_force": 7.0},
    "step": 0.01,
}


def scenario():
    joints = {f"joint_{i}": {"angle_deg": angle} for i, angle in ((1, 40), (2, -70), (3, 60))}
    circle = {"kind": "circle", "radius": 0.05, "duration": 0.8, "end_deg": 120}
    tip = {
        "pid": {"kp": 150, "ki": 60, "kd": 40},
        "amnesia": {"ge": 60, "ta": 4},
        "reference": circle,
    }
    return {
        "name": "small",
        "robots": {
            "arm": {"urdf": "arm.urdf", "base": {"joint": "planar"}, "joints": joints, "tips": {"tip": tip}}
        },
        "target": {"urdf": "rectangle.urdf", "base": {"joint": "planar", "close_grasp": "left"}},
        "grasps": {"left": {"tip": "arm/tip", "frame": "mate_1", "kind": "compliant"}},
        "simulation": {"duration": 1.0, "step": 0.01, "output_step": 0.01},
        "campaign": CAMPAIGN,
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
def small_file(tmp_path_factory):
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
