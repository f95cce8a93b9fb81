"""Arms mounted on a bus, as a draft names them: ``NAME=arm.urdf@x,y,z,roll,pitch,yaw``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from spacerobot.common.errors import ScenarioError
from spacerobot.description.mount import mounted
from spacerobot.description.read import Description
from spacerobot.drafting.arms import as_name, read
from spacerobot.scenario.paths import Document

FORM = "[NAME=]URDF[@x,y,z[,roll,pitch,yaw]]"


@dataclass(frozen=True)
class DraftMount:
    """An arm on a bus.

    Attributes:
        name: Prefix of its links and joints.
        urdf: As the scenario names it.
        description: The URDF.
        position, rotation_deg: Of its root link in the bus's root link: [m], and roll, pitch, yaw [deg].
    """

    name: str
    urdf: str
    description: Description
    position: tuple[float, float, float]
    rotation_deg: tuple[float, float, float]

    def section(self) -> Document:
        """Its section in a scenario."""
        found: Document = {"urdf": self.urdf, "position": list(self.position)}
        return found | ({"rotation_deg": list(self.rotation_deg)} if any(self.rotation_deg) else {})


def read_mounts(texts: Sequence[str], folder: Path) -> list[DraftMount]:
    """Arms of a bus, with names that differ.

    Args:
        texts: ``[NAME=]URDF[@x,y,z[,roll,pitch,yaw]]`` each: [m] and [deg]; named after the URDF, and placed
            at the origin of the bus, where that is left out.
        folder: Of the scenario.

    Raises:
        ScenarioError, DescriptionError: If a text is none of these, two names are the same, or a URDF cannot
            be used.
    """
    found = list[DraftMount]()
    for text in texts:
        rest, at, place = text.rpartition("@")
        rest, numbers = (rest, place.split(",")) if at else (text, [])
        name, named, urdf = rest.partition("=")
        try:
            values = [float(number) for number in numbers]
        except ValueError:
            values = [np.nan]
        if len(values) not in (0, 3, 6) or not np.isfinite(values).all() or not (urdf if named else name):
            raise ScenarioError(f"found {text!r}, allowed: {FORM}, [m] and [deg]", where="--mount")
        path, description = read(urdf if named else name, folder)
        taken = [mount.name for mount in found]
        if named and (name in taken or as_name(name) != name):
            raise ScenarioError(
                f"found {name!r}, allowed: a name of letters and digits that no other mount has",
                where="--mount",
            )
        prefix = name if named else as_name(description.path.stem, taken)
        x, y, z, roll, pitch, yaw = [*values, *[0.0] * (6 - len(values))]
        found.append(DraftMount(prefix, path, description, (x, y, z), (roll, pitch, yaw)))
    if not found:
        raise ScenarioError(f"found --bus without an arm, allowed: --mount {FORM}", where="--mount")
    return found


def equipped(bus: Description, mounts: Sequence[DraftMount]) -> Description:
    """The bus with its arms as one description.

    Raises:
        DescriptionError: If a name is there twice.
    """
    for mount in mounts:
        placement = np.eye(4)
        placement[:3, :3] = pin.rpy.rpyToMatrix(np.radians(mount.rotation_deg))
        placement[:3, 3] = mount.position
        bus = mounted(bus, mount.description, mount.name, None, placement)
    return bus
