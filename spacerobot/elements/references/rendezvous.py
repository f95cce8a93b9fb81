"""Reference for a tip: approach of a mating frame of a moving target, by way of a standoff."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.arrays import Array
from spacerobot.common.section import Vector, quantity
from spacerobot.dynamics.algebra import SymmetricFactors, cross
from spacerobot.dynamics.inertias import shifted_inertia
from spacerobot.dynamics.rotations import rotation_exp, rotation_from_rpy
from spacerobot.elements.core.context import ReferenceContext
from spacerobot.elements.core.desired_motion import DesiredMotion, InitialMotion, TimeProfile, smooth_blend
from spacerobot.elements.core.registry import register
from spacerobot.elements.grasps.grasp import only
from spacerobot.elements.references.reference import DEGREE, Reference

PEAK = 1.875
"""Maximum slope of the smooth blend."""


@register
class Rendezvous(Reference):
    """Approach of a moving target's mating frame: to a standoff on the axis of approach, then along the axis.

    The path is defined in the mating frame and moves with it.
    """

    kind: Literal["rendezvous"] = "rendezvous"
    frame: str = Field(min_length=1, description="mating frame: a link of the target's URDF")
    standoff: float = quantity(
        "m", "distance before the mating frame from which it closes in", default=0.2, ge=0
    )
    axis: Vector = quantity("1", "direction of approach in the mating frame", default=(1.0, 0.0, 0.0))
    mated_deg: Vector = quantity(
        "deg", "roll, pitch, yaw of the tip in the mating frame where mated", default=(0.0, 0.0, 0.0)
    )
    approach_time: float = quantity("s", "time to the standoff", default=5.0, gt=0)
    wait: float = quantity("s", "time at the standoff", default=0.0, ge=0)
    duration: float | None = quantity(
        "s",
        "time from the standoff to the end; 5 if neither it nor `closing_speed` is given",
        default=None,
        gt=0,
    )
    closing_speed: float | None = quantity(
        "m/s", "maximum speed from the standoff to the end, in place of `duration`", default=None, gt=0
    )
    end_distance: float = quantity(
        "m", "distance before the mating frame at the end; below 0 to press on beyond it", default=0.0
    )

    @model_validator(mode="after")
    def _check(self) -> Rendezvous:
        if not any(self.axis):
            raise ValueError("axis: found 0 0 0, allowed: a direction")
        if self.duration is not None and self.closing_speed is not None:
            raise ValueError("give either `duration` or `closing_speed`, not both")
        if self.closing_speed is not None and self.standoff <= self.end_distance:
            raise ValueError("`closing_speed` needs a `standoff` above `end_distance`")
        return self

    @property
    def follows(self) -> str | None:
        """The mating frame."""
        return self.frame

    def from_standoff(self, standoff: float) -> dict[str, Any]:
        """Section without the wait, for a tip at a standoff; it stays there if its end is farther away."""
        document = self.model_dump(mode="json") | {"wait": 0.0}
        stays = self.end_distance >= standoff
        return document | ({"closing_speed": None, "end_distance": standoff} if stays else {})

    def reads(self) -> set[str]:
        """Signals of the target that it reads."""
        return {"target_position", "target_velocity", "target_spin"}

    def motion(
        self, context: ReferenceContext, start: InitialMotion, pivot: ca.SX | None = None
    ) -> DesiredMotion:
        """Motion along a path defined in the mating frame and carried by it."""
        del pivot
        plant, sighting = context.plant, _Seen.of(context, context.links[self.frame])
        mated = context.once("mated", rotation_from_rpy(_vector(context, "mated_deg") * DEGREE))
        # displacement and rotation vector (3x1 each) relative to the mated pose, axes of the mating frame
        first = sighting.at(start)
        back, offset_world = first.rotation.T, start.origin - first.position
        offset = context.begun("offset", ca.mtimes(back, offset_world))
        relative = start.velocity - first.velocity - cross(first.spin, offset_world)
        drift = context.begun("drift", ca.mtimes(back, relative))
        twist = context.plant.orientation_error(ca.mtimes(back, start.rotation), mated)
        turn = context.begun("turn", twist)
        axis = _vector(context, "axis")
        axis = context.once("axis", axis / ca.norm_2(ca.densify(axis)))
        # times of arrival at the standoff and of departure, and duration from there to the end (1x1 each)
        # [s]
        number = context.number
        if self.closing_speed is not None:
            closing = PEAK * (number("standoff") - number("end_distance")) / number("closing_speed")
        else:
            closing = ca.SX(5) if self.duration is None else number("duration")
        time = number("approach_time")
        departure = time + number("wait") if self.wait else time
        arrive = smooth_blend(context, (None, "arrived"), ca.SX(0), time)
        close = smooth_blend(context, ("left" if self.wait else "arrived", "closed"), departure, closing)
        standoff = -context.number("standoff") * axis
        onward = -context.number("end_distance") * axis - standoff
        # distance per unit of initial velocity (1x1) [s]: T u (1 - u)^3 (1 + 3 u), zero at the end
        u = ca.if_else(context.time < context.jump("arrived", time), context.time / time, 1)
        coast = TimeProfile(
            time * u * (1 - u) ** 3 * (1 + 3 * u),
            (1 - u) ** 2 * (1 + 2 * u - 15 * u * u),
            -12 * u * (1 - u) * (3 - 5 * u) / time,
        )
        away = offset - standoff
        displacement = TimeProfile(
            standoff + away * (1 - arrive.value) + drift * coast.value + onward * close.value,
            -away * arrive.rate + drift * coast.rate + onward * close.rate,
            -away * arrive.acceleration + drift * coast.acceleration + onward * close.acceleration,
        )
        rotation_vector = TimeProfile(
            turn * (1 - arrive.value), -turn * arrive.rate, -turn * arrive.acceleration
        )
        rotation, spin = sighting.rotation, sighting.spin
        lever, rate, bend = (
            ca.mtimes(rotation, part)
            for part in (displacement.value, displacement.rate, displacement.acceleration)
        )
        relative_spin, gain = (
            ca.mtimes(rotation, rotation_vector.rate),
            ca.mtimes(rotation, rotation_vector.acceleration),
        )
        linear, angular = _free_acceleration(context, sighting)
        swing, about = cross(spin, lever), plant.rotation_axes
        return DesiredMotion(
            position=sighting.position + lever,
            velocity=sighting.velocity + swing + rate,
            acceleration=linear + cross(angular, lever) + cross(spin, swing + 2 * rate) + bend,
            rotation=ca.mtimes(rotation, ca.mtimes(rotation_exp(rotation_vector.value), mated)),
            angular_velocity=only(spin + relative_spin, about),
            angular_acceleration=only(angular + cross(spin, relative_spin) + gain, about),
        )

    def jumps(self) -> tuple[float, ...]:
        """Times of arrival at the standoff, of departure from it, and of the end [s]."""
        closing = 5.0 if self.duration is None else self.duration
        if self.closing_speed is not None:
            closing = PEAK * (self.standoff - self.end_distance) / self.closing_speed
        departure = self.approach_time + self.wait
        return (self.approach_time, departure, departure + closing)

    def way(self) -> tuple[Array, Array]:
        """Zero displacement and rotation: the path is not known in advance."""
        return np.zeros((1, 3)), np.zeros((1, 3))

    def leaves_plane(self) -> Iterator[tuple[str, list[float]]]:
        """Keys and values of an axis or orientation that leaves the plane."""
        if self.axis[2]:
            yield "axis", list(self.axis)
        if any(self.mated_deg[:2]):
            yield "mated_deg", list(self.mated_deg)

    def assumptions(self) -> list[str]:
        """Model of the target's acceleration."""
        return [
            "its acceleration is that of a target that drifts freely as one body: what grips, touches or "
            "drives the target does not enter it"
        ]


