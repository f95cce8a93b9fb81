"""Differential evolution."""

from __future__ import annotations

from typing import Any, ClassVar

from optim.methods.evolutionary import EvolutionaryMethod
from optim.methods.settings import EvolutionSettings
from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered


@registered
class DifferentialEvolution(EvolutionaryMethod):
    """Differential evolution."""

    name: ClassVar[str] = "de"
    title: ClassVar[str] = "DE: differential evolution"
    place: ClassVar[float] = 3

    def algorithm(self, protocol: EvolutionSettings, first: Array) -> Any:
        """Algorithm of pymoo with its settings."""
        from pymoo.algorithms.soo.nonconvex.de import DE

        return DE(pop_size=protocol.population, sampling=first, variant="DE/rand/1/bin", CR=0.9, F=0.6)
