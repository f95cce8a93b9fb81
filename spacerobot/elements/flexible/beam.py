r"""Beam as a chain of rigid segments with springs between them.

A beam of length $l$, bending stiffness $E I$ and uniform mass is cut into $n$ segments of length $\Delta
x$. The compliance of each is concentrated in a hinge at its middle, with the stiffness $E I / \Delta x$;
the rigid pieces reach from hinge to hinge (rigid finite elements; E. Wittbrodt, I. Adamiec-Wojcik, S.
Wojciech, Dynamics of flexible multibody systems, Springer 2006). This is the midpoint rule for the integral
of the curvature, so that deflections and frequencies converge to those of the Euler-Bernoulli beam at
second order in $\Delta x$. Under a force $F$, or a couple $M$, at the end it deflects, or turns, by

$$ \frac{F l^3}{3 E I} \Bigl( 1 - \frac{1}{4 n^2} \Bigr), \qquad \frac{M l}{E I}. $$

Material damping is that of Kelvin and Voigt: the stress follows the strain and its rate,
$E (\varepsilon + T \dot\varepsilon)$. Torsion about the beam's axis is another joint of each hinge, with the
stiffness $G J / \Delta x$.

Axes of the joints of a hinge, axes of the link: `a` turns about ``normal`` if that is given. Otherwise `a`
turns about $e \times u$, where $e$ points along the beam and $u$ is the coordinate axis with the smallest
component of $e$, and `b` about $e \times a$. `t`, the torsion, turns about $e$.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal, Self

import casadi as ca
import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError
from spacerobot.common.section import Vector, quantity
from spacerobot.description.flexible import cut, extended, find_link, translation
from spacerobot.description.parts import UrdfJoint, UrdfLink, frozen
from spacerobot.description.read import Description
from spacerobot.elements.core.contribution import Contribution, Output
from spacerobot.elements.core.registry import register
from spacerobot.elements.flexible.flexible_link import FlexibleContext, FlexibleLink, Number


@register
class FlexibleBeam(FlexibleLink):
    """A boom or a panel that bends as a beam, in segments: length, bending stiffness, mass per length."""

    kind: Literal["beam"] = "beam"
    start: Vector = quantity(
        "m", "point where the beam is clamped, axes of the link", default=(0.0, 0.0, 0.0)
    )
    end: Vector = quantity("m", "its other end, axes of the link")
    segments: int = Field(default=4, ge=1, le=40, description="number of hinges, n")
    bending_stiffness: float | None = quantity(
        "N m^2", "E I; instead of `youngs_modulus` and `second_moment`", default=None, gt=0
    )
    youngs_modulus: float | None = quantity("Pa", "of the material, E", default=None, gt=0)
    second_moment: float | None = quantity("m^4", "second moment of the cross section, I", default=None, gt=0)
    normal: Vector | None = quantity(
        "1", "axis of the link about which it bends; about both across it if not given", default=None
    )
    torsional_stiffness: float | None = quantity(
        "N m^2", "G J; the beam does not twist if not given", default=None, gt=0
    )
    torsional_inertia: float | None = quantity(
        "kg m",
        "moment of inertia of what twists about the beam's axis, per length, part of the link's; the link's "
        "by the length if not given",
        default=None,
        gt=0,
    )
    damping_time: float = quantity(
        "s", "T; the ratio of a mode of angular frequency w is T w / 2", default=0.0, ge=0
    )
    mass_per_length: float | None = quantity(
        "kg/m",
        "of what bends, part of the link's mass; the rest stays at the start. The URDF's mass by the length "
        "if not given",
        default=None,
        ge=0,
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self._length > 0:
            raise ValueError("end: found `start`, allowed: another point")
        presence = [self.bending_stiffness is not None]
        presence += [self.youngs_modulus is not None, self.second_moment is not None]
        if presence not in ([True, False, False], [False, True, True]):
            raise ValueError("bending_stiffness: give it, or both `youngs_modulus` and `second_moment`")
        if self.torsional_inertia is not None and self.torsional_stiffness is None:
            raise ValueError("torsional_inertia: it belongs to `torsional_stiffness`; give that too")
        if self.normal is not None:
            length = np.linalg.norm(self.normal)
            if not length > 0 or abs(self._axis @ np.array(self.normal)) > 1e-6 * length:
                raise ValueError(f"normal: found {self.normal}, allowed: an axis at right angles to the beam")
        return self

    @property
    def _length(self) -> float:
        return float(np.linalg.norm(np.subtract(self.end, self.start)))

    @property
    def _axis(self) -> Array:
        direction: Array = np.subtract(self.end, self.start) / self._length
        return direction

    @property
    def _hinges(self) -> Array:
        """Places of the hinges along the beam (n,) [m]."""
        return (np.arange(self.segments) + 0.5) * self._length / self.segments

    @property
    def _turns(self) -> dict[str, Array]:
        """Axes of each hinge (3,), by the letter of its joint."""
        axis = self._axis
        twist = {} if self.torsional_stiffness is None else {"t": axis}
        if self.normal is not None:
            return {"a": np.array(self.normal) / np.linalg.norm(self.normal)} | twist
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        return {"a": across, "b": np.cross(axis, across)} | twist

    def expanded(self, description: Description, name: str) -> Description:
        """Description with hinges and pieces.

        Parts attached to the link follow the piece at their attachment.
        """
        link, axis, start = find_link(description, self.link), self._axis, np.array(self.start)
        density = link.mass / self._length if self.mass_per_length is None else self.mass_per_length
        # moment of inertia about the beam's axis, per length, of the twisting material [kg m]
        if self.torsional_stiffness is None:
            polar = 0.0
        elif self.torsional_inertia is not None:
            polar = self.torsional_inertia
        else:
            polar = float(self._axis @ link.inertia @ self._axis) / self._length
            if not polar > 0:
                raise DescriptionError(
                    f"link {self.link!r} has no moment of inertia about the beam, so that nothing resists "
                    "its torsion; give `torsional_inertia`",
                    where="torsional_stiffness",
                )
        ends = self._hinges.tolist()
        pieces = {
            kind: [piece for shape in getattr(link, kind) for piece in cut(shape, start, axis, ends)]
            for kind in ("visuals", "collisions")
        }

        def shaped(piece: UrdfLink, i: int) -> UrdfLink:
            """Piece i with its shapes; the root piece has number 0."""
            visuals, collisions = (
                tuple(shape for k, shape in assigned if k == i) for assigned in pieces.values()
            )
            return replace(piece, visuals=visuals, collisions=collisions)

        links, joints, parent = list[UrdfLink](), list[UrdfJoint](), self.link
        for i, (place, end) in enumerate(zip(ends, [*ends[1:], self._length], strict=True), start=1):
            hinge = start + place * axis
            origin = frozen(translation(hinge))
            for letter, turn in self._turns.items():
                joint = f"{name}_{i}{letter}"
                links.append(UrdfLink(joint, 0.0, frozen(np.zeros(3)), frozen(np.zeros((3, 3)))))
                joints.append(
                    UrdfJoint(
                        joint, "revolute", parent, joint, origin, frozen(turn), effort=0.0, velocity=0.0
                    )
                )
                parent, origin = joint, frozen(np.eye(4))
            # frames of the undeformed pieces coincide with the link's, so that attached parts keep their
            # places
            piece, back = f"{name}_{i}", frozen(translation(-hinge))
            joints.append(UrdfJoint(f"{piece}_mount", "fixed", parent, piece, back, frozen([1, 0, 0])))
            mass, length = density * (end - place), end - place
            rod = mass * length**2 / 12 * (np.eye(3) - np.outer(axis, axis))
            rod += polar * length * np.outer(axis, axis)
            centre = frozen(start + (place + end) / 2 * axis)
            borrowed = (self.link, frozen(np.eye(4)))
            links.append(shaped(UrdfLink(piece, mass, centre, frozen(rod), borrowed=borrowed), i))
            parent = piece
        for carried in description.joints:
            if carried.parent == self.link:
                i = int(np.searchsorted(ends, (carried.origin[:3, 3] - start) @ axis - 1e-9))
                joints.append(replace(carried, parent=f"{name}_{i}" if i else self.link))
        return extended(description, [shaped(link, 0)], links, joints, self.model_dump_json())

    def springs(
        self, description: Description, name: str, number: Callable[[str], Number]
    ) -> Mapping[str, tuple[Number, Number]]:
        """``E I / dx``, of torsion ``G J / dx``, and T times that."""
        del description
        has_bending = self.bending_stiffness is not None
        bending = number("bending_stiffness" if has_bending else "youngs_modulus")
        bending = bending if has_bending else bending * number("second_moment")
        coefficients = {}
        for letter in self._turns:
            stiffness = number("torsional_stiffness") if letter == "t" else bending
            stiffness = stiffness * (self.segments / self._length)
            coefficients[letter] = (stiffness, stiffness * number("damping_time"))
        return {
            f"{name}_{i + 1}{letter}": coefficients[letter]
            for i in range(self.segments)
            for letter in coefficients
        }

    def moving_inertia(self, description: Description, name: str) -> Array:
        """Sum of the inertias (6x6) of the segments, each about its own origin."""
        total = np.zeros((6, 6))
        for i in range(1, self.segments + 1):
            piece = find_link(description, f"{name}_{i}")
            total += pin.Inertia(piece.mass, piece.com, piece.inertia).matrix()
        return total

    def build(self, flexible: FlexibleContext) -> Contribution:
        """Contribution: displacement of the beam's end as output, link axes."""
        rotation, origin = flexible.placement(self.link)
        end_rotation, end_position = flexible.placement(f"{flexible.name}_{self.segments}")
        end = ca.DM(self.end)
        value = ca.mtimes(rotation.T, end_position + ca.mtimes(end_rotation, end) - origin) - end
        label, text = f"{flexible.body}/{flexible.name}", "deflection of the ends of flexible links"
        return Contribution(outputs=(Output("deflection", value, "m", text, "flexible", label),))
