r"""Assumed modes of an appendage, from frequencies, damping and modal participation factors.

A structural model, clamped at the point P where the appendage is attached, states for each mode the angular
frequency $\omega$, the damping ratio $\zeta$ and the participation factor $L$ (6) of the mass-normalised
coordinate $\eta$:

$$ \ddot\eta + 2 \zeta \omega \dot\eta + \omega^2 \eta = -L A, \qquad
   W = -\Bigl( D A + \sum L^\top \ddot\eta \Bigr), $$

with the wrench $W$ on the carrier, the acceleration $A$ (linear, then angular) of P and the spatial inertia
$D$ of the rigid appendage about P (hybrid cantilevered model; D. Alazard, C. Cumer, K. Tantawi, Linear
dynamic modeling of spacecraft with various flexible appendages and on-board angular momentums, ESA GNC
2008). Each mode becomes a joint with a body of mass $m$, whose motion exerts the same wrench. With $L = (s
a, l)$, $a$ of unit length,

$$ r = \frac{a \times l}{s}, \qquad p = \frac{a \cdot l}{s}, \qquad L = s\,(a,\ r \times a + p\,a): $$

a mass that moves along $a$ at the distance $r$, with a pitch $p$. For $p = 0$ it is the mass $m = s^2$ on an
arm $r$ that turns about P, or on a slider if $r$ is short. A pitch requires a product of inertia: with the
arm $d$, the axis $e$ normal to $a$, and

$$ m = s^2 \Bigl(1 + \frac{2 |p|}{d}\Bigr), \qquad j = 2 |p| m d, \qquad
   J = j \Bigl(1 + \frac{\operatorname{sign}(p)}{2} (a e^\top + e a^\top) \Bigr), $$

the momentum of the turning body is $m d\,(a,\ r \times a + p\,a)$ if its centre is at $r - 2 |p|\,a \times
e$. Its inertia about the axis is $M = m d^2 + j = (m d / s)^2$; the joint coordinate is $q = \eta / \sqrt
M$. A mode without force, $s = 0$, is a ball of inertia $|l|^2$ that turns about $l$.

These bodies are taken out of the appendage: the rigid remainder is $D - \sum L^\top L$ about P, as in the
structural model. Beyond first order in the deflection the arms are an assumption; stiffening by rotation is
left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

import numpy as np
import pinocchio as pin
from pydantic import Field, model_validator

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DescriptionError
from spacerobot.common.section import Vector, quantity
from spacerobot.description.flexible import extended, find_link, translation
from spacerobot.description.parts import Geometry, LinkShape, UrdfJoint, UrdfLink, frozen
from spacerobot.description.read import Description
from spacerobot.elements.core.contribution import Contribution, Output
from spacerobot.elements.core.registry import register
from spacerobot.elements.flexible.flexible_link import FlexibleContext, FlexibleLink, Number

Participation = tuple[float, float, float, float, float, float]
_SHORT = 0.1
"""Ratio of arm to the appendage's radius of gyration below which a mode moves on a slider."""


@dataclass(frozen=True)
class ModalBody:
    """Body that moves in one mode, in the appendage's axes about its attachment.

    Attributes:
        kind, axis, origin: Kind of its joint, and the joint's axis (3,) and origin (3,) [m].
        mass, com, inertia: Mass [kg], centre of mass (3,) [m], and inertia about it (3, 3) [kg m^2].
        about_joint: Inertia M about the joint axis [kg m^2].
    """

    kind: Literal["revolute", "prismatic"]
    axis: Array
    origin: Array
    mass: float
    com: Array
    inertia: Array
    about_joint: float


