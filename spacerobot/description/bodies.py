"""Links that fixed joints weld together move as one body, and that body needs mass and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spacerobot.description.parts import Array, Joint, Link
from spacerobot.errors import DescriptionError

_ROUNDING = 1e-9  # relative; files print inertias with few digits
_SINGULAR = 1e-12  # smallest ratio of principal inertias that a mass matrix survives
_TINY_BASE = 1e-3  # of another link's mass or inertia


@dataclass(frozen=True, eq=False)
class Body:
    """Links welded together, named after the uppermost; kg, and kg m^2 about the common centre of mass."""

    name: str
    mass: float
    inertia: Array


def check_links(links: Sequence[Link], source: Path) -> list[str]:
    """Check each link by itself.

    Returns
    -------
    list[str]
        Warnings about inertias that no distribution of mass has.

    Raises
    ------
    DescriptionError
        If an inertia has a negative principal value, or belongs to no mass.
    """
    warnings = []
    for link in links:
        where = f"link {link.name!r}"
        if link.mass == 0:
            if np.any(link.inertia):
                raise DescriptionError("has an inertia but no mass", source=source, where=where)
            continue
        principal = _principal(link.inertia)
        if principal[0] < -_ROUNDING * principal[2]:
            raise DescriptionError(
                f"inertia is not positive definite, principal values {_listed(principal)} kg m^2",
                source=source,
                where=where,
            )
        if principal[0] + principal[1] < (1 - _ROUNDING) * principal[2]:
            warnings.append(
                f"{where}: no body has principal inertias {_listed(principal)} kg m^2: "
                "the largest exceeds the sum of the others"
            )
    return warnings


def welded_bodies(links: Sequence[Link], joints: Sequence[Joint], root: str) -> list[Body]:
    """Bodies that move as one, the base first; each named after its uppermost link."""
    by_name = {link.name: link for link in links}
    below: dict[str, list[Joint]] = {link.name: [] for link in links}
    for joint in joints:
        below[joint.parent].append(joint)
    bodies, tops = [], [root]
    while tops:
        top = tops.pop()
        group = [(by_name[top], np.eye(4))]
        for link, placement in group:  # grows while it is walked
            for joint in below[link.name]:
                if joint.kind == "fixed":
                    group.append((by_name[joint.child], placement @ joint.origin))
                else:
                    tops.append(joint.child)
        bodies.append(_composite(top, group))
    return bodies


def _composite(name: str, group: Sequence[tuple[Link, Array]]) -> Body:
    """Sum of rigid bodies by the parallel-axis theorem."""
    mass = sum(link.mass for link, _ in group)
    if mass == 0:
        return Body(name, 0.0, np.zeros((3, 3)))
    centres = [placement[:3, :3] @ link.com + placement[:3, 3] for link, placement in group]
    com = sum(
        (link.mass / mass * centre for (link, _), centre in zip(group, centres, strict=True)), np.zeros(3)
    )
    inertia = np.zeros((3, 3))
    for (link, placement), centre in zip(group, centres, strict=True):
        turn, arm = placement[:3, :3], centre - com
        inertia += turn @ link.inertia @ turn.T + link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Body(name, mass, inertia)


def check_moving_bodies(bodies: Sequence[Body], source: Path) -> None:
    """Check that each body but the base can be accelerated about and along every axis.

    Raises
    ------
    DescriptionError
        If a body has no mass, or a principal inertia that vanishes or is not finite.
    """
    for body in bodies[1:]:
        _check_body(body, "a moving link", "", source)


def check_floating_base(bodies: Sequence[Body], source: Path) -> None:
    """Check the same of the base, which only has to have mass where it floats.

    Raises
    ------
    DescriptionError
        As for :func:`check_moving_bodies`.
    """
    _check_body(bodies[0], "the base", "; give it some, or connect it by `base: {joint: fixed}`", source)


def _check_body(body: Body, what: str, remedy: str, source: Path) -> None:
    where = f"link {body.name!r}"
    if body.mass == 0:
        raise DescriptionError(
            f"is {what} and has no mass, nor has anything fixed to it{remedy}", source=source, where=where
        )
    principal = _principal(body.inertia)
    if not principal[0] > _SINGULAR * principal[2]:
        raise DescriptionError(
            f"is {what}; its inertia is not positive definite: {_listed(principal)} kg m^2, allowed are "
            "principal values above 0, in a planar robot too",
            source=source,
            where=where,
        )


def light_base(bodies: Sequence[Body]) -> list[str]:
    """Warnings about a floating base that the rest of the robot throws about."""
    base, rest = bodies[0], bodies[1:]
    warnings = []
    if any(base.mass < _TINY_BASE * body.mass for body in rest):
        warnings.append(f"link {base.name!r}: the base has only {base.mass:g} kg, other links far more")
    inertia = _principal(base.inertia)[0]
    if any(inertia < _TINY_BASE * _principal(body.inertia)[0] for body in rest):
        warnings.append(f"link {base.name!r}: the base has only {inertia:.3g} kg m^2, other links far more")
    return warnings


def _principal(inertia: Array) -> Array:
    """Principal inertias in ascending order (3,); nan where they are not finite."""
    if not np.all(np.isfinite(inertia)):
        return np.full(3, np.nan)
    return np.linalg.eigvalsh(inertia).astype(np.float64)


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
