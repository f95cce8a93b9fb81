"""``spacerobot make-arm``: write a planar arm or a rectangle as URDF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import spacerobot as sr
from spacerobot.cli.command import BEGIN, Command
from spacerobot.cli.output import console
from spacerobot.common.registry import COMMANDS

if TYPE_CHECKING:
    from spacerobot.description import Description

app = typer.Typer(
    name="make-arm",
    no_args_is_help=True,
    help="""Write a planar robot or a rectangle to hold as a URDF, from numbers.

Examples:

    spacerobot make-arm arm my_arm.urdf --links 4 --link-length 0.5

    spacerobot make-arm rectangle my_box.urdf --half-diagonal 0.3 --alpha 45
""",
)


File = Annotated[Path, typer.Argument(help="URDF file to write.")]


@app.command("arm")
def arm(
    file: File,
    links: Annotated[int, typer.Option(help="Number of links.")] = 8,
    link_length: Annotated[float, typer.Option(help="Length of a link [m].")] = 0.35,
    link_mass: Annotated[float, typer.Option(help="Mass of a link [kg].")] = 11.76,
    link_inertia: Annotated[
        list[float] | None,
        typer.Option(
            help="Inertia about the centre of mass [kg m^2]; several values are used in turn. Repeatable."
        ),
    ] = None,
    base_mass: Annotated[float, typer.Option(help="Mass of the base [kg].")] = 200.0,
    base_inertia: Annotated[float, typer.Option(help="Inertia of the base [kg m^2].")] = 40.0,
    base_radius: Annotated[float, typer.Option(help="From the base's centre to the first joint [m].")] = 0.4,
    damping: Annotated[float, typer.Option(help="Joint resistance [N m s/rad].")] = 0.1,
) -> None:
    """Write a floating base with a chain of links in the x-y plane; by default the paper's robot."""
    link = sr.PlanarLink(link_length, link_mass, tuple(link_inertia or sr.PlanarLink.inertia_kg_m2))
    base = sr.PlanarBase(base_mass, base_inertia, base_radius)
    _show(file, sr.make_arm(file, links, link, base, damping=damping))


@app.command("rectangle")
def rectangle(
    file: File,
    half_diagonal: Annotated[float, typer.Option(help="Half of the diagonal, d [m].")] = 0.2,
    alpha: Annotated[float, typer.Option(help="Angle of the diagonal to the x axis [deg].")] = 30.0,
    mass: Annotated[float, typer.Option(help="Mass [kg].")] = 20.0,
    inertia: Annotated[float, typer.Option(help="Inertia about z [kg m^2].")] = 2.25,
) -> None:
    """Write a rectangle with mating points at -+d cos(alpha) on its x axis (Eq. 14, 15)."""
    _show(file, sr.make_rectangle(file, half_diagonal, alpha, mass, inertia))


def _show(file: Path, description: Description) -> None:
    """Print the number of joints and the mass of a URDF."""
    moving = [joint for joint in description.joints if joint.kind != "fixed"]
    mass = sum(link.mass for link in description.links)
    console().print(f"{file}: {len(moving)} joints, {mass:g} kg", markup=False, soft_wrap=True)


COMMANDS.add(
    Command("make_arm", lambda parent: parent.add_typer(app, rich_help_panel=BEGIN), 2, BEGIN), __name__
)