def modal_body(participation: Participation, radius: float) -> ModalBody:
    """Body and joint that realise one mode.

    Args:
        participation: L at the attachment [kg^(1/2), kg^(1/2) m].
        radius: Radius of gyration of the appendage [m], the arm of a mode that gives none.
    """
    force, couple, nothing = np.array(participation[:3]), np.array(participation[3:]), np.zeros(3)
    s = float(np.linalg.norm(force))
    if s * radius < 1e-9 * np.linalg.norm(couple):
        inertia = float(couple @ couple)
        axis = couple / np.sqrt(inertia)
        ball = inertia * np.eye(3)
        return ModalBody("revolute", axis, nothing, inertia / radius**2, nothing, ball, inertia)
    a = force / s
    r, p = np.cross(a, couple) / s, float(a @ couple) / s
    length = float(np.linalg.norm(r))
    is_short = length < _SHORT * radius
    if is_short and abs(p) < 1e-9 * radius:
        return ModalBody("prismatic", a, r, s**2, r, np.zeros((3, 3)), s**2)
    axis = np.cross(a, np.eye(3)[np.argmin(np.abs(a))]) if is_short else np.cross(r, a)
    axis /= np.linalg.norm(axis)
    along, d = np.cross(a, axis), radius if is_short else length
    mass = s**2 * (1 + 2 * abs(p) / d)
    j, com = 2 * abs(p) * mass * d, r - 2 * abs(p) * along
    inertia = j * (np.eye(3) + np.sign(p) * (np.outer(a, axis) + np.outer(axis, a)) / 2)
    return ModalBody("revolute", axis, com - d * along, mass, com, inertia, mass * d**2 + j)


