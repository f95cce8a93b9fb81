"""Evolutionary methods through pymoo (GA, differential evolution, PSO, CMA-ES), random and Sobol search.

Each tries the problem's own start first, as the NLP does, so that all methods know the same.
A population that has converged, or no longer improves, is begun anew from another seed until the budget is
spent. CMA-ES restarts by itself: with a population doubled each time, beside small ones (BIPOP), each ended
by its own tolerances.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from optim.problem.problem import Evaluation, OptimisationProblem
from optim.search.search import FEASIBLE, Search, SearchRun, better
from spacerobot.arrays import Array
from spacerobot.errors import SpaceRobotError, near_names

CMAES_POPULATION = 16  # two groups of eight lanes
CMAES_SCREEN = 20  # points of which the best is its first mean
STAGNANT = 30  # generations within which the best must improve
STAGNANT_FALL = 1e-4  # by so much, relative to it
SPREAD = 1e-6  # of the unit cube: a population within it has converged
AT_ONCE = 64  # points that a random or Sobol search tries together
CMAES_TOLERANCES = {"tolfun": 1e-8, "tolx": 1e-6}  # of the first objectives, and of the unit cube
DIVERGED = 1e3  # violation that a diverged rollout stands for: behind every other infeasible point


@dataclass(frozen=True)
class EvolutionSettings:
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
        """Hash of the data, in addition to the problem, on which a journal of such a run depends.

        Parameters
        ----------
        method
            Name of the method.
        seed
            Seed of the run.
        """
        return hashlib.sha256(repr((self, method, seed)).encode()).hexdigest()


def evolve(search: Search, protocol: EvolutionSettings) -> SearchRun:
    """Search with the method that ``search.method`` names, until the budget is spent.

    Parameters
    ----------
    search
        What evaluates; its seed decides everything random.
    protocol
        Population, budget and probabilities.

    Returns
    -------
    Run
        Status ``budget spent`` or ``interrupted``; the message says how often the population was begun anew.

    Raises
    ------
    SpaceRobotError
        If there is no such method.
    """
    if search.method not in METHODS:
        raise SpaceRobotError(
            f"no evolutionary method '{search.method}', {near_names(search.method, METHODS)}"
        )
    begun = 0
    try:
        if search.method not in POPULATIONS:
            _try_points(search, protocol)
            return search.finish("budget spent")
        while search.cost.rollouts < protocol.budget and _generations(search, protocol, begun):
            begun += 1
    except KeyboardInterrupt:
        return search.finish("interrupted")
    times = f"begun {begun + 1} times" if begun else ""
    return search.finish("budget spent", times)


def _try_points(search: Search, protocol: EvolutionSettings) -> None:
    """Points of a random or of a scrambled Sobol sequence, one after the other; the start before them."""
    from scipy.stats import qmc

    k, rng = len(search.problem.names), np.random.default_rng(search.seed)
    sobol = qmc.Sobol(k, rng=rng)
    search.evaluate(search.problem.start)
    while search.cost.rollouts < protocol.budget:
        points = sobol.random(AT_ONCE) if search.method == "sobol" else rng.random((AT_ONCE, k))
        search.evaluate(points[: protocol.budget - search.cost.rollouts])
        search.tell(search.cost.rollouts / protocol.budget)


def _generations(search: Search, protocol: EvolutionSettings, begun: int) -> bool:
    """One population from its beginning; whether another may follow it."""
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.termination import NoTermination
    from pymoo.problems.static import StaticProblem

    penalised = search.method == "cmaes"
    shape = _shape(search.problem, penalised=penalised)
    left = protocol.budget - search.cost.rollouts
    first = _first(search, CMAES_SCREEN if penalised else protocol.population, begun)
    algorithm = POPULATIONS[search.method](dataclasses.replace(protocol, budget=left), first)
    algorithm.setup(shape, termination=NoTermination(), seed=_seed(search, begun), verbose=False)
    fitness, stagnation = _Fitness(penalised=penalised), _Stagnation()
    while algorithm.has_next():
        _anneal(algorithm, protocol, search.cost.rollouts / protocol.budget)
        asked = algorithm.ask()
        points = asked.get("X")
        if search.cost.rollouts + len(points) > protocol.budget:
            return False
        found = search.evaluate(points)
        objective, constraints = fitness(found)
        Evaluator().eval(StaticProblem(shape, F=objective, G=constraints), asked)
        algorithm.tell(infills=asked)
        search.tell(search.cost.rollouts / protocol.budget)
        if not penalised and stagnation(algorithm.pop.get("X"), found):
            break
    return True


def _first(search: Search, size: int, begun: int) -> Array:
    """Points (size, k) of a Latin hypercube, the problem's start among them unless it was tried before."""
    from scipy.stats import qmc

    rng = np.random.default_rng([search.seed, begun])
    points: Array = qmc.LatinHypercube(len(search.problem.names), rng=rng).random(size)
    if begun == 0:
        points[0] = search.problem.start
    return points


