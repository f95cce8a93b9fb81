"""Goal of a tip at a mating frame of the target."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.arrays import Array
from spacerobot.common.section import Vector, quantity
from spacerobot.dynamics.joints import exact_directions
from spacerobot.elements.core.registry import register
from spacerobot.elements.goals.goal import TipGoal
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, matched, unit, within, zero
from spacerobot.elements.references.reference import Reference

SETTLING = 1.0
"""Time [s] in which a tip removes its offset from the mating frame after the plan."""


@register
class Mated(TipGoal):
    """A tip is mated with a link of the drifting, tumbling target, in pose and motion."""

    told_by: ClassVar[str | None] = "frame"

    kind: Literal["mated"] = "mated"
    frame: str = Field(
        min_length=1, description="mating frame, a link of the target's URDF: pose and motion are matched"
    )
    standoff: float = quantity("m", "distance before the mating frame, against `axis`", default=0.0, ge=0)
    axis: Vector = quantity("1", "direction of approach in the mating frame", default=(1.0, 0.0, 0.0))
    mated_deg: Vector = quantity(
        "deg", "roll, pitch, yaw of the tip in the mating frame where mated", default=(0.0, 0.0, 0.0)
    )
    closing_speed: float = quantity(
        "m/s", "speed along `axis` relative to the mating frame", default=0.0, ge=0
    )
    position_within: float | None = quantity(
        "m", "maximum distance from there; none if not given", default=None, gt=0
    )
    orientation_within_deg: float | None = quantity(
        "deg", "maximum angle from there; none if not given", default=None, gt=0
    )
    speed_within: float | None = quantity(
        "m/s",
        "maximum deviation of the velocity from `closing_speed`, for a rigid grasp; none if not given",
        default=None,
        gt=0,
    )
    spin_within_deg: float | None = quantity(
        "deg/s", "maximum relative spin, likewise; none if not given", default=None, gt=0
    )
    orientation: bool = Field(default=True, description="whether orientation and spin are matched too")
    roll: bool = Field(
        default=True, description="whether, of those, the angle and spin about `axis` are matched too"
    )
    settled: bool = Field(
        default=False,
        description="whether joints then move no more than the tip's motion takes, and without acceleration: "
        "controllers that take over find nothing to brake",
    )

    @model_validator(mode="after")
    def _check(self) -> Mated:
        if not any(self.axis):
            raise ValueError("axis: found 0 0 0, allowed: a direction")
        if self.settled and self.rest:
            raise ValueError("settled: joints at rest are settled; leave out `settled` or `rest`")
        for key in ("spin_within_deg", "orientation_within_deg"):
            if getattr(self, key) is not None and not self.orientation:
                raise ValueError(f"{key}: without `orientation` orientation and spin are free already")
        return self

    @property
    def rests(self) -> bool:
        """Whether joints are at rest at the end; false by default, since the mating frame moves."""
        return bool(self.rest)

    @property
    def ends_in_motion(self) -> bool:
        """Whether joints may move at the end: true unless the goal is ``settled``."""
        return not (self.rests or self.settled)

    @property
    def follows(self) -> str | None:
        """The mating frame."""
        return self.frame

    @property
    def end_distance(self) -> float:
        """The standoff."""
        return self.standoff

    @property
    def is_exact(self) -> bool:
        """Whether the pose has no tolerance."""
        return self.position_within is None and self.orientation_within_deg is None

    @property
    def end_speed(self) -> float | None:
        """Closing speed [m/s], if the tip then has no other motion relative to the frame."""
        is_rigid = self.rests and self.orientation and self.roll and not self.rate_within
        return self.closing_speed if is_rigid else None

    def settling(self, instant: PlanInstant) -> ca.SX | None:
        """Velocity of the tip, and its spin where orientation is matched."""
        if not self.settled:
            return None
        tip = instant.tip(self.tip)
        turns = [tip.spin[i] for i in instant.turns] if self.orientation else []
        return ca.vertcat(*(tip.velocity[i] for i in instant.axes), *turns)

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Pose and motion relative to the mating frame."""
        import pinocchio as pin  # not needed to validate a section

        tip, mate, axis = instant.tip(self.tip), instant.mating(self.frame), unit(self.axis)
        place, speed, spin = tip.seen_from(mate)
        place, speed = place + self.standoff * axis, speed - self.closing_speed * axis
        yield from matched("position", "m", place, instant.axes, self.position_within)
        yield from matched("velocity", "m/s", speed, instant.axes, self.speed_within)
        if not self.orientation:
            return
        mated = exact_directions(pin.rpy.rpyToMatrix(np.radians(self.mated_deg)))
        slow = None if self.spin_within_deg is None else float(np.radians(self.spin_within_deg))
        if not self.roll and len(instant.turns) == 3:
            # both perpendicular to the axis of approach, which is the first column: its tilt by an angle x as
            # a vector of length 2 tan(x/2), which is smooth up to half a turn, and the spin
            across = ca.SX(axis_frame(self.axis)[:, 1:])
            pointing = ca.mtimes([mate.rotation.T, tip.rotation, mated.T, axis])
            tilt = 2 * ca.mtimes(across.T, pointing) / (1 + ca.dot(pointing, axis))
            if self.orientation_within_deg is not None:
                limit = 2 * np.tan(np.radians(self.orientation_within_deg) / 2)
                yield within("orientation", "rad", tilt, float(limit))
            else:
                yield from (zero(f"tilt {k + 1}", "rad", tilt[k]) for k in range(2))
            yield from matched("spin", "rad/s", ca.mtimes(across.T, spin), (0, 1), slow)
            return
        turn = instant.turned(ca.mtimes(mate.rotation, mated), tip.rotation)
        if self.orientation_within_deg is not None:
            yield within("orientation", "rad", turn, float(np.radians(self.orientation_within_deg)))
        else:
            for k, i in enumerate(instant.turns):
                yield zero(f"orientation {'xyz'[i]}", "rad", turn[k])
        yield from matched("spin", "rad/s", spin, instant.turns, slow)

    def arrival(self, instant: PlanInstant) -> tuple[ca.SX, ca.SX]:
        """Velocity and spin relative to the mating frame, in its axes; no spin if orientation is free."""
        _, speed, spin = instant.tip(self.tip).seen_from(instant.mating(self.frame))
        return speed, spin if self.orientation else ca.SX(0, 1)

    def place(self, instant: PlanInstant) -> ca.SX:
        """Before the mating frame."""
        mate = instant.mating(self.frame)
        return mate.origin - self.standoff * ca.mtimes(mate.rotation, unit(self.axis))

    def kept(self, scenario_reference: Reference | None) -> dict[str, Any]:
        """Section of a reference that stays at the mating frame: the tip's own one if it ends there too."""
        document = None
        if scenario_reference is not None and scenario_reference.follows == self.frame:
            document = scenario_reference.from_standoff(self.standoff)
        if document is None:
            document = {"kind": "rendezvous", "frame": self.frame, "end_distance": self.standoff}
            document |= {"axis": self.axis, "mated_deg": self.mated_deg}
        settling = {"approach_time": SETTLING} if self.orientation else {}
        return document | settling | {"standoff": self.standoff}


def axis_frame(axis: Sequence[float]) -> Array:
    """Rotation (3, 3) whose first column is along an axis (3,)."""
    import pinocchio as pin  # not needed to validate a section

    turn = pin.Quaternion.FromTwoVectors(np.eye(3)[0], np.array(axis, dtype=float))
    return np.asarray(turn.toRotationMatrix())
