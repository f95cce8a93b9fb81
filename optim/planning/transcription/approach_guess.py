"""Initial guesses of bases that fly to a moving target: arrival time and path.

The goal places the base relative to the target, at the point u of the target's own frame. The guess

    p(s) = c + r(s) d(s),   r(s) = r_0 + b(s) (r_1 - r_0),   b(s) = s^3 (10 - 15 s + 6 s^2)

leads around the target's origin c, which drifts, from the direction d_0 at the start to that of u, which
rotates with the target. Directions in between lie on a great circle, at its fraction b(s). The attitude
rotates with the direction d(s) along the shortest rotation, so that an instrument that sees the target at
both ends sees it throughout. Candidate arrivals are times at which u faces the side of the start.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.formulation.stage import PlanningProblem
from spacerobot.common.arrays import Array
from spacerobot.scene.scene import SceneBody

SAMPLES = 240
"""Number of instants at which the target's drift is sampled for arrivals, and the path for its attitude."""
FOLLOWED, FOLLOWED_TURN = 0.25, 0.5
"""Final share of the duration during which the path follows the rotating target, and the maximum rotation of
the goal's point in that time [rad]."""
RANGE = 1.25
"""Ratio of the ends of each range of durations; one arrival is chosen from each range."""
SPARE = 1.3
"""Shortest duration, relative to a rest-to-rest motion at full thrust."""


def approached(problem: PlanningProblem, body: SceneBody) -> bool:
    """Whether the goal places a base, driven by force and torque, relative to the moving target.

    Args:
        problem: The problem.
        body: The robot.
    """
    stage, target = problem.stage, problem.stage.scene.target
    axes = stage.driven.of_base(body.name)
    is_driven = {axis[0] for axis in axes} == {"f", "t"}
    if not is_driven or target is None or not target.root_joint or not problem.goal:
        return False
    if stage.scene.planar or stage.grips:
        return False
    joint = stage.scene.model.joints[target.root_joint]
    place = stage.q[joint.idx_q : joint.idx_q + joint.nq]
    return bool(ca.depends_on(ca.vertcat(*(row.value for row in problem.goal)), place))


@dataclass(frozen=True, eq=False)
class TargetApproach:
    """An approach to a drifting target.

    Attributes:
        start: Placement of the base at the start.
        mated: Placement of the base in the target's frame at the end.
        target: Placement of the target at a time [s].
        limits: Minimum and maximum duration [s].
        acceleration: Maximum acceleration of the base [m/s^2].
    """

    start: pin.SE3
    mated: pin.SE3
    target: Callable[[float], pin.SE3]
    limits: tuple[float, float]
    acceleration: float

    @functools.cached_property
    def durations(self) -> Array:
        """Durations [s] (n,) in ascending order.

        The range from the shortest duration that thrust allows is divided into parts of ratio :data:`RANGE`.
        Each part contributes the duration at which the goal's point is nearest to the side of the start.
        """
        times = np.linspace(*self.limits, SAMPLES)
        first = self.start.translation - self.target(0.0).translation
        angles, paths = np.empty(SAMPLES), np.empty(SAMPLES)
        for k, time in enumerate(times):
            last = self.target(time).rotation @ self.mated.translation
            cosine = first @ last / np.linalg.norm(first) / np.linalg.norm(last)
            angles[k] = np.arccos(np.clip(cosine, -1, 1))
            paths[k] = abs(np.linalg.norm(first) - np.linalg.norm(last)) + angles[k] * np.linalg.norm(last)
        is_reached = times >= SPARE * 2 * np.sqrt(paths / max(self.acceleration, 1e-12))
        begin, choices = float(times[is_reached][0] if is_reached.any() else times[-1]), list[float]()
        while begin <= times[-1]:
            inside = np.flatnonzero((times >= begin - 1e-9) & (times < RANGE * begin) & is_reached)
            if inside.size:
                choices.append(float(times[inside[np.argmin(angles[inside])]]))
            begin *= RANGE
        return np.array(choices or [times[-1]])

    def path(self, duration: float) -> Callable[[float], pin.SE3]:
        """Placement of the base as a function of the share of a duration [s].

        Beyond 0 and 1 the motion continues steadily.
        """
        first = self.start.translation - self.target(0.0).translation
        near, far = np.linalg.norm(self.mated.translation), np.linalg.norm(first)
        late = FOLLOWED * duration
        ends = [self.target(t).rotation @ self.mated.translation / near for t in (0.99 * duration, duration)]
        turning = np.linalg.norm(ends[1] - ends[0]) / (0.01 * duration)  # [rad/s]
        late = min(late, FOLLOWED_TURN / max(float(turning), 1e-12))

        def direction(s: float) -> Array:
            """Unit vector (3,) from the target's origin to the base."""
            # the target's rotation counts near the end only; far away the base would fly around the target
            # to follow it
            time = duration - late * np.tanh((1 - s) * duration / late)
            last = self.target(time).rotation @ self.mated.translation
            turn = pin.Quaternion.FromTwoVectors(first / far, last / near).toRotationMatrix()
            return np.asarray(pin.exp3(blend(s) * pin.log3(turn)) @ (first / far))

        # attitudes from the end backwards in time, and their error at the start, which is blended out
        share = np.linspace(1, 0, SAMPLES + 1)
        directions = [direction(s) for s in share]
        turned = [self.target(duration).rotation @ self.mated.rotation]
        for before, here in itertools.pairwise(directions):
            turned.append(pin.Quaternion.FromTwoVectors(before, here).toRotationMatrix() @ turned[-1])
        off = pin.log3(turned[-1].T @ self.start.rotation)
        attitudes = [r @ pin.exp3((1 - blend(s)) * off) for s, r in zip(share, turned, strict=True)]

        def placement(s: float) -> pin.SE3:
            """Placement of the base at a share of the duration."""
            if not 0 <= s <= 1:
                here, inside = placement(round(s)), placement(2 * round(s) - s)
                return here * inside.actInv(here)
            at = (1 - s) * SAMPLES
            k = min(int(at), SAMPLES - 1)
            one, other = attitudes[k], attitudes[k + 1]
            rotation = one @ pin.exp3((at - k) * pin.log3(one.T @ other))
            radius = far + blend(s) * (near - far)
            return pin.SE3(rotation, self.target(s * duration).translation + radius * direction(s))

        return placement


def blend(s: float) -> float:
    """Blend b(s) from 0 to 1, with zero velocity and acceleration at both ends."""
    return float(s**3 * (10 - 15 * s + 6 * s**2))
