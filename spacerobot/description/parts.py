"""Parts of a description: links, joints and shapes, as read-only values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from spacerobot.common.arrays import Array

GeometryKind = Literal["box", "cylinder", "sphere", "mesh"]
JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]


def frozen(values: ArrayLike) -> Array:
    """Read-only copy as float64."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Geometry:
    """A primitive or a mesh.

    Attributes:
        kind: Which of them.
        size: Box: edge lengths (3,); cylinder: radius, length (2,); sphere: radius (1,), in m. Mesh: scale
            (3,).
        mesh: Absolute path of the mesh file; None for a primitive.
        corners: Of a mesh without a file, which is their convex hull (n, 3), m.
    """

    kind: GeometryKind
    size: Array
    mesh: Path | None = None
    corners: Array | None = None


@dataclass(frozen=True, eq=False)
class LinkShape:
    """Geometry fixed to a link.

    Attributes:
        name: Its name, if it has one.
        placement: Shape frame in the link frame, homogeneous (4, 4), m.
        geometry: What is there.
        rgba: Colour and opacity (4,), 0 to 1; None where the file gives none.
        material: Name of its material in the file; empty where the file names none.
    """

    name: str | None
    placement: Array
    geometry: Geometry
    rgba: Array | None = None
    material: str = ""


@dataclass(frozen=True, eq=False)
class UrdfLink:
    """A rigid body, or a mere frame if its mass is 0.

    Attributes:
        name: Its name, without any prefix.
        mass: kg.
        com: Centre of mass in the link frame (3,), m.
        inertia: About the centre of mass, in the axes of the link frame (3, 3), kg m^2; zero where the file
            has none.
        visuals, collisions: What is drawn, and what would collide.
        borrowed: Link whose mass properties include these, and the resting pose of this link in its frame (4,
            4) [m]: there they are taken out. None for a link of its own.
    """

    name: str
    mass: float
    com: Array
    inertia: Array
    visuals: tuple[LinkShape, ...] = ()
    collisions: tuple[LinkShape, ...] = ()
    borrowed: tuple[str, Array] | None = None


@dataclass(frozen=True)
class Mimic:
    """A joint's position as ``multiplier`` times that of another one plus ``offset``.

    Attributes:
        joint: Name of the joint that is followed.
        multiplier, offset: In rad or m of the follower (per rad or m of the followed).
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """Connection of a link to its parent.

    Attributes:
        name, kind: Its name, without any prefix, and what it allows.
        parent, child: Names of the links it connects.
        origin: Joint (= child) frame in the parent link's frame with the joint at zero, homogeneous (4, 4),
            m.
        axis: Unit vector in the joint frame (3,); of no meaning for a fixed joint.
        damping, friction: Viscous, N m s/rad or N s/m, and dry, N m or N.
        effort, velocity: Largest magnitudes, N m or N, rad/s or m/s; infinite where there is no limit.
        lower, upper: Range, rad or m; infinite where there is no limit.
        mimic: What it follows, if it has no coordinate of its own.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    origin: Array
    axis: Array
    damping: float = 0.0
    friction: float = 0.0
    effort: float = np.inf
    velocity: float = np.inf
    lower: float = -np.inf
    upper: float = np.inf
    mimic: Mimic | None = None
