"""URDFs of planar arms and rectangles from a few numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from spacerobot.common.files import StrPath

if TYPE_CHECKING:
    from spacerobot.description import Description, PlanarBase, PlanarLink


def make_arm(
    file: StrPath,
    links: int = 8,
    link: PlanarLink | None = None,
    base: PlanarBase | None = None,
    *,
    damping: float = 0.1,
) -> Description:
    """Write the URDF of a floating base with a planar chain of links, by default the paper's robot.

    Args:
        file: URDF to write; an existing file is replaced. Its stem is the name of the robot.
        links: Number of links, 1 to 200.
        link: Length, mass and inertia of each link; the paper's if None.
        base: Mass, inertia and radius of the base; the paper's if None.
        damping: Viscous damping of every joint [N m s/rad].

    Returns:
        Description: The URDF, read from the file.

    Raises:
        DescriptionError: If a number is out of range.
        ResultError: If the file cannot be written.
    """
    from spacerobot.description.planar import planar_arm_urdf

    return _write(file, planar_arm_urdf(links, link, base, damping=damping, name=Path(file).stem))


def make_rectangle(
    file: StrPath,
    half_diagonal_m: float = 0.2,
    alpha_deg: float = 30.0,
    mass_kg: float = 20.0,
    inertia_kg_m2: float = 2.25,
) -> Description:
    """Write the URDF of a rectangle with a mating frame on each of two opposite sides (paper, Eq. 14, 15).

    Args:
        file: URDF to write; an existing file is replaced. Its stem is the name of the object.
        half_diagonal_m: Half of the diagonal, d [m].
        alpha_deg: Angle between the diagonal and the x axis [deg]; the frames are at -+d cos(alpha) on x.
        mass_kg: Mass [kg].
        inertia_kg_m2: Inertia about each axis through the centre of mass [kg m^2].

    Returns:
        Description: The URDF, read from the file.

    Raises:
        DescriptionError: If a number is out of range.
        ResultError: If the file cannot be written.
    """
    from spacerobot.description.planar import rectangle_urdf

    text = rectangle_urdf(half_diagonal_m, alpha_deg, mass_kg, inertia_kg_m2, name=Path(file).stem)
    return _write(file, text)


def _write(file: StrPath, text: str) -> Description:
    from spacerobot.common.files import write_text
    from spacerobot.description.read import read_description

    write_text(file, text)
    return read_description(file)
