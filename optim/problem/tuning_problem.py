"""The tuning problem of a scene: points of the unit cube in, objective, constraints and derivatives out."""

from __future__ import annotations

import hashlib
import json
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from optim.problem import worker_operations
from optim.problem.derived_loop import tie
from optim.problem.formulation import Formulation, rollout_of
from optim.problem.margin_terms import build_margin_terms
from optim.problem.objectives import MARGINS, OBJECTIVE, UserObjective, build_terms, extended_loop
from optim.problem.problem import Evaluation, EvaluationCost, Linearisation, OptimisationProblem
from optim.problem.scene_recipe import NewVariables, SceneRecipe, changed_scene, tuning_of, with_variables
from optim.problem.variables import variables_of
from optim.workers import Arrays, Threads, Workers
from optim.workers.workers import LANES
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.common.arrays import Array
from spacerobot.common.files import StrPath
from spacerobot.rollout.gradient_accuracy import inaccurate
from spacerobot.scene import Scene, to_scene
from spacerobot.scene.memory import check_size


@dataclass(frozen=True)
class ProblemRecipe:
    """Settings that build a tuning problem in another process; see :func:`build_problem`.

    Attributes:
        scene: Recipe of the scene.
        chosen, variant, also_vary: See :func:`build_problem`.
        objective: The user's objective, which must be picklable for other processes.
        halvings: Number of times the step was halved.
    """

    scene: SceneRecipe
    chosen: tuple[str, ...] | None
    variant: str | None
    also_vary: tuple[str, ...]
    objective: UserObjective | None
    halvings: int = 0

    @cached_property
    def key(self) -> str:
        """Hash of the recipe; each call with a Python objective counts as another function."""
        objective_id = None if self.objective is None else uuid.uuid4().hex
        plain = [asdict(self.scene), self.chosen, self.variant, self.also_vary, objective_id, self.halvings]
        return hashlib.sha256(json.dumps(plain, sort_keys=True, default=str).encode()).hexdigest()

    def build(self) -> TuningProblem:
        """The problem, which rolls out by one thread."""
        problem = build_problem(
            self.scene.build(),
            variables=self.chosen,
            variant=self.variant,
            objective=self.objective,
            workers=Threads(1),
            also_vary=self.also_vary,
        )
        for _ in range(self.halvings):
            problem = problem.refined
        return problem


@dataclass(frozen=True, repr=False)
class TuningProblem(Formulation, OptimisationProblem):
    """A formulation that is evaluated by workers.

    Attributes:
        recipe: Recipe that builds the problem in another process.
        workers: Threads or processes that roll out. Results do not depend on their number.
    """

    recipe: ProblemRecipe
    workers: Workers = field(default_factory=Threads)

    @property
    def refined(self) -> TuningProblem:
        """Return the problem with steps of half the length; nothing is compiled again."""
        rollout = replace(self.rollout, grid=self.rollout.grid.halved)
        return replace(self, rollout=rollout, recipe=replace(self.recipe, halvings=self.recipe.halvings + 1))

    def step_warning(self, u: Array) -> str:
        """Reason why derivatives at a point u (k,) are inaccurate: half the step changes them. Else empty.

        Derivatives are those by the unit cube, of all that a descent uses.
        """
        at, finer = (problem.linearise_all(u[None])[0] for problem in (self, self.refined))

        def of(linearisation: Linearisation) -> dict[str, Array]:
            objective = linearisation.smooth_gradient if self.form == "minimax" else linearisation.gradient
            slopes = {"objective": objective, "constraints": linearisation.constraint_jacobian}
            return slopes | ({"errors": linearisation.rows_jacobian} if self.form == "minimax" else {})

        values = {"objective": np.array(at.objective), "constraints": at.constraints, "errors": at.rows}
        return inaccurate(of(at), of(finer), values, np.ones(len(u)), self.names)

    @property
    def linear_cost(self) -> EvaluationCost:
        """Cost of one gradient if the adjoint suffices, otherwise of a rollout and one slope per variable."""
        if self.form == "smooth" and not self.terms.limits:
            return EvaluationCost(gradients=1)
        return EvaluationCost(rollouts=1, slopes=len(self.names))

    @property
    def sample_cost(self) -> EvaluationCost:
        """Cost of a rollout, with its samples if the objective has components."""
        return EvaluationCost(rollouts=1) if self.form == "smooth" else EvaluationCost(samples=1)

    @property
    def prefers_exact(self) -> bool:
        """True with margins: a frequency response costs more than derivatives of its extremes."""
        return self.terms.margins is not None

    @cached_property
    def fingerprint(self) -> str:
        """Hash of everything on which the values depend."""
        kernel, grid, v = self.rollout.kernel, self.rollout.grid, self.variables
        numbers = [*self.rollout.values(None), *v.lower, *v.upper, *v.log, grid.duration_s, grid.step_s]
        limits, margins = sorted(self.terms.limits.items()), self.terms.margins
        engine = self.rollout.summary  # another compiler may round otherwise
        digest = hashlib.sha256(repr(([float(x) for x in numbers], v.names, limits, engine)).encode())
        for name in ("setup", "dynamics", "objective"):
            digest.update(kernel.functions[name].serialize().encode())
        digest.update(b"" if margins is None else margins.fingerprint.encode())
        return digest.hexdigest()

    def evaluate(self, u: Array) -> Evaluation:
        """Objective (N,) and constraints (N, m) at points u (N, k); NaN where the rollout diverged."""
        measures = self.measure(u)
        return Evaluation(np.array(measures[OBJECTIVE]), self._constraints(measures, len(u)))

    def sample(self, u: Array) -> Evaluation:
        """Evaluate, with the rows (N, n) of the objective; values only where it is smooth."""
        if self.form == "smooth":
            return super().sample(u)
        measures = self.workers.map(
            self,
            partial(worker_operations.samples, paths=self.names),
            self.variables.values(np.atleast_2d(u)),
        )
        return Evaluation(
            np.array(measures[OBJECTIVE]), self._constraints(measures, len(u)), measures["rows"]
        )

    def measure(self, u: Array, plants: Mapping[str, Array] | None = None) -> Arrays:
        """Objective and all measures at points u (N, k), each of shape (N,) or (N, n).

        Args:
            u: Points of the unit cube; beyond its faces where a linear scale allows.
            plants: Values (N,) of other parameters by dotted path.
        """
        values = self.variables.values(np.atleast_2d(u))
        others = dict(plants or {})
        rows = np.column_stack([values, *others.values()])
        return self.workers.map(self, partial(worker_operations.measures, paths=(*self.names, *others)), rows)

    def linearise_all(self, u: Array) -> list[Linearisation]:
        """Objective and constraints with their exact derivatives at points u (N, k), computed by the workers.

        Several gradients by the adjoint share lanes.
        """
        grain = LANES if self.linear_cost.gradients else 1
        fields = self.workers.map(self, worker_operations.linearisations, u, grain=grain)
        return [
            Linearisation.of_arrays({name: values[i] for name, values in fields.items()})
            for i in range(len(u))
        ]

    def _constraints(self, metrics: Mapping[str, Array], count: int) -> Array:
        limits = [metrics[n] / limit - 1 for n, limit in self.terms.limits.items()]
        margins = [] if self.terms.margins is None else [metrics[MARGINS]]
        return np.column_stack([np.empty((count, 0)), *limits, *margins])


