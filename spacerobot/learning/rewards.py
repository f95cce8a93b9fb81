"""Rewards of a step: weights of outputs, actions and registered quantities, bonuses for events."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.quantities import Quantity

Outputs = Mapping[str, Array]
"""Outputs at the end of a step, each (n,)."""
RewardFunction = Callable[[Outputs, Array, Sequence[str]], float]
"""Function of the outputs, the action and the names and kinds of the events of a step."""

DIVERGED = "diverged"
"""Kind of event of a rollout that did not reach the end of its step."""


@dataclass(frozen=True)
class OutputPart:
    """Components of an output of the closed loop.

    Attributes:
        name: Name of the output.
        places: Indices of the components.
    """

    name: str
    places: tuple[int, ...]

    def of(self, outputs: Outputs) -> Array:
        """Return the components (N, k) in outputs (N, n); one without a value reads 0."""
        return np.nan_to_num(outputs[self.name][:, list(self.places)], nan=0.0)


@dataclass(frozen=True)
class Reward:
    """Weighted sum of the rewards of a step.

    Attributes:
        period: Time between two actions [s].
        outputs: Outputs y and their weights w: w |y| times the period.
        effort: Weight of the squared norm of the action times the period.
        quantities: Quantities and their weights: weight times the increase in the step, so that the rewards
            of an episode add up to the weight times the change of the quantity.
        bonuses: Rewards for each event of a kind or name.
    """

    period: float
    outputs: tuple[tuple[OutputPart, float], ...] = ()
    effort: float = 0.0
    quantities: tuple[tuple[Quantity, float], ...] = ()
    bonuses: Mapping[str, float] | None = None

    def running(self, outputs: Outputs, actions: Array) -> Array:
        """Rewards (N,) of outputs (N, n) and actions (N, m) that last for a period."""
        rate = self.effort * np.square(actions).sum(axis=1)
        for one, weight in self.outputs:
            rate = rate + weight * np.linalg.norm(one.of(outputs), axis=1)
        return np.asarray(rate * self.period)

    def of_quantities(self, before: Outputs, after: Outputs) -> Array:
        """Rewards (N,) for the changes of the weighted quantities over a step."""
        parts = [
            weight * (each.weighed(after[each.name]) - each.weighed(before[each.name])).sum(axis=1)
            for each, weight in self.quantities
        ]
        return np.sum(parts, axis=0) if parts else np.zeros(1)

    def of_events(self, words: Sequence[str]) -> float:
        """Reward for the events of one episode, by their kinds and names."""
        return float(sum(bonus * words.count(name) for name, bonus in (self.bonuses or {}).items()))
