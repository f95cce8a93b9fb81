"""Descriptions of robots and objects: search, reading, checks and writing of URDF and MJCF."""

from spacerobot.description.find import find_urdf, shipped_names, shipped_urdf_folder
from spacerobot.description.parts import Geometry, LinkShape, UrdfJoint, UrdfLink
from spacerobot.description.planar import PlanarBase, PlanarLink, planar_arm_urdf, rectangle_urdf
from spacerobot.description.read import Description, read_description

__all__ = [
    "Description",
    "Geometry",
    "LinkShape",
    "PlanarBase",
    "PlanarLink",
    "UrdfJoint",
    "UrdfLink",
    "find_urdf",
    "planar_arm_urdf",
    "read_description",
    "rectangle_urdf",
    "shipped_names",
    "shipped_urdf_folder",
]
