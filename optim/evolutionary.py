"""Evolutionary methods through pymoo: GA, differential evolution, PSO and CMA-ES, by one switch."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from optim.protocol import Array, Evaluation, Problem
from optim.search import Run, Search
from spacerobot.errors import SpaceRobotError, near_names

CMAES_POPULATION = 16  # two groups of eight lanes
DIVERGED = 1e3  # violation that a diverged rollout stands for: behind every other infeasible point


@dataclass(frozen=True)
class Protocol:
    """How an evolutionary method is run; the defaults are the paper's.

    Attributes
    ----------
    population, budget
        Individuals, and rollouts in all: the paper has 150 generations and does not print the population.
    crossover
        Probability at the first and at the last generation (GA): 0.5 falling to 0.1-0.2 in the paper.
    mutation
        Probability of each gene to mutate (GA): 0.01-0.1 in the paper.
    """

    population: int = 50
    budget: int = 50 * 150
    crossover: tuple[float, float] = (0.5, 0.15)
    mutation: float = 0.05

    def fingerprint(self, method: str, seed: int) -> str:
        """What a journal of such a run depends on beside the problem."""
        return hashlib.sha256(repr((self, method, seed)).encode()).hexdigest()


def evolve(search: Search, protocol: Protocol) -> Run:
    """Search with an evolutionary method, named by ``search.method``.

    Parameters
    ----------
    search
        What evaluates; its seed decides everything random.
    protocol
        Population, budget and probabilities.

    Returns
    -------
    Run
        Status ``budget spent``, ``converged`` (CMA-ES alone stops by itself) or ``interrupted``.

    Raises
    ------
    SpaceRobotError
        If there is no such method.
    """
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.termination import NoTermination
    from pymoo.problems.static import StaticProblem

    if search.method not in METHODS:
        raise SpaceRobotError(
            f"no evolutionary method '{search.method}', {near_names(search.method, METHODS)}"
        )
    shape = _shape(search.problem, penalised=search.method == "cmaes")
    algorithm = METHODS[search.method](protocol)
    seed = search.seed + (search.method == "cmaes")  # which takes the time for a seed where it is given 0
    algorithm.setup(shape, termination=NoTermination(), seed=seed, verbose=False)
    fitness = _Fitness(penalised=search.method == "cmaes")
    status = "budget spent"
    try:
        while algorithm.has_next():
            _anneal(algorithm, protocol, search.cost.rollouts / protocol.budget)
            asked = algorithm.ask()
            points = asked.get("X")
            if search.cost.rollouts + len(points) > protocol.budget:
                break
            objective, constraints = fitness(search.evaluate(points))
            Evaluator().eval(StaticProblem(shape, F=objective, G=constraints), asked)
            algorithm.tell(infills=asked)
            search.tell(search.cost.rollouts / protocol.budget)
        else:
            status = "converged"
    except KeyboardInterrupt:
        status = "interrupted"
    return search.finish(status)


class _Fitness:
    """Turns values into what pymoo ranks: a diverged rollout is infeasible, never a number."""

    def __init__(self, *, penalised: bool) -> None:
        self._penalised = penalised
        self._worst = 1.0

    def __call__(self, found: Evaluation) -> tuple[Array, Array]:
        lost = ~np.isfinite(found.violation)
        finite = found.objective[~lost]
        self._worst = max(self._worst, float(np.abs(finite).max(initial=0.0)))
        if self._penalised:
            violation = np.where(lost, DIVERGED, found.violation)
            value = np.where(violation > 0, self._worst * (2 + violation), found.objective)
            return value[:, None], np.empty((len(value), 0))
        value = np.where(lost, self._worst * DIVERGED, found.objective)
        constraints = np.where(lost[:, None], DIVERGED, found.constraints)
        return value[:, None], np.column_stack([constraints, np.where(lost, DIVERGED, -1.0)])


def _shape(problem: Problem, *, penalised: bool) -> Any:
    from pymoo.core.problem import Problem as PymooProblem

    k = len(problem.names)
    constraints = 0 if penalised else len(problem.constraint_names) + 1
    return PymooProblem(n_var=k, n_obj=1, n_ieq_constr=constraints, xl=np.zeros(k), xu=np.ones(k))


def _anneal(algorithm: Any, protocol: Protocol, share: float) -> None:
    """Let the GA's crossover probability fall linearly with the budget spent."""
    mating = getattr(algorithm, "mating", None)
    if mating is not None and hasattr(mating, "annealed"):
        first, last = protocol.crossover
        mating.crossover.prob.set(first + (last - first) * min(share, 1.0))


def _ga(protocol: Protocol) -> Any:
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.operators.crossover.sbx import SBX
    from pymoo.operators.mutation.pm import PM
    from pymoo.operators.sampling.rnd import FloatRandomSampling

    algorithm = GA(
        pop_size=protocol.population,
        sampling=FloatRandomSampling(),
        crossover=SBX(prob=protocol.crossover[0], eta=15),
        mutation=PM(prob=1.0, prob_var=protocol.mutation, eta=20),
        eliminate_duplicates=True,
    )
    algorithm.mating.annealed = True
    return algorithm


def _de(protocol: Protocol) -> Any:
    from pymoo.algorithms.soo.nonconvex.de import DE

    return DE(pop_size=protocol.population, variant="DE/rand/1/bin", CR=0.9, F=0.6)


def _pso(protocol: Protocol) -> Any:
    from pymoo.algorithms.soo.nonconvex.pso import PSO

    return PSO(pop_size=protocol.population)


def _cmaes(protocol: Protocol) -> Any:
    from pymoo.algorithms.soo.nonconvex.cmaes import CMAES

    return CMAES(sigma=0.3, restarts=9, pop_size=CMAES_POPULATION, maxfevals=protocol.budget)


METHODS: dict[str, Callable[[Protocol], Any]] = {"ga": _ga, "de": _de, "pso": _pso, "cmaes": _cmaes}
"""Makers of pymoo's algorithms, by name."""
