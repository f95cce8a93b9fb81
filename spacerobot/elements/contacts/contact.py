"""Contact between shapes of two bodies.

Every pair of shapes exerts *one* pair of opposite forces at one point, halfway between the two deepest
points. The gap's rate is then exactly the relative velocity there along the normal, and momentum and energy
balance to rounding.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
from pydantic import Field

from spacerobot.common.registry import required
from spacerobot.common.section import MAX_STEPS, quantity
from spacerobot.elements.core.context import ContactContext
from spacerobot.elements.core.contribution import Contribution, Output, PowerTerm, State
from spacerobot.elements.core.element import Element
from spacerobot.elements.core.event import Event, both, negated
from spacerobot.elements.shapes.collision_shape import Wrap
from spacerobot.shapes import CROWN

OBSERVED = {
    "contact_force": ("N", "force of contacts on the second of the two that touch"),
    "contact_normal_force": ("N", "size of contacts' forces along their normals"),
    "contact_gap": ("m", "minimum distance between the shapes of contacts, negative while they touch"),
    "contact_point": ("m", "where contacts act, or would first"),
    "contact_velocity": ("m/s", "velocity there of the second of the two relative to the first"),
    "contact_impulse": ("N s", "impulse of contacts on the second of the two since the start"),
    "contact_loss": ("J", "energy that contacts took since the start"),
}
"""Unit and description of the outputs of every contact."""
UNPLOTTED = ("contact_point", "contact_velocity", "contact_impulse", "contact_loss")
"""Outputs that pages do not plot over time."""


class Contact(Element):
    """Contact between the shapes of two bodies."""

    family: ClassVar[str] = "contact"

    between: tuple[str, str] = Field(
        description="the pair in contact, each the name of a pad, or robot/link or target/link for all "
        "collision shapes of a link; `*` in a link's name matches any letters"
    )
    wrap: Wrap | None = Field(
        default=None,
        description="shape around meshes and cylinders that replaces them; meshes are refused if not given",
    )
    may_overlap: bool = Field(
        default=False, description="whether the shapes may overlap at the start; refused if not"
    )

    crown: float = quantity(
        "1",
        "height of the dome on flat faces and straight edges, of half their length; where flat lies on flat "
        "the force then moves smoothly as the shapes tilt by about so many rad; without effect on spheres",
        default=CROWN,
        ge=1e-4,
        le=0.1,
    )
    longest_step: float | None = quantity(
        "s",
        "longest step of the fixed-step engine while the shapes touch; as elsewhere if not given",
        default=None,
        gt=0,
        recurs=MAX_STEPS,
    )

    @required()
    def build(self, contact: ContactContext) -> Contribution:
        """Contribution to the closed loop."""
        raise NotImplementedError


@dataclass(frozen=True)
class ContactPair:
    """Pair of shapes of a contact, and its relative motion; world axes.

    Attributes:
        gap: Signed distance (1x1) [m], negative while they overlap.
        normal: Normal from the first to the second shape (3x1).
        point: Point of contact (3x1) [m].
        velocity: Velocity of the second relative to the first at the point (3x1) [m/s].
        speed: Upper bound of the gap's rate (1x1) [m/s], for any position of the nearest points.
        lead: Difference between the lengths of two ways out of an overlap (1x1) [m], or None; see
            :class:`spacerobot.shapes.Proximity`.
    """

    gap: ca.SX
    normal: ca.SX
    point: ca.SX
    velocity: ca.SX
    speed: ca.SX
    lead: ca.SX | None = None

    @property
    def opening(self) -> ca.SX:
        """Rate of the gap (1x1) [m/s]."""
        return ca.dot(self.normal, self.velocity)

    @property
    def sliding(self) -> ca.SX:
        """Relative velocity across the normal (3x1) [m/s]."""
        return self.velocity - self.opening * self.normal


def touches(contact: ContactContext) -> list[ContactPair]:
    """All pairs of shapes of a contact."""
    pairs = []
    for first, second in contact.pairs:
        near = contact.proximity(first, second)
        velocity = contact.velocity(second, near.point) - contact.velocity(first, near.point)
        speed = contact.approach_speed(first, second)
        pairs.append(ContactPair(near.gap, near.normal, near.point, velocity, speed, near.lead))
    return pairs


_WINDOW = 8
"""Number of longest steps over which steps grow after contact is made and shrink before it is lost, for
non-smooth forces."""


@dataclass(frozen=True)
class ContactEvents:
    """Events of a contact at kinks of its force, and its shorter steps.

    The force depends on no switch: the events only make steps end where it is not smooth.
    """

    events: tuple[Event, ...]
    fine: tuple[tuple[ca.SX, float, float], ...]


def watch(
    contact: ContactContext,
    touching: Sequence[ContactPair],
    config: Contact,
    pull: Sequence[ca.SX],
    *,
    rough: bool,
) -> ContactEvents:
    """Events at which a pair of shapes makes or loses contact, or at which its force would become tensile.

    Args:
        contact: Contact of the pairs.
        touching: Pairs of shapes.
        config: Section of the contact.
        pull: Expression (1x1) for each pair that is positive where the force would be tensile; empty if it
            never is.
        rough: Whether the force is a fractional power of the indentation, so that steps become shorter
            towards the start and the end of the contact.
    """
    events: list[Event] = []
    fine = []
    longest = math.inf if config.longest_step is None else config.longest_step
    window = _WINDOW if rough else 0
    for i, touch in enumerate(touching):
        mark = f".{i + 1}" if len(touching) > 1 else ""
        touches, loose = (contact.context.switch(f"{name}{mark}") for name in ("touching", "loose"))

        def event(kind: str, guard: ca.SX, armed: ca.SX, sets: dict[str, bool], mark: str = mark) -> Event:
            return Event(f"{contact.name}{mark}.{kind}", kind, contact.name, guard, armed, sets, kink=True)

        touched = event("touched", -touch.gap, negated(touches), {touches.name(): True})
        events += [
            dataclasses.replace(touched, speed=touch.speed),
            event("parted", touch.gap, touches, {touches.name(): False, loose.name(): False}),
        ]
        if touch.lead is not None:
            flipped = contact.context.switch(f"flipped{mark}")
            events += [
                event("flipped", touch.lead, both(touches, negated(flipped)), {flipped.name(): True}),
                event("flipped", -touch.lead, both(touches, flipped), {flipped.name(): False}),
            ]
        if pull:
            events += [
                event("loosened", pull[i], both(touches, negated(loose)), {loose.name(): True}),
                event("pressed", -pull[i], both(touches, loose), {loose.name(): False}),
            ]
        if rough or longest < math.inf:
            fine.append((touches, longest, window))
    return ContactEvents(tuple(events), tuple(fine))


@dataclass(frozen=True)
class ContactForce:
    """Contact force between a pair of shapes.

    Attributes:
        force: On the second (3x1) [N].
        normal: Magnitude along the normal (1x1) [N].
        dissipated: Power that it dissipates (1x1) [W].
    """

    force: ca.SX
    normal: ca.SX
    dissipated: ca.SX


def booked(
    contact: ContactContext, touching: Sequence[ContactPair], presses: Sequence[ContactForce]
) -> Contribution:
    """Contribution of a contact: wrenches of all pairs of shapes, dissipated power and outputs.

    Forces are summed over the pairs; gap, point and velocity are those of the nearest pair.
    """
    nearest = touching[0]
    for touch in touching[1:]:
        nearer, parts = touch.gap < nearest.gap, ("gap", "normal", "point", "velocity", "speed")
        nearest = ContactPair(*(ca.if_else(nearer, getattr(touch, k), getattr(nearest, k)) for k in parts))
    force = sum((press.force for press in presses), ca.SX(3, 1))
    dissipated = sum((press.dissipated for press in presses), ca.SX(1, 1))
    impulse, loss = (
        State(
            f"contacts.{contact.name}.{name}",
            ca.SX.sym(name, rate.size1()),
            ca.SX.zeros(rate.size1()),
            ca.densify(rate),
        )
        for name, rate in (("impulse", force), ("loss", dissipated))
    )
    values = {
        "contact_force": force,
        "contact_normal_force": sum((press.normal for press in presses), ca.SX(1, 1)),
        "contact_gap": nearest.gap,
        "contact_point": nearest.point,
        "contact_velocity": nearest.velocity,
        "contact_impulse": impulse.symbol,
        "contact_loss": loss.symbol,
    }
    wrenches = (
        wrench
        for pair, touch, press in zip(contact.pairs, touching, presses, strict=True)
        for wrench in contact.opposite(pair, press.force, touch.point)
    )
    return Contribution(
        states=(impulse, loss),
        wrenches=tuple(wrenches),
        powers=(PowerTerm("contact", dissipated),),
        outputs=tuple(
            Output(name, values[name], *attributes, "contact", contact.name, name not in UNPLOTTED)
            for name, attributes in OBSERVED.items()
        ),
    )
