"""An engine at one instant, and what may happen to it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from spacerobot.common.arrays import Array
from spacerobot.scene import SceneGrasp
from tests.oracles.engine.contacts import Touch, touches
from tests.oracles.engine.engine import Engine, Instant
from tests.oracles.engine.grasps import Relative
from tests.oracles.engine.kinematics import Kinematics
from tests.oracles.engine.mode import Mode


@dataclass(frozen=True)
class Moment:
    """An engine at one instant; ``within`` as for :meth:`Engine.instant`."""

    engine: Engine
    t: float
    x: Array
    within: float

    @functools.cached_property
    def kinematics(self) -> Kinematics:
        """Of the plant."""
        q, v, _ = self.engine.split(self.x)
        return Kinematics(self.engine.model, q, v)

    @functools.cached_property
    def instant(self) -> Instant:
        """Everything."""
        return self.engine.instant(self.t, self.x, self.within)

    @functools.cached_property
    def touches(self) -> Mapping[str, list[Touch]]:
        """Every pair of shapes of the contacts, by the contact's name."""
        return {
            contact.name: list(touches(self.kinematics, contact)) for contact in self.engine.scene.contacts
        }

    def relative(self, grasp: SceneGrasp) -> Relative:
        """Relative motion of a grasp."""
        return self.engine.relative(self.kinematics, grasp, self.t)


@dataclass(frozen=True)
class Event:
    """Something that may happen.

    Attributes:
        name, kind, who: As the other engine calls it.
        guard: Above zero it happens.
        then: What holds afterwards; None at the end of the simulation.
        impact: Whether rigid grasps that hold afterwards stop what moves in them.
        springs: Grasp whose springs lose what they store.
        state: The state (nx,) afterwards, where an actuator's jumps, from that before with what holds
            afterwards.
    """

    name: str
    kind: str
    who: str
    guard: Callable[[Moment], float]
    then: Callable[[Moment], Mode] | None
    impact: bool = False
    springs: SceneGrasp | None = None
    state: Callable[[Moment], Array] | None = None

    clock = False  # an instant known beforehand, as the engine that ships has some

    @property
    def ends(self) -> bool:
        """Whether it ends the simulation."""
        return self.then is None
