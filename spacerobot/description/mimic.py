"""Joints that have no coordinate of their own: they follow another one, or are locked."""

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
    """Joints with the locked ones made fixed, and each follower naming the free joint at its chain's end.

    A follower of a joint that does not move becomes fixed too; one that is locked itself follows no more.

    Args:
        joints: As in the file.
        positions: Where joints begin, by name [rad or m]; followers without one begin where they follow to,
            or at zero if that leads nowhere.
        locked: Names of the locked joints.
        source: The file, for errors.

    Raises:
        DescriptionError: If joints follow one that does not exist, or in a circle; names all of them.
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
            if any(passed in locked for passed in chain):
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
    """Fixed joint that keeps the place which a joint has at ``position`` [rad or m]."""
    motion, (x, y, z) = np.eye(4), joint.axis
    if joint.kind == "prismatic":
        motion[:3, 3] = position * joint.axis
    else:
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        motion[:3, :3] += np.sin(position) * skew + (1 - np.cos(position)) * skew @ skew
    return dataclasses.replace(joint, kind="fixed", origin=frozen(joint.origin @ motion), mimic=None)
