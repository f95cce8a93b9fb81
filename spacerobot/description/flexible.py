"""Links and joints of flexible links in descriptions, and division of shapes into segments."""

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
    """Find a link of a description by its name.

    Raises:
        DescriptionError: If there is no such link; the message has similar names.
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
    """Description with changed and added links and joints.

    Args:
        description: The description.
        changed, links: Existing links with changes, and new links.
        joints: New joints, and existing joints with other parents.
        text: Text that identifies the change, for the hash of the description.

    Raises:
        DescriptionError: If a new link, or the joint of a new link, has the name of an existing one.
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
    """Divide a shape along a beam and iterate over the pieces with the indices of their segments.

    Boxes and cylinders with an edge or axis parallel to the beam are divided. Other shapes belong entirely to
    the segment of their centre.

    Args:
        shape: The shape, link axes.
        start, axis: Start (3,) [m] and unit vector (3,) of the beam, link axes.
        ends: Coordinates along the beam [m] at which the segments, except the last one, end, in ascending
            order.
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
