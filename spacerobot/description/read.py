"""Read a URDF, check that it can be simulated, and hand it to Pinocchio."""

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
"""Larger files are refused."""


@dataclass(frozen=True, eq=False)
class Description:
    """Contents of a URDF; mass properties and mimic joints are not yet verified.

    Attributes:
        name: Name of the robot.
        path, sha256: The file, absolute, and the hash of its bytes in hexadecimal; of a xacro file, of what
            it expands to.
        root: Name of the base: the link without a parent.
        links, joints: In the order of the file.
        warnings: What was ignored or assumed, one line each.
    """

    name: str
    path: Path
    sha256: str
    root: str
    links: tuple[UrdfLink, ...]
    joints: tuple[UrdfJoint, ...]
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        """Name, file and size, in one line."""
        return (
            f"<Description {self.name}: {self.path.name}, {len(self.links)} links, {len(self.joints)} joints>"
        )

    def to_pinocchio_xml(self, prefix: str) -> str:
        """URDF text for ``pinocchio.buildModelFromXML`` and ``buildGeomFromUrdfString``.

        Every link and joint is named ``prefix`` + its own name. Inertias stand in link axes, axes have unit
        length, meshes have absolute paths, and a box stands where a mesh is missing.

        Args:
            prefix: ``rpr1/`` for example; may be empty.
        """
        from spacerobot.description.write import urdf_xml

        return urdf_xml(self.name, self.links, self.joints, prefix)

    def settled(self, positions: Mapping[str, float], locked: Collection[str]) -> Description:
        """Description with some joints locked; see :func:`spacerobot.description.mimic.settle`.

        Args:
            positions: Initial joint positions by name [rad or m].
            locked: Names of the locked joints.

        Raises:
            DescriptionError: If joints that are not locked mimic a joint that does not exist, or each other
                in a circle.
        """
        return replace(self, joints=settle(self.joints, positions, locked, self.path))


def read_description(path: StrPath, expanded: str | None = None) -> Description:
    """Read and check a URDF, or a robot in MJCF (``<mujoco>``), MuJoCo's format.

    Args:
        path: The file; see :func:`spacerobot.description.find.find_urdf` for names.
        expanded: URDF text that a file named ``*.xacro`` expands to; the file is expanded if None.

    Raises:
        DescriptionError: If the file cannot be read or holds something that cannot be simulated: planar or
            floating joints, a closed loop, several roots, a zero axis, a number that is not finite. Names the
            file and the element. Mass properties and mimicry are judged with the scene, which may change
            masses, lock joints and fix the base.
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
    """Description of a robot in MuJoCo's format."""
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
    """One line for each thing that is ignored, assumed or strange, with the joints it concerns."""
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
