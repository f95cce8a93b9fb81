"""Planned motion of a tip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from spacerobot.common.arrays import Array
from spacerobot.dynamics.joints import sparse
from spacerobot.dynamics.rotations import rotation_exp
from spacerobot.elements.core.context import ReferenceContext
from spacerobot.elements.core.desired_motion import DesiredMotion, InitialMotion, TimeProfile
from spacerobot.elements.core.registry import register
from spacerobot.elements.references.knot_motion import Knots, ends_of, slices_of
from spacerobot.elements.references.plan_following import PlanFollower, TipMotion, known
from spacerobot.elements.references.reference import PLANE_TOLERANCE, Reference


@register
class PlanReference(PlanFollower, Reference):
    """Motion of the tip in a plan, in world axes, for any pose of the tip at the beginning."""

    kind: Literal["plan"] = "plan"
    knots: TipMotion | None = Field(
        default=None, description="points of the planned trajectory, if not in a file"
    )

    @classmethod
    def read(cls, file: Path, where: str, phase: str | None = None) -> Mapping[str, Any]:
        """Motion of the tip, in the phase that the path is in."""
        del phase
        from spacerobot.elements.references.plan_file import read_tip

        return read_tip(file, where)

    @property
    def planned(self) -> TipMotion:
        """The planned motion, which was given or read."""
        return known(self.knots)

    def motion(
        self, context: ReferenceContext, start: InitialMotion, pivot: ca.SX | None = None
    ) -> DesiredMotion:
        """Motion through the points; the rotation vector from the last knot is a polynomial."""
        del start, pivot
        planned = self.planned
        knots = Knots.at(context, np.array(planned.times), planned.points)
        position = knots.motion(
            "position", sparse(np.array(planned.position)), sparse(np.array(planned.velocity))
        )
        firsts, turns, rates = turning(planned)
        knot_rotation = ca.reshape(knots.here("behind", sparse(firsts)), 3, 3)
        rotation_vector = knots.between(
            *(
                [knots.here(f"{name} {j}", sparse(each)) for j, each in enumerate(both)]
                for name, both in (("turn", turns), ("turn rate", rates))
            )
        )
        if context.since is not None and knots.event is not None:
            context.since.knots.append(replace(knots.event, armed=context.since.active))
        spin, gain = _spin(rotation_vector)
        return DesiredMotion(
            position=position.value,
            velocity=position.rate,
            acceleration=position.acceleration,
            rotation=ca.mtimes(rotation_exp(rotation_vector.value), knot_rotation),
            angular_velocity=spin,
            angular_acceleration=gain,
        )

    def jumps(self) -> tuple[float, ...]:
        """Times of its knots after the first one [s]."""
        times = self.planned.times
        return tuple(times[k] for k in ends_of(times, self.planned.points)[1:])

    def way(self) -> tuple[Array, Array]:
        """Positions and rotation vectors at the points, relative to the first one."""
        import pinocchio as pin  # not needed to validate a section

        position, rotation = np.array(self.planned.position), np.array(self.planned.rotation)
        first = pin.exp3(rotation[0])
        return position - position[0], np.array([pin.log3(pin.exp3(r) @ first.T) for r in rotation])

    def leaves_plane(self) -> Iterator[tuple[str, list[float]]]:
        """Knots that leave the x-y plane by displacement or rotation."""
        displacements, rotations = self.way()
        deviations = [
            float(np.abs(displacements[:, 2]).max()),
            *(float(x) for x in np.abs(rotations[:, :2]).max(axis=0)),
        ]
        if max(deviations) > PLANE_TOLERANCE:
            yield "knots", deviations

    def words(self) -> str:
        """Duration of the plan."""
        return f"plan of {len(self.planned.times)} points over {self.planned.times[-1]:g} s"


def turning(planned: TipMotion) -> tuple[Array, Array, Array]:
    """Rotations at the start of each interval and at the end (n + 1, 9), column by column.

    Also the rotation vectors from there to the interval's points, and their rates (s, n + 1, 3) each.
    """
    import pinocchio as pin  # not needed to validate a section

    step = planned.points - 1
    rotations, spins = [pin.exp3(np.array(vector)) for vector in planned.rotation], np.array(planned.spin)
    starts = [interval.start for interval in slices_of(planned.times, planned.points)]
    turns, rates = np.zeros((2, step + 1, len(starts) + 1, 3))
    for j in range(step + 1):
        for i, k in enumerate(starts):
            turns[j, i] = pin.log3(rotations[k + j] @ rotations[k].T)
            # spin = J(turn) rate with the left Jacobian, which is the right one of the opposite vector
            rates[j, i] = np.linalg.solve(pin.Jexp3(-turns[j, i]), spins[k + j])
    return np.array([rotations[k].T.ravel() for k in (*starts, -1)]), turns, rates


def _spin(rotation_vector: TimeProfile) -> tuple[ca.SX, ca.SX]:
    """Spin and its rate (3x1 each) of a rotation given by a time-varying rotation vector."""
    if rotation_vector.value.nnz() <= 1:
        return rotation_vector.rate, rotation_vector.acceleration
    vector, rate = ca.SX.sym("vector", 3), ca.SX.sym("rate", 3)
    skew_spin = ca.mtimes(
        ca.reshape(ca.jtimes(ca.vec(rotation_exp(vector)), vector, rate), 3, 3), rotation_exp(vector).T
    )
    spin = ca.vertcat(skew_spin[2, 1], skew_spin[0, 2], skew_spin[1, 0])
    both, change = ca.vertcat(vector, rate), ca.SX.sym("change", 6)
    gain = ca.jtimes(spin, both, change)
    spin_function = ca.Function("spin", [vector, rate, change], [spin, gain])
    spin_value, growing = spin_function(
        rotation_vector.value,
        rotation_vector.rate,
        ca.vertcat(rotation_vector.rate, rotation_vector.acceleration),
    )
    return spin_value, growing