@register
class FlexibleModes(FlexibleLink):
    """Modes of a panel or an appendage, from its structural model: frequencies, damping, participation."""

    kind: Literal["modes"] = "modes"
    link: str = Field(description="link of the URDF that bends; with `mass`, the link that carries it")
    position: Vector = quantity("m", "attachment, axes of the link", default=(0.0, 0.0, 0.0))
    rotation_deg: Vector = quantity(
        "deg", "roll, pitch, yaw of the attachment's axes in the link's", default=(0.0, 0.0, 0.0)
    )
    frequencies: tuple[Annotated[float, Field(gt=0)], ...] = quantity(
        "Hz", "of the modes, clamped at the attachment", min_length=1
    )
    damping: tuple[Annotated[float, Field(ge=0)], ...] = quantity("1", "damping ratios of the modes")
    participation: tuple[Participation, ...] = quantity(
        "kg^(1/2), kg^(1/2) m", "of each mode, mass-normalised: three of force, three of torque, there"
    )
    shapes: tuple[Annotated[int, Field(ge=0)], ...] | None = Field(
        default=None,
        description="numbers, in the URDF and from 0, of the link's visual shapes that move with the first "
        "mode; if not given, all of a link that carries none, else none",
    )
    mass: float | None = quantity(
        "kg", "of an appendage that the URDF does not have; the link itself if not given", default=None, gt=0
    )
    com: Vector = quantity(
        "m", "centre of mass of that appendage, axes of the attachment", default=(0.0, 0.0, 0.0)
    )
    inertia: Participation = quantity(
        "kg m^2",
        "ixx, iyy, izz, ixy, ixz, iyz of that appendage about its centre of mass",
        default=(0.0,) * 6,
    )
    size: Vector | None = quantity(
        "m", "box that is drawn about that centre; none if not given", default=None
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        count = len(self.frequencies)
        for key in ("damping", "participation"):
            if len(getattr(self, key)) != count:
                size = len(getattr(self, key))
                raise ValueError(f"{key}: found {size}, allowed: {count}, as of frequencies")
        for i, row in enumerate(self.participation):
            if not any(row):
                raise ValueError(
                    f"participation.{i}: found zeros alone; leave the mode out, nothing moves it"
                )
        return self

    @property
    def _attachment(self) -> Array:
        """Transform from attachment to link frame (4, 4).

        The identity for an appendage modelled as a link.
        """
        transform = translation(np.array(self.position))
        transform[:3, :3] = pin.rpy.rpyToMatrix(np.radians(self.rotation_deg))
        return transform

    def carrier(self, name: str) -> str:
        """The link, or the appendage that the section describes."""
        return self.link if self.mass is None else name

    def _bodies(self, description: Description, name: str) -> dict[str, tuple[ModalBody, Array]]:
        """Body of each mode, and the attachment in the appendage's frame (4, 4), by the joint's name."""
        link = find_link(description, self.carrier(name))
        at = np.eye(4) if self.mass is not None else self._attachment
        arm = link.com - at[:3, 3]
        square = (np.trace(link.inertia) / 2 / link.mass if link.mass else 0.0) + arm @ arm
        radius = float(np.sqrt(square)) or 1.0
        rows = enumerate(self.participation, start=1)
        return {f"{name}_mode_{i}": (modal_body(row, radius), at) for i, row in rows}

    def expanded(self, description: Description, name: str) -> Description:
        """Description with a joint and a body for each mode; bending shapes move with the first mode."""
        carrier = find_link(description, self.link)
        if self.mass is not None:
            xx, yy, zz, xy, xz, yz = self.inertia
            inertia = frozen([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            box = Geometry("box", frozen(self.size or (0.0, 0.0, 0.0)))
            base_shapes = (LinkShape(None, frozen(translation(np.array(self.com))), box),)
            base_link = UrdfLink(name, self.mass, frozen(self.com), inertia, base_shapes if self.size else ())
            at, x = frozen(self._attachment), frozen([1, 0, 0])
            weld = UrdfJoint(f"{name}_mount", "fixed", carrier.name, name, at, x)
            description = extended(description, [], [base_link], [weld], name)
            carrier = base_link
        links, joints = list[UrdfLink](), list[UrdfJoint]()
        bend, count = self.shapes, len(carrier.visuals)
        if bend is None:
            carries = any(joint.parent == carrier.name for joint in description.joints)
            bend = () if carries else tuple(range(count))
        if any(i >= count for i in bend):
            message = (
                f"found {max(bend)}, allowed: less than {count}, the number of shapes of {carrier.name!r}"
            )
            raise DescriptionError(message, where="shapes")
        still = replace(carrier, visuals=tuple(v for i, v in enumerate(carrier.visuals) if i not in bend))
        visuals = tuple(carrier.visuals[i] for i in bend)
        for joint, (body, at) in self._bodies(description, name).items():
            rest_pose = frozen(at @ translation(body.origin))
            back = np.linalg.inv(rest_pose)
            shapes = tuple(replace(visual, placement=frozen(back @ visual.placement)) for visual in visuals)
            visuals = ()
            com, inertia, borrowed = (
                frozen(body.com - body.origin),
                frozen(body.inertia),
                (carrier.name, rest_pose),
            )
            links.append(UrdfLink(joint, body.mass, com, inertia, shapes, (), borrowed))
            axis = frozen(body.axis)
            joints.append(
                UrdfJoint(joint, body.kind, carrier.name, joint, rest_pose, axis, effort=0.0, velocity=0.0)
            )
        return extended(description, [still], links, joints, self.model_dump_json())

    def springs(
        self, description: Description, name: str, number: Callable[[str], Number]
    ) -> Mapping[str, tuple[Number, Number]]:
        """``M w^2`` and ``2 z w M``."""
        coefficients = {}
        for i, (joint, (body, _)) in enumerate(self._bodies(description, name).items()):
            w = 2 * np.pi * number(f"frequencies.{i}")
            coefficients[joint] = (
                body.about_joint * w * w,
                2 * body.about_joint * w * number(f"damping.{i}"),
            )
        return coefficients

    def moving_inertia(self, description: Description, name: str) -> Array:
        """Sum of ``L^T L``."""
        del description, name
        at = np.eye(4) if self.mass is not None else self._attachment
        # force and couple at the attachment, transferred to the link's origin
        rows = np.array(self.participation) @ pin.SE3(at).toDualActionMatrix().T
        total: Array = rows.T @ rows
        return total

    def build(self, flexible: FlexibleContext) -> Contribution:
        """Mass-normalised coordinates of the modes."""
        outputs = []
        for joint, (body, _) in self._bodies(flexible.description, flexible.name).items():
            position = flexible.position(joint)
            if position is not None:
                value = np.sqrt(body.about_joint) * position
                label = f"{flexible.body}/{joint}"
                text = "mass-normalised coordinates of modes"
                outputs.append(Output("modal_coordinate", value, "kg^(1/2) m", text, "mode", label))
        return Contribution(outputs=tuple(outputs))
