"""One or two links on a fixed or floating base, held by joint PD: loop transfer functions are known."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from spacerobot.description.planar import PlanarBase, PlanarLink, planar_arm_urdf
from spacerobot.scenario.load import validate
from spacerobot.scene import Scene, build_scene

KP, KD = 12.0, 3.0


@functools.cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    found = tempfile.TemporaryDirectory(prefix="linear_scenes_")
    for links in (1, 2):
        arm = planar_arm_urdf(
            links=links,
            link=PlanarLink(length_m=0.8, mass_kg=3.0, inertia_kg_m2=(0.4,)),
            base=PlanarBase(mass_kg=20.0, inertia_kg_m2=2.0, radius_m=0.3),
            damping=0.0,
        )
        (Path(found.name) / f"arm{links}.urdf").write_text(arm, encoding="utf-8")
    return found


def arm_scene(
    links: int = 1,
    base: str = "fixed",
    rate_deg: float = 0.0,
    robot: Mapping[str, Any] | None = None,
    **hold: Any,
) -> Scene:
    """Scene of an arm whose joints are held where they begin."""
    joints = {f"joint_{i + 1}": {"angle_deg": 40, "rate_deg": rate_deg} for i in range(links)}
    document = {
        "name": "held",
        "robots": {
            "arm": {
                "urdf": f"arm{links}.urdf",
                "base": {"joint": base},
                "joints": joints,
                "controllers": {"hold": {"kind": "joint_pd", "kp": KP, "kd": KD, **hold}},
                **(robot or {}),
            }
        },
        "simulation": {"duration": 1.0, "step": 0.01, "output_step": 0.1},
    }
    source = Path(_folder().name) / "scenario.yaml"
    source.write_text(yaml.safe_dump(document), encoding="utf-8")
    return build_scene(validate(document, source=source), {}, source=source)
