"""Parts of a description: links, joints and shapes as immutable values."""

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
        kind: Kind of the geometry.
        size: Edge lengths of a box (3,), radius and length of a cylinder (2,), radius of a sphere (1,) [m];
            scale of a mesh (3,).
        mesh: Absolute path of the mesh file; None without a file.
        corners: Corners (n, 3) [m] of a convex hull, a mesh without a file; None for other geometries.
    """

    kind: GeometryKind
    size: Array
    mesh: Path | None = None
    corners: Array | None = None


@dataclass(frozen=True, eq=False)
class LinkShape:
    """Geometry fixed to a link.

    Attributes:
        name: Name of the shape, or None.
        placement: Placement of the shape's frame in the link frame, homogeneous (4, 4) [m].
        geometry: The geometry.
        rgba: Colour and opacity (4,), 0 to 1; None if the file has none.
        material: Name of the material in the file, or empty.
    """

    name: str | None
    placement: Array
    geometry: Geometry
    rgba: Array | None = None
    material: str = ""


@dataclass(frozen=True, eq=False)
class UrdfLink:
    """A rigid body, or a massless frame.

    Attributes:
        name: Name without a prefix.
        mass: Mass [kg].
        com: Centre of mass in the link frame (3,) [m].
        inertia: Inertia about the centre of mass, link axes (3, 3) [kg m^2]; zero if the file has none.
        visuals, collisions: Visual and collision shapes.
        borrowed: Name of the link whose mass properties in the scenario include those of this link, and the
            undeformed placement of this link in its frame (4, 4) [m]; None for an independent link.
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
    """Mimic relation: position = ``multiplier`` times the position of another joint + ``offset``.

    Attributes:
        joint: Name of the other joint.
        multiplier, offset: Ratio of positions, and offset [rad or m].
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint between a link and its parent.

    Attributes:
        name, kind: Name without a prefix, and kind.
        parent, child: Names of the two links.
        origin: Placement of the joint's and child's frame in the parent's with the joint at zero, homogeneous
            (4, 4) [m].
        axis: Unit vector in the joint frame (3,); without meaning for a fixed joint.
        damping, friction: Viscous damping [N m s/rad or N s/m] and dry friction [N m or N].
        effort, velocity: Limits of torque or force [N m or N] and of rate [rad/s or m/s]; infinite without
            one.
        lower, upper: Limits of position [rad or m]; infinite without one.
        mimic: Mimic relation, or None for an independent joint.
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
