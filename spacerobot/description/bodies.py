"""Rigid bodies of links joined by fixed joints, and checks of their mass and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError
from spacerobot.description.parts import UrdfJoint, UrdfLink

_ROUNDING = 1e-9  # relative; files have inertias with few digits
_TINY_BASE = 1e-3  # mass or inertia of a base relative to another body, below which a warning is issued


@dataclass(eq=False)
class RigidBody:
    """Links joined by fixed joints.

    Attributes:
        name: Name of the link nearest to the base.
        mass: Mass [kg].
        inertia: Inertia about the common centre of mass, axes of the named link (3, 3) [kg m^2].
        extent: Sum over the links of mass times squared distance from the body's origin [kg m^2], the scale
            of rounding errors in ``inertia``.
        joint: Name of the joint that moves the body, or of the joint that this one mimics; None for the base.
        carries: Whether a body with mass is connected to it further along the chain.
    """

    name: str
    mass: float
    inertia: Array
    extent: float
    joint: str | None = None
    carries: bool = False


def welded_bodies(links: Sequence[UrdfLink], joints: Sequence[UrdfJoint], root: str) -> list[RigidBody]:
    """Rigid bodies of a description, the base first; links joined by fixed joints are one body."""
    by_name = {link.name: link for link in links}
    below: dict[str, list[UrdfJoint]] = {link.name: [] for link in links}
    for joint in joints:
        below[joint.parent].append(joint)
    bodies: list[RigidBody] = []
    above: list[int | None] = []
    tops: list[tuple[str, str | None, int | None]] = [(root, None, None)]
    while tops:
        top, merged, parent = tops.pop()
        group = [(by_name[top], np.eye(4))]
        for link, placement in group:  # the list grows during the loop
            for joint in below[link.name]:
                if joint.kind == "fixed":
                    group.append((by_name[joint.child], placement @ joint.origin))
                else:
                    moved_by = joint.mimic.joint if joint.mimic else joint.name
                    tops.append((joint.child, moved_by, len(bodies)))
        # inertia about the common centre of mass by the parallel-axis theorem
        mass = sum(link.mass for link, _ in group)
        centres = [placement[:3, :3] @ link.com + placement[:3, 3] for link, placement in group]
        moment = sum((link.mass * c for (link, _), c in zip(group, centres, strict=True)), np.zeros(3))
        com = moment / mass if mass > 0 else moment
        inertia = np.zeros((3, 3))
        for (link, placement), centre in zip(group, centres, strict=True):
            turn, arm = placement[:3, :3], centre - com
            inertia += turn @ link.inertia @ turn.T + link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        extent = sum(link.mass * float(c @ c) for (link, _), c in zip(group, centres, strict=True))
        bodies.append(RigidBody(top, mass, inertia, extent, merged))
        above.append(parent)
    for body, parent in reversed(list(zip(bodies, above, strict=True))):
        if parent is not None and (body.mass > 0 or body.carries):
            bodies[parent].carries = True
    return bodies


def check_bodies(bodies: Sequence[RigidBody], source: Path, *, floating: bool) -> None:
    """Check that moving bodies have mass and inertias that are not negative.

    A body without mass is allowed between two joints of a chain. A fixed base is not checked. Whether every
    joint moves some inertia depends on the posture and is checked with the scene.

    Args:
        bodies: Rigid bodies, the base first.
        source: File for error messages.
        floating: Whether the base floats.

    Raises:
        DescriptionError: If a body has no mass and moves none, has an inertia without mass, or has a
            principal inertia that is negative or not finite. The message has the names of all such bodies and
            of the joints that may be locked instead.
    """
    if floating:
        fault = _fault(bodies[0], is_base=True)
        if fault:
            remedy = "; give it some, or connect it by `base: {joint: fixed}`" if bodies[0].mass == 0 else ""
            where = f"link {bodies[0].name!r}"
            raise DescriptionError(f"is the base; it {fault}{remedy}", source=source, where=where)
    faulty = [(body, fault) for body in bodies[1:] if (fault := _fault(body))]
    if not faulty:
        return
    first, fault = faulty[0]
    others = [body.name for body, _ in faulty[1:]]
    too = f"; faults as well: {', '.join(others)}" if others else ""
    joints = dict.fromkeys(str(body.joint) for body, _ in faulty)
    raise DescriptionError(
        f"is a moving link; it {fault}{too}. Give mass properties by `links:`, or lock joint"
        f"{'s' if len(joints) > 1 else ''} {', '.join(joints)} by `joints: {{NAME: {{locked: true}}}}`",
        source=source,
        where=f"link {first.name!r}",
    )


def _fault(body: RigidBody, *, is_base: bool = False) -> str:
    """Reason why a body cannot be accelerated; empty if it can."""
    if body.mass == 0 and np.any(body.inertia):
        return "has an inertia but no mass"
    if body.mass == 0:
        if body.carries and not is_base:
            return ""
        return "has no mass, nor has anything fixed to it" + ("" if is_base else " or moved by it")
    principal = _principal(body.inertia)
    if principal[0] >= -_ROUNDING * max(principal[2], body.extent):
        return ""
    return f"has principal inertias {_listed(principal)} kg m^2, allowed: none below 0"


def odd_bodies(bodies: Sequence[RigidBody], *, floating: bool, pieces: tuple[str, ...] = ()) -> list[str]:
    """Warnings about moving bodies without mass, impossible inertias, and a very light floating base.

    Inertias are impossible if they violate the triangle inequality.

    Args:
        bodies: Rigid bodies, the base first.
        floating: Whether the base floats.
        pieces: Beginnings of the names of flexible links' pieces, some of which have no mass.
    """
    warnings = [
        f"link {body.name!r}: joint {body.joint} moves it, but neither it nor a link fixed to it has mass "
        "and inertia; if <inertial> was forgotten, add it, or give mass properties by `links`"
        for body in bodies[1:]
        if body.mass == 0 and not body.name.startswith(pieces)
    ]
    for body in bodies if floating else bodies[1:]:
        principal = _principal(body.inertia)
        if principal[0] + principal[1] < (1 - _ROUNDING) * principal[2]:
            warnings.append(
                f"link {body.name!r}: no body has principal inertias {_listed(principal)} kg m^2: "
                "the largest exceeds the sum of the others"
            )
    base, rest = bodies[0], bodies[1:]
    if floating and any(base.mass < _TINY_BASE * body.mass for body in rest):
        warnings.append(f"link {base.name!r}: the base has only {base.mass:g} kg, other links far more")
    inertia = _principal(base.inertia)[0]
    if floating and any(inertia < _TINY_BASE * _principal(body.inertia)[0] for body in rest):
        warnings.append(f"link {base.name!r}: the base has only {inertia:.3g} kg m^2, other links far more")
    return warnings


def _principal(inertia: Array) -> Array:
    """Principal inertias in ascending order (3,) [kg m^2]; NaN if an entry is not finite."""
    if not np.all(np.isfinite(inertia)):
        return np.full(3, np.nan)
    return np.linalg.eigvalsh(inertia).astype(np.float64)


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
