"""Elements of URDF text, from which generators build files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from spacerobot.common.errors import DescriptionError

PALETTE: dict[str, str] = {
    "gold": "0.83 0.62 0.20 1",
    "white": "0.93 0.94 0.95 1",
    "orange": "0.95 0.45 0.10 1",
    "graphite": "0.20 0.22 0.25 1",
    "panel": "0.07 0.13 0.40 1",
    "silver": "0.66 0.69 0.73 1",
    "debris": "0.42 0.50 0.47 1",
    "mate": "0.80 0.12 0.16 1",
}
"""Colours (red, green, blue, opacity) of shipped and generated URDFs."""


def number(value: float) -> str:
    """Text of a number with up to 15 significant digits, without trailing zeros."""
    return f"{float(value) + 0.0:.15g}"


def numbers(values: Iterable[float]) -> str:
    """Text of numbers, separated by spaces."""
    return " ".join(number(value) for value in values)


def origin(xyz: Sequence[float] = (0, 0, 0), rpy: Sequence[float] = (0, 0, 0)) -> str:
    """``<origin>`` of a position [m] and fixed-axis roll, pitch, yaw [rad]; empty for the identity."""
    if not any((*xyz, *rpy)):
        return ""
    turn = f' rpy="{" ".join(repr(float(angle)) for angle in rpy)}"' if any(rpy) else ""
    return f'<origin xyz="{numbers(xyz)}"{turn}/>'


def box(size: Sequence[float]) -> str:
    """``<box>`` with edge lengths along x, y, z (3,) [m]."""
    return f'<box size="{numbers(size)}"/>'


def cylinder(radius_m: float, length_m: float) -> str:
    """``<cylinder>`` about z, centred at its origin."""
    return f'<cylinder radius="{number(radius_m)}" length="{number(length_m)}"/>'


def sphere(radius_m: float) -> str:
    """``<sphere>`` centred at its origin."""
    return f'<sphere radius="{number(radius_m)}"/>'


def shape(kind: str, geometry: str, colour: str, place: str = "") -> list[str]:
    """Lines of a ``<visual>``, in a colour of :data:`PALETTE`, or of a ``<collision>``."""
    lines = [
        f"    <{kind}>",
        *([f"      {place}"] if place else []),
        f"      <geometry>{geometry}</geometry>",
    ]
    if kind == "visual":
        lines.append(f'      <material name="{colour}"/>')
    return [*lines, f"    </{kind}>"]


def visual_and_collision(geometry: str, colour: str, place: str = "") -> list[str]:
    """Lines of a ``<visual>`` and a ``<collision>`` of the same geometry."""
    return shape("visual", geometry, colour, place) + shape("collision", geometry, colour, place)


def inertial(
    mass_kg: float,
    ixx_iyy_izz: Sequence[float],
    com: Sequence[float] = (0, 0, 0),
    ixy_ixz_iyz: Sequence[float] = (0, 0, 0),
) -> list[str]:
    """Lines of an ``<inertial>``; the inertia [kg m^2] is about the centre of mass, link axes."""
    ixx, iyy, izz = (number(value) for value in ixx_iyy_izz)
    ixy, ixz, iyz = (number(value) for value in ixy_ixz_iyz)
    place = origin(com)
    return [
        "    <inertial>",
        *([f"      {place}"] if place else []),
        f'      <mass value="{number(mass_kg)}"/>',
        f'      <inertia ixx="{ixx}" ixy="{ixy}" ixz="{ixz}" iyy="{iyy}" iyz="{iyz}" izz="{izz}"/>',
        "    </inertial>",
    ]


def link(name: str, *parts: list[str]) -> list[str]:
    """Lines of a ``<link>``."""
    body = [line for part in parts for line in part]
    return [f'  <link name="{name}">', *body, "  </link>"] if body else [f'  <link name="{name}"/>']


def fixed(name: str, parent: str, child: str, place: str) -> list[str]:
    """Lines of a fixed ``<joint>``."""
    return _joint(name, "fixed", parent, child, place, [])


@dataclass(frozen=True)
class Hinge:
    """Axis, limits and viscous damping of a revolute joint; a single ``limit_rad`` applies to both sides."""

    axis: Sequence[float]
    limit_rad: float | tuple[float, float]
    effort_n_m: float
    velocity_rad_s: float
    damping_n_m_s: float


def revolute(name: str, parent: str, child: str, place: str, hinge: Hinge) -> list[str]:
    """Lines of a revolute ``<joint>``."""
    limit_rad = hinge.limit_rad
    lower, upper = limit_rad if isinstance(limit_rad, tuple) else (-limit_rad, limit_rad)
    limit = f'lower="{number(lower)}" upper="{number(upper)}"'
    lines = [
        f'    <axis xyz="{numbers(hinge.axis)}"/>',
        f'    <limit {limit} effort="{number(hinge.effort_n_m)}" velocity="{number(hinge.velocity_rad_s)}"/>',
        f'    <dynamics damping="{number(hinge.damping_n_m_s)}" friction="0"/>',
    ]
    return _joint(name, "revolute", parent, child, place, lines)


def _joint(name: str, kind: str, parent: str, child: str, place: str, lines: list[str]) -> list[str]:
    head = [
        f'  <joint name="{name}" type="{kind}">',
        f'    <parent link="{parent}"/>',
        f'    <child link="{child}"/>',
        *([f"    {place}"] if place else []),
    ]
    return [*head, *lines, "  </joint>"]


def robot(name: str, comment: str, *parts: list[str]) -> str:
    """Text of a URDF file: header, used colours, links and joints.

    Raises:
        DescriptionError: If the name is empty or has characters other than letters, digits, ``_``, ``.``,
            ``-``.
    """
    if not re.fullmatch(r"[A-Za-z0-9_.-]+", name):
        raise DescriptionError(f"found {name!r}, allowed: letters, digits, '_', '.' and '-'", where="name")
    body = [line for part in parts for line in part]
    used = {colour: rgba for colour, rgba in PALETTE.items() if f'name="{colour}"' in "\n".join(body)}
    colours = [
        f'  <material name="{colour}"><color rgba="{rgba}"/></material>' for colour, rgba in used.items()
    ]
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f"<!-- {comment} -->",
        f'<robot name="{name}">',
        *colours,
        *body,
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def require_in_range(where: str, value: float, low: float, high: float) -> None:
    """Check that a number is in a range; NaN is not.

    Raises:
        DescriptionError: If it is not; the message has the name of the parameter and the range.
    """
    if not low <= value <= high:
        raise DescriptionError(f"found {value!r}, allowed: {low:g} to {high:g}", where=where)