@dataclass(frozen=True)
class DerivedProblem(OptimisationProblem):
    """A problem with the variables and constraints of a tuning problem, and an objective of its own.

    Attributes:
        nominal: The tuning problem.
    """

    nominal: TuningProblem

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return self.nominal.names

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the constraints."""
        return self.nominal.constraint_names

    @property
    def start(self) -> Array:
        """The scenario's own values in the unit cube, (k,)."""
        return self.nominal.start


def build_problem(
    scene: Scene | StrPath,
    *,
    variables: NewVariables | Sequence[str] | None = None,
    variant: str | None = None,
    objective: UserObjective | None = None,
    workers: Workers | None = None,
    also_vary: Sequence[str] = (),
) -> TuningProblem:
    """Tuning problem of a scene.

    Args:
        scene: Scene to tune, or the name or file of its scenario. Its tuning section gives objective,
            constraints and variables that the other arguments do not replace.
        variables: Names of the section's variables or of sets of them, None for all variables; or new
            variables: (dotted path, lower, upper) by name.
        variant: Variant of the tuning section; None applies none.
        objective: Function from the closed loop's signals to a scalar measure, such as
            ``lambda s: integral(ca.sumsqr(s["tip_error"]))``. Its gradients are exact. The section's weighted
            margins are added to it.
        workers: Workers that roll out, as from :func:`optim.workers.dask.open_workers`; None uses threads of
            this process. Results do not depend on them.
        also_vary: Further numbers that remain parameters even where they are zero.

    Raises:
        ScenarioError: If there is no such variable or variant, a variable's path does not exist, the closed
            loop does not depend on it, or the result of a design does not fit into memory.
    """
    scene, chosen = with_variables(to_scene(scene), variables)
    names = None if chosen is None else tuple(chosen)
    recipe = ProblemRecipe(SceneRecipe.of(scene), names, variant, tuple(also_vary), objective)
    scene = changed_scene(scene, variant)
    check_size(scene)
    tuning = tuning_of(scene)
    free = variables_of(scene, {name: tuning.variables[name] for name in chosen or tuning.variables})
    loop = cached_closed_loop(scene, vary=[*free.all_paths, *also_vary])
    for path in free.all_paths:
        loop.index(path)
    extended = extended_loop(loop, scene, tuning.objective)
    tied = tie(extended, dict(zip(free.names, free.paths, strict=True)), list(free.start))
    terms = build_terms(tied, scene, objective or tuning.objective, tuning.constraints)
    rollout = rollout_of(scene, tied, terms)
    terms = replace(terms, margins=build_margin_terms(scene, free))
    return TuningProblem(scene, loop, free, terms, rollout, recipe, workers or Threads())
