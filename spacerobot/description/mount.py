"""Mounting of an arm on a link of another description."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from spacerobot.common.errors import DescriptionError, near_names
from spacerobot.description.parts import UrdfJoint, frozen
from spacerobot.description.read import Description


def mounted(
    host: Description, arm: Description, name: str, link: str | None, placement: np.ndarray
) -> Description:
    """Description of a host with an arm, whose root link is fixed to a link of the host.

    Args:
        host, arm: Descriptions of both.
        name: Prefix of the arm's links and joints, followed by ``_``.
        link: Link of the host; its root if None.
        placement: Placement of the arm's root link in the frame of that link (4, 4) [m].

    Raises:
        DescriptionError: If there is no such link, or the host already has a link or joint of the same name.
    """
    names = [host_link.name for host_link in host.links]
    parent = host.root if link is None else link
    if parent not in names:
        raise DescriptionError(
            f"no link {parent!r} in {host.path.name}; {near_names(parent, names)}", where="link"
        )
    links = tuple(replace(host_link, name=f"{name}_{host_link.name}") for host_link in arm.links)
    joints = tuple(
        replace(
            joint,
            name=f"{name}_{joint.name}",
            parent=f"{name}_{joint.parent}",
            child=f"{name}_{joint.child}",
            mimic=joint.mimic and replace(joint.mimic, joint=f"{name}_{joint.mimic.joint}"),
        )
        for joint in arm.joints
    )
    weld = UrdfJoint(
        f"{name}_mount", "fixed", parent, f"{name}_{arm.root}", frozen(placement), frozen([1, 0, 0])
    )
    twice = {host_link.name for host_link in links} & set(names)
    twice |= {host_link.name for host_link in (weld, *joints)} & {host_link.name for host_link in host.joints}
    if twice:
        message = f"{host.path.name} has {', '.join(sorted(twice))} already; call the mount otherwise"
        raise DescriptionError(message)
    place = ",".join(f"{value!r}" for value in placement.ravel().tolist())
    text = "\0".join((host.sha256, arm.sha256, name, parent, place))
    return replace(
        host,
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        links=(*host.links, *links),
        joints=(*host.joints, weld, *joints),
        warnings=(*host.warnings, *(f"{name}: {warning}" for warning in arm.warnings)),
    )
