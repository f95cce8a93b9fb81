"""Limit states: distance of a quantity from its limit, as a function of standard normal scores.

A limit state g is positive where a simulation keeps to the limit and negative where it fails. Its argument z
has independent standard normal components: a campaign's parameters follow from them through its correlation
(a Gaussian copula) and its distributions, x_j = F_j^-1(Phi((L z)_j)) with L L^T the correlation matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from optim.campaign.sampling.parameter_space import ParameterSpace, campaign_of, gain_set, resolve_space
from optim.campaign.sampling.samplers import score_values
from optim.evaluation import build_quantity_rollout
from optim.reliability.bounded_quantity import bounded_quantity
from spacerobot.common.arrays import Array
from spacerobot.quantities import Quantity
from spacerobot.rollout import Rollout
from spacerobot.scenario import Campaign
from spacerobot.scene import Scene
from spacerobot.updates.scheme import update_schemes

MOST_SCORE = 8.0
"""Largest component of z that is evaluated: P(|z_i| > 8) is 1e-15."""


class LimitState(Protocol):
    """A function that is negative where a system fails, and its gradient."""

    @property
    def names(self) -> Sequence[str]:
        """Names of the k parameters."""

    def values(self, z: Array) -> Array:
        """Values (N,) at scores (N, k); minus infinity where a rollout diverged."""

    def gradients(self, z: Array) -> tuple[Array, Array]:
        """Values (N,) and gradients (N, k) at scores (N, k)."""


@dataclass(frozen=True)
class RolloutLimitState:
    """Limit minus a quantity of a simulation, over the uncertain parameters of its campaign.

    Attributes:
        scene, campaign: The scene and its campaign section.
        space: Map from draws to the scenario's numbers.
        quantity, limit: Quantity and its limit, in the quantity's unit.
        rollout: Rollout whose only cost is the quantity.
        threads: Number of threads; one for each usable core if None; the numbers do not depend on it.
    """

    scene: Scene
    campaign: Campaign
    space: ParameterSpace
    quantity: Quantity
    limit: float
    rollout: Rollout
    threads: int | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the uncertain parameters."""
        return self.space.names

    @property
    def unit(self) -> str:
        """Unit of the quantity."""
        return self.quantity.unit_in(self.scene)

    @cached_property
    def cholesky(self) -> Array:
        """Factor L (k, k) of the correlation matrix."""
        rows = self.campaign.correlation
        return np.eye(len(self.names)) if rows is None else np.linalg.cholesky(np.array(rows))

    def draws(self, z: Array) -> tuple[Array, Array]:
        """Parameters x (N, k) at scores z (N, k), and dx_j / d(L z)_j (N, k)."""
        scores = np.clip(np.atleast_2d(z), -MOST_SCORE, MOST_SCORE) @ self.cholesky.T
        parameters = self.campaign.parameters.values()
        pairs = [score_values(one, column) for one, column in zip(parameters, scores.T, strict=True)]
        return np.column_stack([value for value, _ in pairs]), np.column_stack([slope for _, slope in pairs])

    def quantities(self, draws: Array) -> Array:
        """Values (N,) of the quantity at draws (N, k); NaN where a rollout diverged."""
        batch = self.rollout.batch(self.space.paths, self.space.values(draws), threads=self.threads)
        if batch.cancelled:
            raise KeyboardInterrupt
        return np.array(batch.costs[self.quantity.name])

    def quantity_gradients(self, draws: Array) -> tuple[Array, Array]:
        """Values (N,) of the quantity at draws (N, k), and exact gradients (N, k) by the draws."""
        name, space = self.quantity.name, self.space
        batch = self.rollout.gradient_batch(
            space.paths, space.values(draws), costs=[name], threads=self.threads, orders=False
        )
        by_number = np.asarray(batch.gradients[name]) * space.factor
        of_draw = np.eye(len(space.names))[list(space.owner)]  # which draw each number follows
        return np.array(batch.costs[name]), by_number @ of_draw

    def values(self, z: Array) -> Array:
        """Values (N,) at scores (N, k); minus infinity where a rollout diverged."""
        margins = self.limit - self.quantities(self.draws(z)[0])
        return np.where(np.isnan(margins), -np.inf, margins)

    def gradients(self, z: Array) -> tuple[Array, Array]:
        """Values (N,) and gradients (N, k) at scores (N, k); NaN where a rollout diverged."""
        draws, slopes = self.draws(z)
        quantity, by_draw = self.quantity_gradients(draws)
        return self.limit - quantity, -(by_draw * slopes) @ self.cholesky


@dataclass
class CountedLimitState:
    """A limit state that counts its evaluations.

    Attributes:
        state: The limit state.
        rollouts, gradients: Evaluations so far.
    """

    state: LimitState
    rollouts: int = field(default=0)
    gradient_rollouts: int = field(default=0)

    @property
    def names(self) -> Sequence[str]:
        """Names of the parameters."""
        return self.state.names

    def values(self, z: Array) -> Array:
        """Values (N,) at scores (N, k)."""
        self.rollouts += len(z)
        return self.state.values(z)

    def gradients(self, z: Array) -> tuple[Array, Array]:
        """Values (N,) and gradients (N, k) at scores (N, k)."""
        self.gradient_rollouts += len(z)
        return self.state.gradients(z)


def build_limit_state(
    scene: Scene, quantity: str | None = None, limit: float | None = None, *, threads: int | None = None
) -> RolloutLimitState:
    """Limit state of a scene over the uncertain parameters of its ``campaign`` section.

    Args:
        scene: A scene whose scenario has a ``campaign`` section.
        quantity: Name of a registered quantity; the one that ``campaign.limits`` bounds if None.
        limit: Largest value that is not a failure, in the quantity's unit; ``campaign.limits`` if None.
        threads: Number of threads; one for each usable core if None.

    Raises:
        ScenarioError: If the section is missing or does not fit, not exactly one quantity is bounded, the
            quantity does not apply to the scene, or plans are solved in the rollout.
    """
    campaign = campaign_of(scene)
    chosen, bound = bounded_quantity(scene, quantity, limit)
    scene = gain_set(scene, {})
    if update_schemes(scene):
        raise scene.error(
            "a controller is updated in Python (kind mpc: by plans), which has no exact gradient; use "
            "`spacerobot campaign`",
            "robots",
        )
    space = resolve_space(scene, campaign)
    rollout, _ = build_quantity_rollout(scene, [chosen], space.paths, step=campaign.step)
    return RolloutLimitState(scene, campaign, space, chosen, bound, rollout, threads)
