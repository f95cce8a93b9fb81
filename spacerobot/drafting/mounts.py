"""Arms mounted on a bus, from texts such as ``NAME=arm.urdf@x,y,z,roll,pitch,yaw``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from spacerobot.common.errors import ScenarioError
from spacerobot.description.mount import mounted
from spacerobot.description.read import Description
from spacerobot.drafting.arms import as_name, name_of, read
from spacerobot.scenario.paths import Document

FORM = "[NAME=]URDF[@x,y,z[,roll,pitch,yaw]]"


@dataclass(frozen=True)
class DraftMount:
    """An arm on a bus.

    Attributes:
        name: Prefix of the arm's links and joints.
        urdf: Name or path of the URDF in the scenario.
        description: Description of the arm.
        position, rotation_deg: Position [m] and roll, pitch, yaw [deg] of the arm's root link in the bus's.
    """

    name: str
    urdf: str
    description: Description
    position: tuple[float, float, float]
    rotation_deg: tuple[float, float, float]

    def section(self) -> Document:
        """Section of the mount in a scenario."""
        section: Document = {"urdf": self.urdf, "position": list(self.position)}
        return section | ({"rotation_deg": list(self.rotation_deg)} if any(self.rotation_deg) else {})


def read_mounts(texts: Sequence[str], folder: Path) -> list[DraftMount]:
    """Read the arms of a bus.

    Args:
        texts: Texts ``[NAME=]URDF[@x,y,z[,roll,pitch,yaw]]``, in [m] and [deg]. The default name is that of
            the URDF, the default placement the origin of the bus.
        folder: Folder of the scenario.

    Raises:
        ScenarioError, DescriptionError: If a text has another form, two names are equal, or a URDF cannot be
            used.
    """
    mounts = list[DraftMount]()
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
        mount_names = [mount.name for mount in mounts]
        if named and (name in mount_names or as_name(name) != name):
            raise ScenarioError(
                f"found {name!r}, allowed: a name of letters and digits that no other mount has",
                where="--mount",
            )
        prefix = name if named else name_of(description, mount_names)
        x, y, z, roll, pitch, yaw = [*values, *[0.0] * (6 - len(values))]
        mounts.append(DraftMount(prefix, path, description, (x, y, z), (roll, pitch, yaw)))
    if not mounts:
        raise ScenarioError(f"found --bus without an arm, allowed: --mount {FORM}", where="--mount")
    return mounts


def equipped(bus: Description, mounts: Sequence[DraftMount]) -> Description:
    """Description of a bus with its arms.

    Raises:
        DescriptionError: If two links or joints have the same name.
    """
    for mount in mounts:
        placement = np.eye(4)
        placement[:3, :3] = pin.rpy.rpyToMatrix(np.radians(mount.rotation_deg))
        placement[:3, 3] = mount.position
        bus = mounted(bus, mount.description, mount.name, None, placement)
    return bus