class _Seen:
    """Measured mating frame: rotation, position, velocity, spin."""

    def __init__(self, rotation: ca.SX, position: ca.SX, velocity: ca.SX, spin: ca.SX) -> None:
        self.rotation, self.position, self.velocity, self.spin = rotation, position, velocity, spin

    @classmethod
    def of(cls, context: ReferenceContext, frame: int) -> _Seen:
        """Present measurement: position relative to the tip, velocity and spin from sensors or estimates."""
        plant = context.plant
        (rotation, place), (velocity, spin) = plant.placement(frame), plant.velocity(frame)
        tip, estimates = plant.placement(context.tip)[1], context.estimates
        if "target_position" in estimates:
            correction = rotation_exp(estimates["target_orientation"](ca.SX(3, 1)))
            estimate = (estimates[f"target_{key}"](place) for key in ("position", "velocity", "spin"))
            return cls(ca.mtimes(correction, rotation), *estimate)

        def read(signal: str, truth: ca.SX, axes: tuple[int, ...], origin: ca.SX | None = None) -> ca.SX:
            value = truth if origin is None else truth - origin
            reading = context.reading_of(signal, value)
            if reading is None:
                return truth
            return context.held(signal, truth + only(reading - value, axes), origin)

        along = plant.translation_axes
        return cls(
            rotation,
            read("target_position", place, along, tip),
            read("target_velocity", velocity, along),
            read("target_spin", spin, plant.rotation_axes),
        )

    def at(self, start: InitialMotion) -> _Seen:
        """The motion at the start of the reference."""
        return _Seen(**{name: start.keep(name, value) for name, value in vars(self).items()})


def _vector(context: ReferenceContext, key: str) -> ca.SX:
    return context.parameters.sparse_vector(f"{context.path}.{key}")


def _free_acceleration(context: ReferenceContext, target: _Seen) -> tuple[ca.SX, ca.SX]:
    """Rates of the mating frame's velocity and spin (3x1 each) while the target drifts as one body."""
    plant, none = context.plant, ca.SX(3, 1)
    if not context.target:
        return none, none
    parts = [(joint, *plant.inertias.in_world(plant.kinematics, joint)) for joint in context.target]
    mass = sum(part[1] for part in parts)
    centre = sum(m * plant.kinematics.origin[joint] + moment for joint, m, moment, _ in parts) / mass
    spin, angular = target.spin, none
    if not plant.planar:
        shifted = (
            shifted_inertia(m, moment, inertia, plant.kinematics.origin[joint] - centre)[2]
            for joint, m, moment, inertia in parts
        )
        inertia = sum(shifted, ca.SX(3, 3))
        angular = SymmetricFactors(inertia).solve_negated(cross(spin, ca.mtimes(inertia, spin)))
    lever = target.position - centre
    gravity = ca.SX(ca.DM(plant.model.gravity.linear))
    return gravity + cross(angular, lever) + cross(spin, cross(spin, lever)), angular
