"""Changes of link placements in a description."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError, near_names
from spacerobot.description.parts import frozen
from spacerobot.description.read import Description


def placed(description: Description, origins: Mapping[str, Array]) -> Description:
    """Description with other placements of some links on their parents.

    Args:
        description: The description.
        origins: Placement of the joint frame in the parent's frame (4, 4) [m], by name of the child link.

    Raises:
        DescriptionError: If there is no such link, or it is the root.
    """
    carried = [joint.child for joint in description.joints]
    for link in origins:
        if link not in carried:
            what = "has no parent" if link == description.root else near_names(link, carried)
            raise DescriptionError(
                f"no link {link!r} on another one in {description.path.name}; {what}", where=link
            )
    changed = [
        replace(joint, origin=frozen(origins[joint.child])) if joint.child in origins else joint
        for joint in description.joints
    ]
    places = [f"{link},{np.asarray(origin).ravel().tolist()!r}" for link, origin in origins.items()]
    text = "\0".join((description.sha256, *places))
    return replace(description, sha256=hashlib.sha256(text.encode()).hexdigest(), joints=tuple(changed))
