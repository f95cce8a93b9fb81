"""Descriptions with links and joints for what bends, and shapes cut in pieces."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Sequence

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError, near_names
from spacerobot.description.parts import LinkShape, UrdfJoint, UrdfLink, frozen
from spacerobot.description.read import Description

_PARALLEL = 1e-6  # sine of the angle between directions that count as parallel


def find_link(description: Description, name: str) -> UrdfLink:
    """Link of a description.

    Raises:
        DescriptionError: If there is none of that name.
    """
    by_name = {link.name: link for link in description.links}
    if name not in by_name:
        raise DescriptionError(
            f"no link {name!r} in {description.path.name}; {near_names(name, by_name)}", where="link"
        )
    return by_name[name]


def translation(offset: Array) -> Array:
    """Homogeneous transform (4, 4) of a translation (3,) [m]."""
    transform = np.eye(4)
    transform[:3, 3] = offset
    return transform


def extended(
    description: Description,
    changed: Sequence[UrdfLink],
    links: Sequence[UrdfLink],
    joints: Sequence[UrdfJoint],
    text: str,
) -> Description:
    """Description with links changed, and links and joints added; joints of known names are replaced.

    Args:
        description: The URDF.
        changed, links: Links of known names, and new ones.
        joints: New ones, and known ones with other parents.
        text: What distinguishes the change, for the hash.

    Raises:
        DescriptionError: If a new link or joint has the name of a known one.
    """
    by_name = {link.name: link for link in description.links}
    moved = {joint.name: joint for joint in description.joints}
    new = {link.name for link in links}
    twice = [link.name for link in links if link.name in by_name]
    twice += [joint.name for joint in joints if joint.child in new and joint.name in moved]
    if twice:
        raise DescriptionError(
            f"{description.path.name} has {twice[0]!r} already; choose another name for the section"
        )
    by_name |= {link.name: link for link in (*changed, *links)}
    moved |= {joint.name: joint for joint in joints}
    digest = hashlib.sha256(f"{description.sha256}\0{text}".encode()).hexdigest()
    return dataclasses.replace(
        description, sha256=digest, links=tuple(by_name.values()), joints=tuple(moved.values())
    )


def cut(
    shape: LinkShape, start: Array, axis: Array, ends: Sequence[float]
) -> Iterator[tuple[int, LinkShape]]:
    """Pieces of a shape along a beam, each with the number of its segment.

    Boxes and cylinders whose edge or axis is parallel to the beam are cut; others belong to one segment.

    Args:
        shape: The shape, link axes.
        start, axis: Of the beam, link axes (3,) [m], and (3,) of unit length.
        ends: Places along the beam [m] at which segments end, all but the last, rising.
    """
    geometry, rotation = shape.geometry, shape.placement[:3, :3]
    centre = float((shape.placement[:3, 3] - start) @ axis)
    edges = {"box": (0, 1, 2), "cylinder": (2,)}.get(geometry.kind, ())
    along = [i for i in edges if np.linalg.norm(np.cross(rotation[:, i], axis)) < _PARALLEL]
    if not along:
        yield int(np.searchsorted(ends, centre)), shape
        return
    place = 1 if geometry.kind == "cylinder" else along[0]
    half = float(geometry.size[place]) / 2
    bounds = [-np.inf, *ends, np.inf]
    for i in range(len(bounds) - 1):
        low, high = max(bounds[i], centre - half), min(bounds[i + 1], centre + half)
        if high - low > _PARALLEL * half:
            size, placement = geometry.size.copy(), shape.placement.copy()
            size[place] = high - low
            placement[:3, 3] += ((low + high) / 2 - centre) * axis
            piece = dataclasses.replace(geometry, size=frozen(size))
            name = shape.name and f"{shape.name}_{i}"
            yield i, dataclasses.replace(shape, name=name, placement=frozen(placement), geometry=piece)
