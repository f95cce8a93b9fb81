"""Schemes that update controllers in Python, and the loop that alternates rollouts and updates.

A controller names its scheme by ``update_scheme``. A scheme prepares the scene, so that its closed loop has
states or parameters for the held values, and starts the updates of N simulations. :func:`run_updates` rolls
out each simulation from one update to the next. A single simulation is a batch of one.
"""

from __future__ import annotations

import math
import pkgutil
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.scene import Scene
from spacerobot.updates.plant import ROUNDING, Rows, UpdatedPlant

Notify = Callable[[str], None]


class Updates(Protocol):
    """Updates of the held values of N simulations.

    Attributes:
        next: Time of the next update of each simulation (N,) [s]; infinite for none.
        faults: Error of each simulation that cannot be controlled; None for the others.
    """

    next: Array
    faults: list[SpaceRobotError | None]

    def update(self, rows: Rows) -> None:
        """Update the held values of some simulations and the times of their next updates."""

    def finish(self) -> None:
        """Collect statistics when all simulations have ended."""

    def summary(self) -> Mapping[str, Any]:
        """Entries for the summary of the first simulation."""

    def measures(self) -> Mapping[str, Array]:
        """Statistics of all simulations by name (N, 1); the scheme's ``measures`` has their units."""


class UpdateScheme(Protocol):
    """Scheme that updates some controllers of a scene in Python.

    Attributes:
        scene: Scene whose closed loop has states or parameters for the held values.
        duration_s, period_s: Duration of the simulation, and time between two updates [s].
        prediction_s: Total duration of the rollouts by which the updates of one simulation predict [s].
        intervals: Times [s] that must be multiples of the time between samples, by their names in messages.
        measures: Units of the statistics of each simulation, by name.
    """

    scene: Scene
    duration_s: float
    period_s: float
    prediction_s: float
    intervals: Mapping[str, float]
    measures: ClassVar[Mapping[str, str]]

    @classmethod
    def of(cls, scene: Scene, vary: Collection[str] = ()) -> Self:
        """Prepare a scene.

        Args:
            scene: The scene.
            vary: Dotted paths of numbers that will vary between simulations.
        """

    @property
    def summary(self) -> str:
        """Description of the scheme in one line."""

    def check_batch(self) -> None:
        """Check that several simulations of the scene can run in a batch.

        Raises:
            ScenarioError: If they must run one at a time.
        """

    def start(self, plant: UpdatedPlant, workers: int, backend: str, notify: Notify) -> Updates:
        """Start the updates of simulations.

        Args:
            plant: The simulations.
            workers: Maximum number of worker processes.
            backend: ``auto``, ``compiled`` or ``interpreted``.
            notify: Callback for progress.
        """


def update_schemes(scene: Scene) -> list[str]:
    """Names of the update schemes of a scene's controllers, each once: ``module:class``."""
    controllers = [one for robot in scene.scenario.robots.values() for one in robot.controllers.values()]
    return list(dict.fromkeys(one.update_scheme for one in controllers if one.update_scheme))


@dataclass(frozen=True)
class UpdatedScene:
    """A scene with controllers that are updated in Python.

    Attributes:
        original: The scene before its preparation.
        schemes: Schemes of its controllers. Each scheme prepares the scene of the one before it.
    """

    original: Scene
    schemes: tuple[UpdateScheme, ...]

    @classmethod
    def of(cls, scene: Scene, vary: Collection[str] = ()) -> UpdatedScene | None:
        """Prepare a scene; None if all its controllers are expressions.

        Args:
            scene: The scene.
            vary: Dotted paths of numbers that will vary between simulations.

        Raises:
            ScenarioError: If a scheme cannot control the scene.
        """
        schemes, prepared = list[UpdateScheme](), scene
        for name in update_schemes(scene):
            schemes.append(pkgutil.resolve_name(name).of(prepared, vary))
            prepared = schemes[-1].scene
        return cls(scene, tuple(schemes)) if schemes else None

    @property
    def scene(self) -> Scene:
        """Scene whose closed loop has states or parameters for all held values."""
        return self.schemes[-1].scene

    @property
    def duration_s(self) -> float:
        """Duration of the simulation [s]."""
        return min(scheme.duration_s for scheme in self.schemes)

    @property
    def period_s(self) -> float:
        """Shortest time between two updates [s]."""
        return min(scheme.period_s for scheme in self.schemes)

    @property
    def prediction_s(self) -> float:
        """Total duration of the rollouts by which the updates of one simulation predict [s]."""
        return sum(scheme.prediction_s for scheme in self.schemes)

    @property
    def pieces(self) -> int:
        """Estimated number of rollouts of one simulation, each of one period; predictions are included."""
        return math.ceil((2 * self.duration_s + self.prediction_s) / self.period_s)

    @property
    def measures(self) -> dict[str, str]:
        """Units of the statistics of each simulation, by name."""
        return {name: unit for scheme in self.schemes for name, unit in scheme.measures.items()}


def run_updates(plant: UpdatedPlant, updates: Sequence[Updates], duration_s: float) -> None:
    """Roll out simulations to their ends, and update their controllers in between.

    Args:
        plant: The simulations.
        updates: Updates of their controllers.
        duration_s: Duration of the simulations [s].
    """
    while True:
        rows = np.flatnonzero(~plant.ended & (plant.start[:, 0] < duration_s * (1 - ROUNDING)))
        if not len(rows):
            break
        for each in updates:
            due = rows[plant.start[rows, 0] >= each.next[rows] * (1 - ROUNDING)]
            if len(due):
                each.update(due)
        rows = rows[~plant.ended[rows]]
        now = plant.start[rows, 0]
        until = np.min([each.next[rows] for each in updates], axis=0)
        until[until > duration_s * (1 + ROUNDING)] = duration_s
        for begin, end in sorted(set(zip(now.tolist(), until.tolist(), strict=True))):
            plant.advance(rows[(now == begin) & (until == end)], end)
    for each in updates:
        each.finish()
