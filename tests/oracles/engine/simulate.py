"""Rollouts of the independent laws, by the integrator and the root finding of the Pinocchio engine.

Neither is a law: what is checked here, against the casadi engine's own integrator, is what integrates.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.pinocchio_engine import PinocchioTrajectory
from spacerobot.pinocchio_engine.simulate import roll_out
from spacerobot.scene import Scene
from tests.oracles.engine.contacts import touches
from tests.oracles.engine.engine import Engine
from tests.oracles.engine.events import armed, happen
from tests.oracles.engine.kinematics import Kinematics
from tests.oracles.engine.mode import Mode
from tests.oracles.engine.moment import Event, Moment
from tests.oracles.engine.outputs import outputs_at


class SteppedEngine(Engine):
    """An engine as the integrator sees it: events of the present mode by number, guards as one vector."""

    _known: tuple[Mode, tuple[Event, ...]] | None = None

    @property
    def events(self) -> tuple[Event, ...]:
        """What may happen in the present mode."""
        if self._known is None or self._known[0] is not self.mode:
            self._known = self.mode, armed(self)
        return self._known[1]

    @property
    def armed(self) -> range:
        """All of them."""
        return range(len(self.events))

    def guards(self, t: float, x: Array, within: float) -> Array:
        """Guards of the present mode's events (ne,)."""
        moment = Moment(self, t, x, within)
        return np.array([event.guard(moment) for event in self.events])

    def gaps(self, x: Array) -> tuple[Array, Array]:
        """Gaps [m] between the shapes of all contacts, and bounds of their rates [m/s] (n,) each."""
        q, v, _ = self.split(x)
        kinematics, found = Kinematics(self.model, q, v), list[tuple[float, float]]()
        for contact in self.scene.contacts:
            for touch in touches(kinematics, contact):
                found.append((touch.gap, kinematics.approach_speed(touch.pair, contact.config.crown)))
        gaps, speeds = np.array(found).reshape(-1, 2).T
        return gaps, speeds

    def happen(self, number: int, t: float, x: Array, within: float | None = None) -> Array:
        """The state after an event (nx,)."""
        return happen(self, self.events[number], Moment(self, t, x, t))

    def outputs(self, t: float, x: Array, within: float | None = None) -> dict[str, Array]:
        """Outputs by name."""
        return outputs_at(self, t, x, within)


def simulate(
    scene: Scene,
    *,
    output_step_s: float | None = None,
    duration_s: float | None = None,
    rtol: float = 1e-11,
    atol: float = 1e-12,
    progress: Callable[[float], None] | None = None,
) -> PinocchioTrajectory:
    """A rollout of the independent laws; arguments as for the Pinocchio engine's."""
    return roll_out(SteppedEngine(scene), (output_step_s, duration_s), (rtol, atol), progress)
