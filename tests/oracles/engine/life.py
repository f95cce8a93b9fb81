"""The life of a grasp, written again: where it closes, how it then holds, and where it lets go."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.elements.grasps.capture import Capture
from spacerobot.scene import Scene, SceneGrasp
from tests.oracles.engine.grasps import Rest
from tests.oracles.engine.references import Jet, cubic_blend

SHORTEST = 1e-6
"""Least way [m, rad] that is drawn in, so that it takes a time."""


def _zeros() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class Life:
    """What is known of a grasp that opens or closes.

    Attributes:
        closed, inside, drawing, released: Whether it holds, is in its envelope and waits, is being drawn in,
            and has let go.
        entered_at, captured_at, draw_time: Times of the last entry and capture, and how long drawing in takes
            [s].
        velocity, spin: Of the tip relative to the target at the last capture (3,) each, world axes.
        gap, turn: Tip relative to where it is mated at the last capture (3,) [m], [rad], axes of the mating
            frame.
        impulse, couple: Of all impacts so far on the target (3,) each, world axes [N s], [N m s].
    """

    closed: bool
    inside: bool = False
    drawing: bool = False
    released: bool = False
    entered_at: float = 0.0
    captured_at: float = -1.0
    draw_time: float = 1.0
    velocity: Array = field(default_factory=_zeros)
    spin: Array = field(default_factory=_zeros)
    gap: Array = field(default_factory=_zeros)
    turn: Array = field(default_factory=_zeros)
    impulse: Array = field(default_factory=_zeros)
    couple: Array = field(default_factory=_zeros)

    @property
    def state(self) -> int:
        """0 open, 1 in its envelope, 2 captured, 3 released."""
        return 3 if self.released else 2 if self.closed else int(self.inside)

    def rest(self, capture: Capture | None, mated: Array, t: float) -> Rest:
        """Where the tip is at rest in the mating frame at time t [s]."""
        if capture is None:
            return Rest(mated)
        left = self._left(t)
        gap, turn = (
            (vector, _zeros(), _zeros()) if rate is None else _scaled(vector, left)
            for vector, rate in ((self.gap, capture.draw_in), (self.turn, capture.draw_in_deg))
        )
        return Rest(mated, gap, turn)

    def _left(self, t: float) -> tuple[float, float, float]:
        """What is left to be drawn in, from 1 to 0, with its derivatives."""
        if not self.drawing:
            return 0.0, 0.0, 0.0
        passed = max(t - self.captured_at, 0.0)
        value, rate, bend = cubic_blend(passed, min(passed, self.draw_time * (1 - 1e-15)), self.draw_time)
        return 1 - value, -rate, -bend


def _scaled(vector: Array, factor: tuple[float, float, float]) -> Jet:
    value, rate, bend = factor
    return value * vector, rate * vector, bend * vector


def first_lives(scene: Scene) -> dict[str, Life]:
    """Of the grasps that open or close, by name."""
    told = {name for phase in scene.scenario.phases.values() for name in phase.releases}
    return {
        grasp.name: Life(grasp.config.begins == "closed")
        for grasp in scene.grasps
        if grasp.config.begins == "open" or grasp.config.release is not None or grasp.name in told
    }


def mated_orientation(grasp: SceneGrasp, at_start: Array) -> Array:
    """Tip's orientation where mated (3, 3), axes of the mating frame: as at the start if it begins closed."""
    capture = grasp.config.capture
    if grasp.config.begins == "closed" or capture is None:
        return at_start
    mated: Array = pin.rpy.rpyToMatrix(np.radians(capture.mated_deg))
    return mated


def draws(grasp: SceneGrasp) -> bool:
    """Whether a grasp is drawn in once it is captured."""
    capture = grasp.config.capture
    return capture is not None and (capture.draw_in is not None or capture.draw_in_deg is not None)


def works_of(scene: Scene) -> Iterator[str]:
    """Works that the lives of grasps need."""
    lives = first_lives(scene)
    living = [grasp for grasp in scene.grasps if grasp.name in lives]
    if any(draws(grasp) for grasp in living):
        yield "draw_in"
    told = {name for phase in scene.scenario.phases.values() for name in phase.releases}
    for grasp in living:
        lets_go = grasp.config.release is not None or grasp.name in told
        if grasp.config.capture is not None if grasp.config.is_rigid else lets_go:
            yield "event"
            return
