"""Subset simulation: a rare failure as a sequence of failures that are not rare."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from optim.reliability.design_points import DesignPoint
from optim.reliability.estimator import ProbabilityEstimate, ProbabilityEstimator, SamplingEffort
from optim.reliability.limit_state import MOST_SCORE, LimitState
from spacerobot.common.registry import registered

SHARE = 0.1  # of the samples that enter the next level
LEVELS = 12
SIZE = 2000  # samples of a level
CORRELATION = 0.8  # of a state of the Markov chains with the next one


@registered
class SubsetSimulation(ProbabilityEstimator):
    """Levels of failure by Markov chains (Au and Beck, Probabilistic Engineering Mechanics 16, 2001).

    The chains use the conditional sampling of Papaioannou and others (Probabilistic Engineering Mechanics 41,
    2015). No gradients are needed.
    """

    name: ClassVar[str] = "subset"
    title: ClassVar[str] = "subset simulation"
    place: ClassVar[float] = 3
    needs_design_points: ClassVar[bool] = False

    def estimate(
        self,
        state: LimitState,
        points: Sequence[DesignPoint],  # noqa: ARG002
        effort: SamplingEffort,
    ) -> ProbabilityEstimate:
        """Product of the levels' probabilities; see :meth:`ProbabilityEstimator.estimate`."""
        # P(g < 0) = P(g < l_1) P(g < l_2 | g < l_1) ..., with levels l_i for factors of about SHARE.
        # Trials r z + sqrt(1 - r^2) e with standard normal e keep the standard normal distribution; rejecting
        # those above the level makes the chain sample the distribution conditional on g < l_i.
        rng = effort.rng
        size = min(SIZE, effort.budget)
        seed_count = int(SHARE * size)
        steps = int(1 / SHARE)
        z = rng.standard_normal((1, size, len(state.names)))  # (steps of a chain, chains, k)
        values = state.values(z[0])[None]
        probability, variance, spent = 1.0, 0.0, size
        for _ in range(LEVELS):
            flat = np.sort(values.ravel())
            level = (
                0.5 * (flat[seed_count - 1] + flat[seed_count])
                if np.isfinite(flat[seed_count - 1])
                else flat[seed_count - 1]
            )
            level = max(0.0, level)
            inside = values < level if level > 0 else values < 0
            share = float(inside.mean())
            if share == 0:
                return ProbabilityEstimate(0.0, np.inf)
            probability *= share
            # squared coefficient of variation of the share of correlated samples, Au and Beck's Eq. 28 and 29
            length = len(inside)
            centred = inside - share
            start = float(np.mean(centred**2))
            gamma = 0.0
            for lag in range(1, length):
                correlation = float(np.mean(centred[lag:] * centred[:-lag])) / start if start > 0 else 0.0
                gamma += 2 * (1 - lag / length) * correlation
            variance += (1 - share) / (share * inside.size) * max(1.0, 1 + gamma)
            if level <= 0 or spent + seed_count * (steps - 1) > effort.budget:
                break
            seeds, at = z[inside], values[inside]
            # Markov chains below the level: states (steps, chains, k) and their values (steps, chains)
            path, chain_values = [seeds], [at]
            for _ in range(steps - 1):
                increments = rng.standard_normal(seeds.shape)
                trial = CORRELATION * path[-1] + np.sqrt(1 - CORRELATION**2) * increments
                trial = np.clip(trial, -MOST_SCORE, MOST_SCORE)
                value = state.values(trial)
                accepted = value < level
                path.append(np.where(accepted[:, None], trial, path[-1]))
                chain_values.append(np.where(accepted, value, chain_values[-1]))
            z, values = np.array(path), np.array(chain_values)
            spent += len(seeds) * (steps - 1)
        if level > 0:
            return ProbabilityEstimate(0.0, np.inf)
        return ProbabilityEstimate(probability, float(np.sqrt(variance)))
