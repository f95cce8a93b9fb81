"""One face for the two engines, so that a law can be held to both."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import PinocchioLoop, simulate
from spacerobot.rollout import Trajectory, build_rollout
from spacerobot.scene import Scene


class Symbolic:
    """The first engine, interpreted."""

    def __init__(self, scene: Scene, changes: Mapping[str, float] | None = None, vary: tuple[str, ...] = ()):
        self.loop = build_closed_loop(scene, vary)
        self.change(changes or {})

    def change(self, changes: Mapping[str, float]) -> None:
        """Use other parameter values from here on."""
        x0, c = self.loop.setup(self.loop.parameters(changes))
        self.x0, self.c = x0.full().ravel(), c.full().ravel()

    @property
    def names(self) -> tuple[str, ...]:
        return self.loop.state_names

    def rate(self, t: float, x: np.ndarray) -> np.ndarray:
        return self.loop.dynamics(t, x, self.loop.at(t, x, self.c)).full().ravel()

    def outputs(self, t: float, x: np.ndarray) -> dict[str, np.ndarray]:
        values = self.loop.outputs(t, x, self.loop.at(t, x, self.c))
        return {n: v.full().ravel() for n, v in zip(self.loop.outputs.name_out(), values, strict=True)}

    def run(self, duration_s: float, output_step_s: float, step_s: float = 2e-3) -> Trajectory:
        steps = {"duration_s": duration_s, "step_s": step_s, "output_step_s": output_step_s}
        return build_rollout(self.loop, **steps, backend="interpreted").run()


class Numeric:
    """The second engine."""

    def __init__(self, scene: Scene):
        self.scene, self.engine = scene, PinocchioLoop(scene)
        self.x0 = self.engine.x0
        self._first = build_names(scene)

    @property
    def names(self) -> tuple[str, ...]:
        return (*self._first, *self.engine.state_names)

    def rate(self, t: float, x: np.ndarray) -> np.ndarray:
        return self.engine.derivative(t, x)

    def outputs(self, t: float, x: np.ndarray) -> dict[str, np.ndarray]:
        return self.engine.outputs(t, x)

    def run(self, duration_s: float, output_step_s: float, step_s: float = 2e-3) -> Trajectory:
        return simulate(
            self.scene, duration_s=duration_s, output_step_s=output_step_s, rtol=1e-10, atol=1e-11
        )


def build_names(scene: Scene) -> list[str]:
    """Names of q and v, as the first engine gives them."""
    names = []
    for kind, sizes in (("q", scene.model.nqs), ("v", scene.model.nvs)):
        for joint in range(1, scene.model.njoints):
            n = sizes[joint]
            names += [f"{kind}.{scene.model.names[joint]}" + (f"[{i}]" if n > 1 else "") for i in range(n)]
    return names


ENGINES = {"casadi": Symbolic, "pinocchio": Numeric}


def part(engine: Symbolic | Numeric, x: np.ndarray, name: str) -> np.ndarray:
    """Entries of a state (or of its rate) whose names begin so."""
    return x[places(engine, name)]


def places(engine: Symbolic | Numeric, name: str) -> list[int]:
    """Places of the entries whose names are this one, with or without an index."""
    found = [i for i, own in enumerate(engine.names) if own == name or own.startswith(f"{name}[")]
    assert found, f"no state {name}"
    return found
