"""Pads: shapes for contact that a URDF does not have."""

from __future__ import annotations

from pydantic import Field, model_validator

from spacerobot.section import Section, Vector, quantity
from spacerobot.shapes import ShapeKind

NEEDS: dict[ShapeKind, tuple[str, ...]] = {
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
    "cylinder": ("radius", "length"),
    "box": ("size",),
    "plane": (),
}
"""Measures that each shape has, and no others."""


class Pad(Section):
    """A shape fixed to a link; it has no mass."""

    link: str = Field(pattern=r"^[^/]+/[^/]+$", description="what carries it, as robot/link or target/link")
    shape: ShapeKind = Field(
        description="sphere, capsule or cylinder along its own z axis, box, or plane: all that is below its "
        "own x-y plane"
    )
    radius: float | None = quantity("m", "of a sphere, capsule or cylinder", default=None, gt=0)
    length: float | None = quantity(
        "m", "of a cylinder, or of a capsule between the centres of its ends", default=None, gt=0
    )
    size: Vector | None = quantity("m", "edges of a box", default=None)
    position: Vector = quantity("m", "its own origin, link axes", default=(0.0, 0.0, 0.0))
    rotation_deg: Vector = quantity(
        "deg", "roll, pitch, yaw of its own axes in the link's", default=(0.0, 0.0, 0.0)
    )

    @model_validator(mode="after")
    def _check(self) -> Pad:
        for key in ("radius", "length", "size"):
            given, wanted = getattr(self, key) is not None, key in NEEDS[self.shape]
            if wanted and not given:
                raise ValueError(f"a {self.shape} needs `{key}`")
            if given and not wanted:
                raise ValueError(f"a {self.shape} has no `{key}`")
        if self.size is not None and min(self.size) <= 0:
            raise ValueError(f"size: found {list(self.size)}, allowed: edges above 0")
        return self
