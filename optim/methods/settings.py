"""Settings and budgets of tuning methods."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

from spacerobot.scenario import Tuning


class SearchSettings:
    """Settings of a method, on which the journal of a run depends."""

    def fingerprint(self, *others: object) -> str:
        """Hash of everything on which a journal depends except the problem: method, seed and settings."""
        return hashlib.sha256(repr((self, *others)).encode()).hexdigest()


@dataclass(frozen=True)
class EvolutionSettings(SearchSettings):
    """Settings of an evolutionary method; the defaults are the paper's.

    Attributes:
        population, budget: Individuals, and rollouts in all: the paper has 150 generations and does not print
            the population.
        crossover: Probability at the first and at the last generation (GA): 0.5 falling to 0.1-0.2 in the
            paper.
        mutation: Probability of each gene to mutate (GA): 0.01-0.1 in the paper.
    """

    population: int = 50
    budget: int = 50 * 150
    crossover: tuple[float, float] = (0.5, 0.15)
    mutation: float = 0.05


@dataclass(frozen=True)
class NlpSettings(SearchSettings):
    """Settings of nonlinear programming.

    Attributes:
        iterations: Maximum number of iterations from one start.
        tolerance: Predicted decrease of the objective, relative to its value, at which a descent ends.
        screen: Points of a Sobol sequence that are evaluated for each start.
        budget: Cost after which the search ends, in rollouts: a gradient counts as four, a slope as three.
            None sets no limit.
    """

    iterations: int = 100
    tolerance: float = 1e-4
    screen: int = 8
    budget: int | None = None


@dataclass(frozen=True)
class Effort:
    """Budget of each method.

    Attributes:
        protocol: Settings of the evolutionary methods with a budget of their own, such as the GA.
        baseline: Settings of the other evolutionary methods.
        runs: Number of runs of each evolutionary method.
        nlp, starts: Settings of the NLP and its number of starts.
        repeats: Number of runs of the NLP, each with its own seed.
        seed: Seed of the first run.
    """

    protocol: EvolutionSettings = field(default_factory=EvolutionSettings)
    baseline: EvolutionSettings = field(default_factory=EvolutionSettings)
    runs: int = 6
    nlp: NlpSettings = field(default_factory=NlpSettings)
    starts: int = 4
    seed: int = 0
    repeats: int = 1


def effort_of(tuning: Tuning, **changes: int | None) -> Effort:
    """Effort of a tuning section.

    Args:
        tuning: The section.
        **changes: ``budget``, ``baseline_budget``, ``runs``, ``starts``, ``seed`` and ``repeats`` that
            replace the section's; None keeps one.
    """
    settings = {name: value for name, value in changes.items() if value is not None}
    evolution = EvolutionSettings(population=tuning.population, budget=settings.get("budget", tuning.budget))
    baseline_budget = min(evolution.budget, settings.get("baseline_budget", tuning.baseline_budget))
    baseline = dataclasses.replace(evolution, budget=baseline_budget)
    return Effort(
        evolution,
        baseline,
        settings.get("runs", tuning.runs),
        NlpSettings(iterations=tuning.iterations),
        settings.get("starts", tuning.starts),
        settings.get("seed", tuning.seed),
        settings.get("repeats", 1),
    )


def stated_effort(effort: Effort | Mapping[str, int | None] | None, tuning: Tuning) -> Effort:
    """Effort that was given, or that of a tuning section with changes, as of :func:`effort_of`."""
    return effort if isinstance(effort, Effort) else effort_of(tuning, **(effort or {}))
