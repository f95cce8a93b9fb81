"""Particle swarm optimisation."""

from __future__ import annotations

from typing import Any, ClassVar

from optim.methods.evolutionary import EvolutionaryMethod
from optim.methods.settings import EvolutionSettings
from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered


@registered
class ParticleSwarm(EvolutionaryMethod):
    """Particle swarm optimisation."""

    name: ClassVar[str] = "pso"
    title: ClassVar[str] = "PSO: particle swarm"
    place: ClassVar[float] = 4

    def algorithm(self, protocol: EvolutionSettings, first: Array) -> Any:
        """Algorithm of pymoo with its settings."""
        from pymoo.algorithms.soo.nonconvex.pso import PSO

        return PSO(pop_size=protocol.population, sampling=first)
