"""Small plants with a plan section."""

import pytest
import yaml

from spacerobot.scene import load_scene

REACH = {
    "name": "reach",
    "robots": {
        "one": {
            "urdf": "short_arm.urdf",
            "base": {"joint": "planar", "position": [-0.5, 0, 0]},
            "joints": {
                "joint_1": {"angle_deg": 40},
                "joint_2": {"angle_deg": 40},
                "joint_3": {"angle_deg": -40},
            },
            "tips": {"tip": {}},
        }
    },
    "target": {
        "urdf": "rectangle.urdf",
        "base": {
            "joint": "planar",
            "position": [0.8, 0.8, 0],
            "velocity": [0.01, 0.02, 0],
            "spin_deg": [0, 0, 2],
        },
    },
    "plan": {
        "duration": 6,
        "goals": {"mate": {"tip": "one/tip", "frame": "mate_1"}},
        "costs": {"torque": 0.01, "base_rotation": 1},
    },
    "simulation": {"duration": 8, "step": 0.01, "output_step": 0.1},
}
"""Three joints on a floating base come to a target that drifts and turns."""


@pytest.fixture(scope="session")
def reach(tmp_path_factory):
    """Function of changes that gives the scene."""
    file = tmp_path_factory.mktemp("reach") / "reach.yaml"
    file.write_text(yaml.safe_dump(REACH))
    return lambda *changes: load_scene(file, list(changes))
