"""URDFs of the paper's planar robot and rectangular object (Table 1) with any dimensions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from spacerobot.common.errors import DescriptionError
from spacerobot.description import xml_text as x

_LIMIT_RAD = 2 * math.pi  # revolute, not continuous: the paper's joints turn by less than one revolution
_EFFORT_N_M = 1000.0
_VELOCITY_RAD_S = 10.0


@dataclass(frozen=True)
class PlanarLink:
    """Links of a planar arm, whose centres of mass are at half their length.

    Attributes:
        length_m: Distance between successive joints [m].
        mass_kg: Mass of every link [kg].
        inertia_kg_m2: Inertias about z through the centre of mass, repeated along the chain [kg m^2].
    """

    length_m: float = 0.35
    mass_kg: float = 11.76
    inertia_kg_m2: Sequence[float] = (0.2153, 0.0929)


@dataclass(frozen=True)
class PlanarBase:
    """The base of a planar arm.

    Attributes:
        mass_kg, inertia_kg_m2: Mass [kg], and inertia about each axis through the centre of mass [kg m^2],
            which is the origin of the base frame.
        radius_m: Distance of the first joint from that origin along x [m].
    """

    mass_kg: float = 200.0
    inertia_kg_m2: float = 40.0
    radius_m: float = 0.4


def planar_arm_urdf(
    links: int = 8,
    link: PlanarLink | None = None,
    base: PlanarBase | None = None,
    *,
    damping: float = 0.1,
    name: str = "planar_arm",
) -> str:
    """URDF of a free-floating base with a chain of equal links in its x-y plane (paper, Table 1).

    The links are ``base``, ``link_1`` ... ``link_n`` and the frame ``tip`` at the end of the last one. The
    joints ``joint_1`` ... ``joint_n`` rotate about z. The first one is at ``(base.radius_m, 0, 0)`` of the
    base, the others at ``(link.length_m, 0, 0)`` of the preceding link.

    Args:
        links: Number of links, 1 to 200.
        link, base: Dimensions of the links and of the base; the paper's if None.
        damping: Viscous damping of every joint [N m s/rad].
        name: Name of the robot.

    Raises:
        DescriptionError: If a number is out of range; the message has the name of the parameter.
    """
    link, base = link or PlanarLink(), base or PlanarBase()
    if isinstance(links, bool) or not isinstance(links, int):
        raise DescriptionError(f"found {links!r}, allowed: whole numbers from 1 to 200", where="links")
    x.require_in_range("links", links, 1, 200)
    x.require_in_range("link.length_m", link.length_m, 1e-3, 1e3)
    x.require_in_range("link.mass_kg", link.mass_kg, 1e-6, 1e9)
    if not link.inertia_kg_m2:
        raise DescriptionError("no number found, at least one is needed", where="link.inertia_kg_m2")
    for inertia in link.inertia_kg_m2:
        x.require_in_range("link.inertia_kg_m2", inertia, 1e-9, 1e12)
    x.require_in_range("base.mass_kg", base.mass_kg, 1e-6, 1e9)
    x.require_in_range("base.inertia_kg_m2", base.inertia_kg_m2, 1e-9, 1e12)
    x.require_in_range("base.radius_m", base.radius_m, 1e-3, 1e3)
    x.require_in_range("damping", damping, 0, 1e6)
    radius_m = base.radius_m
    half = 0.85 * radius_m
    body: list[str] = x.link(
        "base",
        x.inertial(base.mass_kg, (base.inertia_kg_m2,) * 3),
        x.visual_and_collision(x.box((2 * half, 2 * half, radius_m)), "gold"),
        x.visual_and_collision(
            x.cylinder(0.15 * radius_m, 0.5 * radius_m), "graphite", x.origin((radius_m, 0, 0))
        ),
        x.shape(
            "visual",
            x.box((0.4 * radius_m, 0.1 * radius_m, 0.1 * radius_m)),
            "silver",
            x.origin((-radius_m, 0, 0)),
        ),
        x.visual_and_collision(
            x.box((2 * radius_m, 1.5 * radius_m, 0.05 * radius_m)), "panel", x.origin((-2.2 * radius_m, 0, 0))
        ),
    )
    length = link.length_m
    width = 0.2 * length
    for index in range(links):
        # slender bar along x: m w^2 / 6 about x, limited so that the triangle inequality holds
        izz = link.inertia_kg_m2[index % len(link.inertia_kg_m2)]
        ixx = max(min(link.mass_kg * width**2 / 6, izz), 1e-3 * izz)
        body += x.link(
            f"link_{index + 1}",
            x.inertial(link.mass_kg, (ixx, izz, izz), (length / 2, 0, 0)),
            x.visual_and_collision(
                x.box((length, width, width)),
                "orange" if index % 2 else "white",
                x.origin((length / 2, 0, 0)),
            ),
            x.visual_and_collision(x.cylinder(0.14 * length, 1.3 * width), "graphite"),
        )
    hinge = x.Hinge((0, 0, 1), _LIMIT_RAD, _EFFORT_N_M, _VELOCITY_RAD_S, damping)
    parent, along = "base", base.radius_m
    for index in range(1, links + 1):
        body += x.revolute(f"joint_{index}", parent, f"link_{index}", x.origin((along, 0, 0)), hinge)
        parent, along = f"link_{index}", length
    body += x.link("tip", x.shape("visual", x.sphere(0.11 * length), "mate"))
    body += x.fixed("tip_mount", f"link_{links}", "tip", x.origin((length, 0, 0)))
    comment = f"Planar free-floating robot with {links} links; generated by spacerobot."
    return x.robot(name, comment, body)


def rectangle_urdf(
    half_diagonal_m: float = 0.2,
    alpha_deg: float = 30.0,
    mass_kg: float = 20.0,
    inertia_kg_m2: float = 2.25,
    thickness_m: float = 0.1,
    name: str = "rectangle",
) -> str:
    """URDF of the rectangular object with its two mating frames (paper, Eq. 14, 15 and Table 1).

    The origin of the root link ``body`` is the centre of mass. The frames ``mate_1`` at ``(-d cos(alpha), 0,
    0)`` and ``mate_2`` at ``(d cos(alpha), 0, 0)`` are at the centres of two opposite sides. Their x axes
    point into the object, like that of an arriving tip.

    Args:
        half_diagonal_m: Half of the rectangle's diagonal, d [m].
        alpha_deg: Angle between the diagonal and the x axis, 0 to 89 [deg]. The sides are 2 d cos(alpha)
            along x and 2 d sin(alpha) along y.
        mass_kg, inertia_kg_m2: Mass [kg], and inertia about each axis through the centre of mass [kg m^2].
        thickness_m: Length of the shapes along z [m].
        name: Name of the object.

    Raises:
        DescriptionError: If a number is out of range; the message has the name of the parameter.
    """
    x.require_in_range("half_diagonal_m", half_diagonal_m, 1e-3, 1e3)
    x.require_in_range("alpha_deg", alpha_deg, 0, 89)
    x.require_in_range("mass_kg", mass_kg, 1e-6, 1e9)
    x.require_in_range("inertia_kg_m2", inertia_kg_m2, 1e-9, 1e12)
    x.require_in_range("thickness_m", thickness_m, 1e-4, 1e3)
    reach = half_diagonal_m * math.cos(math.radians(alpha_deg))
    # at alpha = 0, the rectangle is a rod, drawn with a width of 0.5 % of its length
    width = 2 * max(half_diagonal_m * math.sin(math.radians(alpha_deg)), 0.005 * half_diagonal_m)
    dot = x.shape("visual", x.sphere(0.06 * half_diagonal_m), "mate")
    measures = f"2d = {x.number(2 * half_diagonal_m)} m, alpha = {x.number(alpha_deg)} deg"
    return x.robot(
        name,
        f"Rectangular object, {measures}; generated by spacerobot.",
        x.link(
            "body",
            x.inertial(mass_kg, (inertia_kg_m2,) * 3),
            x.visual_and_collision(x.box((2 * reach, width, thickness_m)), "debris"),
        ),
        x.link("mate_1", dot),
        x.link("mate_2", dot),
        x.fixed("mate_1_mount", "body", "mate_1", x.origin((-reach, 0, 0))),
        x.fixed("mate_2_mount", "body", "mate_2", x.origin((reach, 0, 0), (0, 0, math.pi))),
    )
