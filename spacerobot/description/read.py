"""Reading and checking of robot descriptions in URDF, xacro or MJCF, and their text for Pinocchio."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from spacerobot.common.errors import DescriptionError
from spacerobot.common.files import StrPath
from spacerobot.description.mimic import settle
from spacerobot.description.parts import UrdfJoint, UrdfLink
from spacerobot.description.syntax import check_syntax, parse_xml
from spacerobot.description.topology import root_link
from spacerobot.description.xacro import SUFFIX, expand_xacro, refuse_xacro

MOST_BYTES = 20_000_000
"""Maximum size of a file [bytes]."""


@dataclass(frozen=True, eq=False)
class Description:
    """Content of a robot description; mass properties and mimic joints are checked later, with the scene.

    Attributes:
        name: Name of the robot.
        path: Absolute path of the file.
        sha256: Hexadecimal hash of the file's content, or of the expanded text of a xacro file.
        root: Name of the base link, the only link without a parent.
        links, joints: Links and joints in the order of the file.
        warnings: Warnings about ignored elements and assumptions, one line each.
    """

    name: str
    path: Path
    sha256: str
    root: str
    links: tuple[UrdfLink, ...]
    joints: tuple[UrdfJoint, ...]
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        """Name, file, and numbers of links and joints, in one line."""
        return (
            f"<Description {self.name}: {self.path.name}, {len(self.links)} links, {len(self.joints)} joints>"
        )

    def to_pinocchio_xml(self, prefix: str) -> str:
        """URDF text for ``pinocchio.buildModelFromXML`` and ``buildGeomFromUrdfString``.

        Inertias are in link axes, joint axes have unit length, meshes have absolute paths, and boxes replace
        missing meshes.

        Args:
            prefix: Prefix of the names of links and joints, such as ``rpr1/``; may be empty.
        """
        from spacerobot.description.write import urdf_xml

        return urdf_xml(self.name, self.links, self.joints, prefix)

    def settled(self, positions: Mapping[str, float], locked: Collection[str]) -> Description:
        """Description with resolved locked and mimic joints; see :func:`spacerobot.description.mimic.settle`.

        Args:
            positions: Initial joint positions by name [rad or m].
            locked: Names of the locked joints.

        Raises:
            DescriptionError: If joints that are not locked mimic a joint that does not exist, or each other
                in a circle.
        """
        return replace(self, joints=settle(self.joints, positions, locked, self.path))


def read_description(path: StrPath, expanded: str | None = None) -> Description:
    """Read and check a robot description in URDF, xacro, or MJCF (``<mujoco>``), MuJoCo's format.

    Mass properties and mimic joints are checked with the scene, which may change masses, lock joints and fix
    the base.

    Args:
        path: The file; :func:`spacerobot.description.find.find_urdf` finds files by name.
        expanded: Expanded URDF text of a file named ``*.xacro``; the file is expanded if None.

    Raises:
        DescriptionError: If the file cannot be read, or has unsupported or invalid content: planar or
            floating joints, a closed loop, several roots, a zero axis, a number that is not finite. The
            message has the file and the element.
    """
    from spacerobot.description.convert import convert_joint, convert_links, parse_urdf

    source = Path(path).absolute()
    if source.suffix == SUFFIX:
        data = (expand_xacro(source) if expanded is None else expanded).encode()
    else:
        data = _read_bytes(source)
    tree = parse_xml(data, source)
    if tree.tag == "mujoco":
        return _from_mjcf(data, source)
    refuse_xacro(tree, source)
    warnings = check_syntax(tree, source)
    robot = parse_urdf(tree, source)
    joints = tuple(convert_joint(joint, source) for joint in robot.joints)
    links, mesh_warnings = convert_links(robot, source)
    root = root_link(links, joints, source)
    without_dynamics = {joint.name for joint in robot.joints if joint.dynamics is None}
    warnings += mesh_warnings + _joint_warnings(joints, without_dynamics)
    return Description(
        name=robot.name,
        path=source,
        sha256=hashlib.sha256(data).hexdigest(),
        root=root,
        links=links,
        joints=joints,
        warnings=tuple(warnings),
    )


def _from_mjcf(data: bytes, source: Path) -> Description:
    """Description of a robot in MJCF."""
    from spacerobot.description.mjcf import read_mjcf, warnings_of

    model, name = read_mjcf(data, source)
    links, joints = tuple(model.links), tuple(model.joints)
    return Description(
        name=name,
        path=source,
        sha256=hashlib.sha256(model.tree.data).hexdigest(),
        root=root_link(links, joints, source),
        links=links,
        joints=joints,
        warnings=(*warnings_of(model), *_joint_warnings(joints, ())),
    )


def _joint_warnings(joints: Sequence[UrdfJoint], without_dynamics: Collection[str]) -> list[str]:
    """Warnings about ignored or unusual properties of joints, with the names of the joints."""
    moving = [joint for joint in joints if joint.kind != "fixed"]
    concerned = {
        "no <dynamics>, damping taken as 0": [joint for joint in moving if joint.name in without_dynamics],
        "dry friction ignored": [joint for joint in moving if joint.friction > 0],
        "the effort limit is 0": [joint for joint in moving if joint.effort == 0],
        "the range is empty": [joint for joint in moving if joint.lower == joint.upper],
    }
    return [
        f"{what}: joint{'s' if len(names) > 1 else ''} {', '.join(joint.name for joint in names)}"
        for what, names in concerned.items()
        if names
    ]


def _read_bytes(source: Path) -> bytes:
    try:
        size = source.stat().st_size
        if not source.is_file():
            raise DescriptionError("is no file", source=source)
        if size > MOST_BYTES:
            raise DescriptionError(f"is {size} bytes long, allowed are {MOST_BYTES}", source=source)
        return source.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise DescriptionError(f"cannot be read: {reason}", source=source) from error