def _seed(search: Search, begun: int) -> int:
    """Seed of a population; never 0, which CMA-ES replaces by the time of day."""
    if begun == 0:
        return search.seed + (search.method == "cmaes")
    return int(np.random.default_rng([search.seed, begun]).integers(1, 2**31))


class _Stagnation:
    """Says when a population has converged or no longer improves."""

    def __init__(self) -> None:
        self._objective, self._violation, self._idle = np.inf, np.inf, 0

    def __call__(self, population: Array, found: Evaluation) -> bool:
        violation = found.violation
        i = int(np.lexsort((found.objective, np.maximum(violation, FEASIBLE)))[0])
        value, excess = float(found.objective[i]), float(violation[i])
        wanted = self._objective if np.isinf(self._objective) else self._objective - self._least_fall
        self._idle += 1
        if np.isfinite(excess) and better(value, excess, wanted, (1 - STAGNANT_FALL) * self._violation):
            self._objective, self._violation, self._idle = value, excess, 0
        spread = float((population.max(axis=0) - population.min(axis=0)).max())
        return self._idle >= STAGNANT or spread < SPREAD

    @property
    def _least_fall(self) -> float:
        return STAGNANT_FALL * abs(self._objective)


class _Fitness:
    """Turns values into what pymoo ranks: a diverged rollout is infeasible, never a number."""

    def __init__(self, *, penalised: bool) -> None:
        self._penalised = penalised
        self._worst, self._scale = 1.0, 0.0

    def __call__(self, found: Evaluation) -> tuple[Array, Array]:
        lost = ~np.isfinite(found.violation)
        finite = found.objective[~lost]
        self._worst = max(self._worst, float(np.abs(finite).max(initial=0.0)))
        self._scale = self._scale or float(np.abs(finite).max(initial=0.0))
        if self._penalised:
            violation = np.where(lost, DIVERGED, found.violation)
            value = np.where(violation > 0, self._worst * (2 + violation), found.objective)
            value = value / (self._scale or 1.0)
            return value[:, None], np.empty((len(value), 0))
        value = np.where(lost, self._worst * DIVERGED, found.objective)
        constraints = np.where(lost[:, None], DIVERGED, found.constraints)
        return value[:, None], np.column_stack([constraints, np.where(lost, DIVERGED, -1.0)])


def _shape(problem: OptimisationProblem, *, penalised: bool) -> Any:
    from pymoo.core.problem import Problem as PymooProblem

    k = len(problem.names)
    constraints = 0 if penalised else len(problem.constraint_names) + 1
    return PymooProblem(n_var=k, n_obj=1, n_ieq_constr=constraints, xl=np.zeros(k), xu=np.ones(k))


def _anneal(algorithm: Any, protocol: EvolutionSettings, share: float) -> None:
    """Let the GA's crossover probability fall linearly with the budget spent."""
    mating = getattr(algorithm, "mating", None)
    if mating is not None and hasattr(mating, "annealed"):
        first, last = protocol.crossover
        mating.crossover.prob.set(first + (last - first) * min(share, 1.0))


def _ga(protocol: EvolutionSettings, first: Array) -> Any:
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


def _de(protocol: EvolutionSettings, first: Array) -> Any:
    from pymoo.algorithms.soo.nonconvex.de import DE

    return DE(pop_size=protocol.population, sampling=first, variant="DE/rand/1/bin", CR=0.9, F=0.6)


def _pso(protocol: EvolutionSettings, first: Array) -> Any:
    from pymoo.algorithms.soo.nonconvex.pso import PSO

    return PSO(pop_size=protocol.population, sampling=first)


def _cmaes(protocol: EvolutionSettings, first: Array) -> Any:
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


POPULATIONS: dict[str, Callable[[EvolutionSettings, Array], Any]] = {
    "ga": _ga,
    "de": _de,
    "pso": _pso,
    "cmaes": _cmaes,
}
"""Makers of pymoo's algorithms from a protocol and their first points, by name."""
METHODS = (*POPULATIONS, "sobol", "random")
