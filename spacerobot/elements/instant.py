"""One instant of a planned motion, as goals see it, and what they say of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, TypeVar

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.arrays import Array
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.joints import sparse

T = TypeVar("T")


class About(NamedTuple):
    """Another expression of a value, which is cheaper to differentiate.

    Attributes
    ----------
    symbol, at
        Symbol in it, and what that stands for (n x 1 each).
    value
        Expression (1x1): first and second derivatives at a constant symbol are those of the value.
    """

    symbol: ca.SX
    at: ca.SX
    value: ca.SX


@dataclass(frozen=True, eq=False)
class Row:
    """Something that must stay between limits.

    Attributes
    ----------
    name
        What a user calls it.
    unit
        Of its values times its scale.
    value
        Expression (1x1).
    lower, upper
        Limits.
    last
        Part of the duration, at its end, for which it must hold.
    scale
        What a violation of one means in that unit.
    first
        Whether it must hold at the first instant alone.
    form
        What the value is of what is named: the square over that of its limit, or an angle's cosine.
    size
        Of the limit, in that unit, where violations between the points count relative to it.
    about
        What its derivatives are taken of, if not of ``value``.
    """

    name: str
    unit: str
    value: ca.SX
    lower: float = -np.inf
    upper: float = np.inf
    last: float = 1.0
    scale: float = 1.0
    size: float | None = None
    first: bool = False
    about: About | None = None
    form: Literal["itself", "square", "cosine"] = "itself"

    def held(self, share: Array, begins: float) -> npt.NDArray[np.bool_]:
        """At which parts of the duration it must hold, where its last part begins at one of them."""
        return np.asarray(share == 0 if self.first else share >= begins - 1e-12)


def zero(name: str, unit: str, value: ca.SX) -> Row:
    """Something that must be zero."""
    return Row(name, unit, value, 0.0, 0.0)


def unit(axis: Sequence[float]) -> ca.SX:
    """Unit vector along an axis (3x1), structurally zero where it is zero."""
    return sparse(np.array(axis) / np.linalg.norm(axis))


class Frame(NamedTuple):
    """A frame that moves, world axes.

    Attributes
    ----------
    rotation, origin
        Where it is (3x3), (3x1) [m].
    velocity, spin
        How it moves (3x1 each) [m/s, rad/s].
    """

    rotation: ca.SX
    origin: ca.SX
    velocity: ca.SX
    spin: ca.SX

    def seen_from(self, other: Frame) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Position (3x1) [m], velocity (3x1) [m/s] and spin (3x1) [rad/s] in another frame."""
        away = self.origin - other.origin
        relative = self.velocity - other.velocity - cross(other.spin, away)
        place, speed, spin = (
            ca.mtimes(other.rotation.T, value) for value in (away, relative, self.spin - other.spin)
        )
        return place, speed, spin


class Joint(NamedTuple):
    """A joint of one degree of freedom.

    Attributes
    ----------
    name
        In the URDF.
    position
        Position (1x1) [rad or m]; of an unbounded joint cosine and sine of its angle (2x1).
    """

    name: str
    position: ca.SX

    def off(self, wanted: float) -> ca.SX:
        """How far it is beyond a position (1x1) [rad or m], an unbounded one by less than half a turn."""
        if self.position.numel() == 1:
            return self.position - wanted
        c, d, (q, s) = float(np.cos(wanted)), float(np.sin(wanted)), ca.vertsplit(self.position)
        return ca.atan2(s * c - q * d, q * c + s * d)


class Instant(Protocol):
    """What a goal may ask for; every question names a key of its section, for messages.

    Each raises :class:`spacerobot.errors.ScenarioError` where there is nothing of that name.
    """

    @property
    def axes(self) -> Sequence[int]:
        """Along which things move: x and y, or all."""

    @property
    def turns(self) -> Sequence[int]:
        """About which things turn: z, or all."""

    def tip(self, label: str, key: str = "tip") -> Frame:
        """A tip, by robot/tip."""

    def mating(self, link: str, key: str = "frame") -> Frame:
        """A link of the target."""

    def root(self, body: str, key: str) -> tuple[ca.SX, ca.SX]:
        """Velocity and spin of a floating root link, its own axes, as many as there are [m/s, rad/s]."""

    def base(self, robot: str, key: str) -> Frame:
        """The floating root link of a robot."""

    def joints(self, robot: str, given: Mapping[str, T], key: str) -> Iterator[tuple[Joint, T]]:
        """Joints of a robot that patterns name, and what is given for each."""

    def turned(self, wanted: ca.SX, found: ca.SX) -> ca.SX:
        """Rotation vector from one orientation to another, as many entries as :attr:`turns` [rad]."""
