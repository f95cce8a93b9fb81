"""Desired motions of a scene's tips, as its closed loop has them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import casadi as ca
import numpy as np

from spacerobot.closedloop import ClosedLoop
from spacerobot.closedloop.build import assemble, builder_of, evaluate
from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.elements import DesiredMotion
from spacerobot.scene import Scene


@dataclass(frozen=True)
class Motion:
    """Desired pose and motion of a tip, world axes: fields as of ``DesiredMotion``."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    rotation: np.ndarray
    angular_velocity: np.ndarray
    angular_acceleration: np.ndarray


class DesiredMotions:
    """Desired motions of all tips at any time and state.

    Attributes:
        loop: Closed loop of the scene.
        x0: Initial state (nx,).
    """

    def __init__(self, scene: Scene):
        builder = builder_of(LoopBuilder, scene)
        evaluated = evaluate(builder)
        self.loop: ClosedLoop = assemble(builder, evaluated)
        self.x0, self._c = (part.full().ravel() for part in self.loop.setup(self.loop.parameter_values))
        x = ca.vertcat(builder.plant.q, builder.plant.v, *(state.symbol for state in evaluated.acting.states))
        self._labels, self._names = list(builder.motions), [part.name for part in fields(DesiredMotion)]
        parts = [getattr(motion, name) for motion in builder.motions.values() for name in self._names]
        arguments = [builder.context.time, x, builder.context.constants.symbols]
        self._motions = ca.Function("motions", arguments, [ca.densify(part) for part in parts])

    def at(self, t: float, x: np.ndarray) -> dict[str, Motion]:
        """Desired motion of each tip at time t [s] and state x (nx,), by the tip's label."""
        values = iter(self._motions(t, x, self.loop.at(t, x, self._c)))
        motions = {}
        for label in self._labels:
            parts = {name: next(values).full() for name in self._names}
            motions[label] = Motion(
                **{name: part if name == "rotation" else part.ravel() for name, part in parts.items()}
            )
        return motions

    def rate(self, t: float, x: np.ndarray) -> np.ndarray:
        """Rate of the state (nx,)."""
        return self.loop.dynamics(t, x, self.loop.at(t, x, self._c)).full().ravel()

    def outputs(self, t: float, x: np.ndarray) -> dict[str, np.ndarray]:
        """Outputs by name, as column vectors."""
        values = self.loop.outputs(t, x, self.loop.at(t, x, self._c))
        return {name: v.full() for name, v in zip(self.loop.outputs.name_out(), values, strict=True)}
