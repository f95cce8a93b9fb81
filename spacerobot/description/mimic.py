"""Mimic joints and locked joints, which have no coordinates of their own."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from spacerobot.common.errors import DescriptionError, near_names
from spacerobot.description.parts import Mimic, UrdfJoint, frozen


def settle(
    joints: Sequence[UrdfJoint], positions: Mapping[str, float], locked: Collection[str], source: Path
) -> tuple[UrdfJoint, ...]:
    """Resolve locked joints and chains of mimic joints.

    Locked joints become fixed at their initial positions. A mimic joint refers directly to the independent
    joint at the end of its chain; it becomes fixed if it, or a joint in its chain, is locked or fixed.

    Args:
        joints: Joints of the file.
        positions: Initial positions by name [rad or m]. Mimic joints that are missing start at the positions
            that follow from the joints that they mimic, or at zero if these do not exist.
        locked: Names of the locked joints.
        source: File for error messages.

    Raises:
        DescriptionError: If joints that are not locked mimic a joint that does not exist, or each other in a
            circle; the message has all their names.
    """
    by_name = {joint.name: joint for joint in joints}
    settled, faults = [], {}
    for joint in joints:
        try:
            settled.append(_settled(joint, by_name, positions, locked))
        except DescriptionError as fault:
            faults[joint.name] = fault.message
    if faults:
        first, *others = faults
        too = f"; the same fault: {', '.join(others)}" if others else ""
        message = f"{faults[first]}{too}. Mend <mimic>, or `joints: {{NAME: {{locked: true}}}}`"
        raise DescriptionError(message, source=source, where=f"joint {first!r}")
    return tuple(settled)


def _settled(
    joint: UrdfJoint,
    by_name: Mapping[str, UrdfJoint],
    positions: Mapping[str, float],
    locked: Collection[str],
) -> UrdfJoint:
    if joint.kind == "fixed":
        return joint
    leader, multiplier, offset = joint, 1.0, 0.0
    chain = [joint.name]
    while leader.mimic is not None and leader.kind != "fixed" and leader.name not in positions:
        # so far: position of the joint = multiplier * position of the leader + offset
        offset += multiplier * leader.mimic.offset
        multiplier *= leader.mimic.multiplier
        name = leader.mimic.joint
        if name not in by_name or name in chain:
            if any(each in locked for each in chain):
                return _fixed(joint, 0.0)
            hint = "in a circle" if name in chain else f"which does not exist ({near_names(name, by_name)})"
            raise DescriptionError(f"mimics {name!r}, {hint}")
        chain.append(name)
        leader = by_name[name]
    if leader.kind == "fixed" or multiplier == 0 or any(name in locked for name in chain):
        return _fixed(joint, multiplier * positions.get(leader.name, 0.0) + offset)
    mimic = None if leader is joint else Mimic(leader.name, multiplier, offset)
    return dataclasses.replace(joint, mimic=mimic)


def _fixed(joint: UrdfJoint, position: float) -> UrdfJoint:
    """Fixed joint with the placement that a joint has at a position [rad or m]."""
    motion, (x, y, z) = np.eye(4), joint.axis
    if joint.kind == "prismatic":
        motion[:3, 3] = position * joint.axis
    else:
        # rotation by Rodrigues' formula
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        motion[:3, :3] += np.sin(position) * skew + (1 - np.cos(position)) * skew @ skew
    return dataclasses.replace(joint, kind="fixed", origin=frozen(joint.origin @ motion), mimic=None)
