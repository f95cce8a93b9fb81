"""Write the shipped URDFs afresh: ``python -m benchmarks.shipped_urdfs``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from benchmarks.shipped_urdfs.ball import ball_urdf
from benchmarks.shipped_urdfs.panda import panda_arm_urdf
from benchmarks.shipped_urdfs.spatial import bus_urdf, satellite_box_urdf, servicer_urdf
from spacerobot.description.find import shipped_urdf_folder
from spacerobot.description.planar import PlanarBase, PlanarLink, planar_arm_urdf, rectangle_urdf

SHIPPED: dict[str, Callable[[], str]] = {
    "planar_arm.urdf": planar_arm_urdf,
    "short_arm.urdf": partial(
        planar_arm_urdf,
        links=3,
        link=PlanarLink(0.5, 8.0, (0.17, 0.12)),
        base=PlanarBase(120.0, 15.0),
        name="short_arm",
    ),
    "rectangle.urdf": rectangle_urdf,
    "ball.urdf": ball_urdf,
    "panda_arm.urdf": panda_arm_urdf,
    "servicer.urdf": servicer_urdf,
    "bus.urdf": bus_urdf,
    "satellite_box.urdf": satellite_box_urdf,
}
"""Every file that ships, with the function that writes it."""


def main() -> None:
    """Overwrite the shipped files with what their generators give."""
    for name, generate in SHIPPED.items():
        (shipped_urdf_folder() / name).write_text(generate(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
