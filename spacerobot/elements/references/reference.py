"""References: desired motion of a tip or a held object (Eq. 39-44).

As a rule they start at rest at the pose that the frame has when they begin, and hold their final pose.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.registry import required
from spacerobot.common.section import Vector, numbers, quantity
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.rotations import rotation_exp
from spacerobot.elements.core.context import ReferenceContext
from spacerobot.elements.core.desired_motion import (
    STILL,
    DesiredMotion,
    InitialMotion,
    TimeProfile,
    along,
    cubic_blend,
)
from spacerobot.elements.core.element import Element
from spacerobot.elements.core.section_context import SectionContext
from spacerobot.symbolic import Constants, Parameters

DEGREE = np.pi / 180
SAMPLES = 65
"""Number of times at which a whole path is sampled for checks."""
PLANE_TOLERANCE = 1e-12


class Reference(Element):
    """A motion that a frame is carried along, beginning where the frame then is."""

    family: ClassVar[str] = "reference"

    @property
    def follows(self) -> str | None:
        """Link of the target that it follows, if any."""
        return None

    def from_standoff(self, standoff: float) -> dict[str, Any] | None:
        """Section that continues this one for a tip that is already near the followed link.

        Args:
            standoff: Distance of the tip in front of that link [m].

        Returns:
            dict or None: Section without the completed part; None for a reference that cannot start there.
        """
        del standoff
        return None

    def reads(self) -> set[str]:
        """Signals that it reads from sensors."""
        return set()

    @required(instead="motion")
    def moved(self, context: SectionContext) -> TimeProfile:
        """Displacement since the start (3x1) [m] and its derivatives, world axes."""
        raise NotImplementedError

    def turned(self, context: SectionContext) -> TimeProfile:
        """Rotation vector since the start (3x1) [rad], of constant direction, and its derivatives."""
        del context
        return STILL

    def jumps(self) -> tuple[float, ...]:
        """Times at which it is not smooth [s], rising; the last one is its end."""
        return ()

    def motion(
        self, context: ReferenceContext, start: InitialMotion, pivot: ca.SX | None = None
    ) -> DesiredMotion:
        """Motion of a frame that starts at ``start``.

        Args:
            context: Time, the section's numbers, and measurements of the target.
            start: Motion of the frame at the reference's start.
            pivot: Initial position of the displaced point (3x1) [m] if it is not the frame's own origin: the
                target's origin for a frame that the target carries.
        """
        return carried(context, start, pivot, (self.moved(context), self.turned(context)))

    def way(self) -> tuple[Array, Array]:
        """Displacements [m] and rotation vectors [rad] on the whole way, (n, 3) each."""
        time, constants = ca.SX.sym("t"), Constants()
        parameters = Parameters(dict(numbers(self.model_dump(), "reference")))
        context = SectionContext("reference", time, parameters, constants)
        displacement = ca.horzcat(self.moved(context).value, self.turned(context).value)
        prepared = ca.Function("prepared", [parameters.symbols], [constants.expressions])(parameters.values)
        at = ca.Function("way", [time, constants.symbols, parameters.symbols], [ca.densify(displacement)])
        times = np.linspace(0.0, max(self.jumps(), default=0.0), SAMPLES)
        both = np.array([at(t, prepared, parameters.values).full() for t in times])
        return both[:, :, 0], both[:, :, 1]

    def leaves_plane(self) -> Iterator[tuple[str, list[float]]]:
        """Keys of the section, with values, that leave the x-y plane."""
        displacements, rotations = self.way()
        if (
            np.abs(displacements[:, 2]).max() > PLANE_TOLERANCE
            or np.abs(rotations[:, :2]).max() > PLANE_TOLERANCE
        ):
            farthest = np.abs(displacements[:, 2]).max(), *np.abs(rotations[:, :2]).max(axis=0)
            yield "kind", [float(size) for size in farthest]


def carried(
    context: SectionContext, start: InitialMotion, pivot: ca.SX | None, way: tuple[TimeProfile, TimeProfile]
) -> DesiredMotion:
    """Motion of a frame along a path: displacement and rotation vector of constant direction (3x1 each)."""
    displacement, rotation_vector = way
    rotation0 = context.begun("start.rotation", start.rotation)
    pivot0 = context.begun("start.pivot", start.origin if pivot is None else pivot)
    lever0 = ca.SX(3, 1) if pivot is None else context.begun("start.lever", start.origin - pivot)
    rotation = ca.SX.eye(3) if rotation_vector.value.nnz() == 0 else rotation_exp(rotation_vector.value)
    lever = ca.mtimes(rotation, lever0)
    swing = cross(rotation_vector.rate, lever)
    return DesiredMotion(
        position=pivot0 + displacement.value + lever,
        velocity=displacement.rate + swing,
        acceleration=displacement.acceleration
        + cross(rotation_vector.acceleration, lever)
        + cross(rotation_vector.rate, swing),
        rotation=ca.mtimes(rotation, rotation0),
        angular_velocity=rotation_vector.rate,
        angular_acceleration=rotation_vector.acceleration,
    )


class TimedReference(Reference):
    """Motion from rest to rest by the cubic blend of Eq. 42, with a rotation by the same blend."""

    duration: float = quantity("s", "time the motion takes; held afterwards", default=10.0, gt=0)
    rotation_deg: Vector = quantity(
        "deg",
        "rotation vector, world axes, reached at the end of the motion by the same blend",
        default=(0.0, 0.0, 0.0),
    )

    def blend(self, context: SectionContext) -> TimeProfile:
        """Profile from 0 to 1 over the duration."""
        return cubic_blend(context)

    def turned(self, context: SectionContext) -> TimeProfile:
        """Rotation about a fixed axis, structurally absent where no rotation is given."""
        full = context.vector("rotation_deg", DEGREE)
        return along(full, self.blend(context)) if full.nnz() else STILL

    def jumps(self) -> tuple[float, ...]:
        """End of the motion [s]."""
        return (self.duration,)

    def leaves_plane(self) -> Iterator[tuple[str, list[float]]]:
        """A rotation about another axis than z."""
        if any(self.rotation_deg[:2]):
            yield "rotation_deg", list(self.rotation_deg)
