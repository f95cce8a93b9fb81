"""Free bodies that meet: scenes of one robot without joints and a target, made as a user would."""

from __future__ import annotations

from typing import Any

from spacerobot.scenario.load import validate
from spacerobot.scene import Scene, build_scene
from tests.oracles.small_scenes import folder

BODY = """<robot name="{name}"><link name="body">
<inertial><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><sphere radius="0.1"/></geometry></collision></link></robot>"""


def body(name: str, mass: float, base: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Section of a free body of a given mass [kg], inertia 0.004 kg m^2 per kg; a ball of 0.1 m."""
    file = folder() / f"{name}_{mass:g}.urdf"
    file.write_text(BODY.format(name=name, mass=mass, i=0.004 * mass), encoding="utf-8")
    return {"urdf": str(file), "base": {"joint": "free_flyer"} | base} | more


def meeting(
    contact: dict[str, Any], speed: float = 0.4, masses: tuple[float, float] = (2.0, 3.0), **more: Any
) -> Scene:
    """Two balls, 5 mm apart, the first of which meets the second head-on along x."""
    document = {
        "robots": {"one": body("one", masses[0], {"velocity": [speed, 0, 0]})},
        "target": body("other", masses[1], {"position": [0.205, 0, 0]}),
        "contacts": {"bump": {"between": ["one/body", "target/body"]} | contact},
    }
    return scene(document | more)


def scene(document: dict[str, Any]) -> Scene:
    """Scene of a document."""
    return build_scene(validate(document))
