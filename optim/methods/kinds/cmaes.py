"""Covariance matrix adaptation (CMA-ES), which restarts by itself."""

from __future__ import annotations

from typing import Any, ClassVar

from optim.methods.evolutionary import CMAES_POPULATION, CMAES_TOLERANCES, EvolutionaryMethod
from optim.methods.settings import EvolutionSettings
from spacerobot.common.arrays import Array
from spacerobot.common.registry import registered


@registered
class CmaEs(EvolutionaryMethod):
    """Covariance matrix adaptation (CMA-ES), which restarts by itself."""

    name: ClassVar[str] = "cmaes"
    title: ClassVar[str] = "CMA-ES: covariance adaptation"
    place: ClassVar[float] = 5

    def algorithm(self, protocol: EvolutionSettings, first: Array) -> Any:
        """Algorithm of pymoo with its settings."""
        from pymoo.algorithms.soo.nonconvex.cmaes import CMAES

        return CMAES(
            x0=first,
            sigma=0.3,
            restarts=9,
            bipop=True,
            pop_size=CMAES_POPULATION,
            maxfevals=protocol.budget,
            **CMAES_TOLERANCES,
        )
