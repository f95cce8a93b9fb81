"""Genetic algorithm, with the paper's probabilities."""

from __future__ import annotations

from typing import Any, ClassVar

from optim.methods.evolutionary import EvolutionaryMethod
from optim.methods.settings import EvolutionSettings
from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered


@registered
class GeneticAlgorithm(EvolutionaryMethod):
    """Genetic algorithm, with the paper's probabilities."""

    name: ClassVar[str] = "ga"
    title: ClassVar[str] = "GA: genetic algorithm"
    place: ClassVar[float] = 2
    has_own_budget: ClassVar[bool] = True

    def algorithm(self, protocol: EvolutionSettings, first: Array) -> Any:
        """Algorithm of pymoo with its settings."""
        from pymoo.algorithms.soo.nonconvex.ga import GA
        from pymoo.operators.crossover.sbx import SBX
        from pymoo.operators.mutation.pm import PM

        algorithm = GA(
            pop_size=protocol.population,
            sampling=first,
            crossover=SBX(prob=protocol.crossover[0], eta=15),
            mutation=PM(prob=1.0, prob_var=protocol.mutation, eta=20),
            eliminate_duplicates=True,
        )
        algorithm.mating.annealed = True
        return algorithm
