"""Evolutionary methods through pymoo (GA, differential evolution, PSO, CMA-ES), random and Sobol search.

Each method evaluates the problem's start first, as the NLP does, so that all have the same information. A
population that has converged or stagnates is restarted with another seed until the budget is spent. CMA-ES
restarts by the BIPOP rule: it runs populations that double from one restart to the next, and smaller
populations as long as these have cost less in sum. Each of its runs ends by its tolerances.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from optim.methods.settings import EvolutionSettings
from optim.methods.tuning_method import MethodRequest, TuningMethod
from optim.problem.problem import Evaluation
from optim.search.search import FEASIBLE, Search, SearchRun, better
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.registry import TUNING_METHODS

CMAES_POPULATION = 16  # two groups of eight lanes
CMAES_SCREEN = 20  # points of which the best is its first mean
STAGNANT = 30  # generations within which the best must improve
STAGNANT_FALL = 1e-4  # by so much, relative to it
SPREAD = 1e-6  # of the unit cube: a population within it has converged
AT_ONCE = 64  # points that a random or Sobol search tries together
CMAES_TOLERANCES = {"tolfun": 1e-8, "tolx": 1e-6}  # of the first objectives, and of the unit cube
DIVERGED = 1e3  # violation that a diverged rollout stands for: behind every other infeasible point


class EvolutionaryMethod(TuningMethod):
    """A method that evaluates points and needs no derivatives: a population of pymoo's.

    Attributes:
        has_own_budget: Whether its budget is ``Effort.protocol``, not that of the baselines.
    """

    has_own_budget: ClassVar[bool] = False

    def algorithm(self, protocol: EvolutionSettings, first: Array) -> Any:
        """Algorithm of pymoo with its settings.

        Args:
            protocol: Population, budget and probabilities.
            first: First points (n, k) of the unit cube; the best of them is the first mean of CMA-ES.
        """
        raise NotImplementedError

    def run(self, search: Search, protocol: EvolutionSettings) -> int:
        """Run until the budget is spent; returns the number of restarts of the population."""
        from pymoo.core.evaluator import Evaluator
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination
        from pymoo.problems.static import StaticProblem
        from scipy.stats import qmc

        penalised = search.method == "cmaes"
        k, restarts = len(search.problem.names), 0
        count = 0 if penalised else len(search.problem.constraint_names) + 1
        shape = Problem(n_var=k, n_obj=1, n_ieq_constr=count, xl=np.zeros(k), xu=np.ones(k))
        while search.cost.rollouts < protocol.budget:
            left = protocol.budget - search.cost.rollouts
            # points (size, k) of a Latin hypercube, the problem's start among them unless it was tried before
            rng = np.random.default_rng([search.seed, restarts])
            sampler = qmc.LatinHypercube(k, rng=rng)
            first: Array = sampler.random(CMAES_SCREEN if penalised else protocol.population)
            if restarts == 0:
                first[0] = search.problem.start
            algorithm = self.algorithm(dataclasses.replace(protocol, budget=left), first)
            # a seed is never 0, which CMA-ES replaces by the time of day
            seed = search.seed + penalised
            if restarts:
                seed = int(np.random.default_rng([search.seed, restarts]).integers(1, 2**31))
            algorithm.setup(shape, termination=NoTermination(), seed=seed, verbose=False)
            fitness, stagnation = _Fitness(penalised=penalised), _Stagnation()
            while algorithm.has_next():
                _anneal(algorithm, protocol, search.cost.rollouts / protocol.budget)
                candidates = algorithm.ask()
                points = candidates.get("X")
                if search.cost.rollouts + len(points) > protocol.budget:
                    return restarts
                evaluation = search.evaluate(points)
                objective, constraints = fitness(evaluation)
                Evaluator().eval(StaticProblem(shape, F=objective, G=constraints), candidates)
                algorithm.tell(infills=candidates)
                search.tell(search.cost.rollouts / protocol.budget)
                if not penalised and stagnation(algorithm.pop.get("X"), evaluation):
                    break
            restarts += 1
        return restarts

    def searches(self, request: MethodRequest) -> Sequence[Callable[[], SearchRun]]:
        """Runs that differ in their seeds."""
        effort = request.effort
        protocol = effort.protocol if self.has_own_budget else effort.baseline

        def run(index: int) -> SearchRun:
            seed = effort.seed + index
            settings = protocol.fingerprint(self.name, seed)
            return evolve(request.begin(self.name, index, seed, settings), protocol)

        return [functools.partial(run, i) for i in range(effort.runs)]


class PointSearch(EvolutionaryMethod):
    """A method that samples points independently of previous results."""

    def points(self, sequence: Any, rng: np.random.Generator, count: int) -> Array:
        """Next points (count, k) of the unit cube.

        Args:
            sequence: A scrambled Sobol sequence of SciPy.
            rng: Random numbers.
            count: Number of points.
        """
        raise NotImplementedError

    def run(self, search: Search, protocol: EvolutionSettings) -> int:
        """Evaluate the start, then batches of points until the budget is spent; returns 0 restarts."""
        from scipy.stats import qmc

        k, rng = len(search.problem.names), np.random.default_rng(search.seed)
        sequence = qmc.Sobol(k, rng=rng)
        search.evaluate(search.problem.start)
        while search.cost.rollouts < protocol.budget:
            points = self.points(sequence, rng, AT_ONCE)
            search.evaluate(points[: protocol.budget - search.cost.rollouts])
            search.tell(search.cost.rollouts / protocol.budget)
        return 0


def evolve(search: Search, protocol: EvolutionSettings) -> SearchRun:
    """Search with the method that ``search.method`` names, until the budget is spent.

    Args:
        search: The search, whose seed determines all random numbers.
        protocol: Population, budget and probabilities.

    Returns:
        Run: Status ``budget spent`` or ``interrupted``; the message gives the number of populations if there
            was more than one.

    Raises:
        SpaceRobotError: If there is no such method.
    """
    method = TUNING_METHODS.find(search.method)
    if not isinstance(method, EvolutionaryMethod):
        raise SpaceRobotError(f"{search.method} is no evolutionary method")
    try:
        restarts = method.run(search, protocol)
    except KeyboardInterrupt:
        return search.finish("interrupted")
    times = f"begun {restarts + 1} times" if restarts else ""
    return search.finish("budget spent", times)


class _Stagnation:
    """Test of whether a population has converged or stagnates."""

    def __init__(self) -> None:
        self._objective, self._violation, self._idle = np.inf, np.inf, 0

    def __call__(self, population: Array, evaluation: Evaluation) -> bool:
        violation = evaluation.violation
        i = int(np.lexsort((evaluation.objective, np.maximum(violation, FEASIBLE)))[0])
        value, excess = float(evaluation.objective[i]), float(violation[i])
        target = self._objective
        if not np.isinf(target):
            target -= STAGNANT_FALL * abs(target)
        self._idle += 1
        if np.isfinite(excess) and better(value, excess, target, (1 - STAGNANT_FALL) * self._violation):
            self._objective, self._violation, self._idle = value, excess, 0
        spread = float((population.max(axis=0) - population.min(axis=0)).max())
        return self._idle >= STAGNANT or spread < SPREAD


class _Fitness:
    """Conversion of values for pymoo: a diverged rollout is a violation of :data:`DIVERGED` instead of NaN.

    If ``penalised``, as for CMA-ES, violations are added to the objective instead of given as constraints.
    """

    def __init__(self, *, penalised: bool) -> None:
        self._penalised = penalised
        self._worst, self._scale = 1.0, 0.0

    def __call__(self, evaluation: Evaluation) -> tuple[Array, Array]:
        lost = ~np.isfinite(evaluation.violation)
        finite = evaluation.objective[~lost]
        self._worst = max(self._worst, float(np.abs(finite).max(initial=0.0)))
        self._scale = self._scale or float(np.abs(finite).max(initial=0.0))
        if self._penalised:
            violation = np.where(lost, DIVERGED, evaluation.violation)
            value = np.where(violation > 0, self._worst * (2 + violation), evaluation.objective)
            value = value / (self._scale or 1.0)
            return value[:, None], np.empty((len(value), 0))
        value = np.where(lost, self._worst * DIVERGED, evaluation.objective)
        constraints = np.where(lost[:, None], DIVERGED, evaluation.constraints)
        return value[:, None], np.column_stack([constraints, np.where(lost, DIVERGED, -1.0)])


def _anneal(algorithm: Any, protocol: EvolutionSettings, share: float) -> None:
    """Decrease the GA's crossover probability linearly with the spent budget."""
    mating = getattr(algorithm, "mating", None)
    if mating is not None and hasattr(mating, "annealed"):
        first, last = protocol.crossover
        mating.crossover.prob.set(first + (last - first) * min(share, 1.0))
