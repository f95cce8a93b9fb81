"""Falsification: search for the worst outcome over uncertain parameters, by exact gradients.

The search is tuning's NLP: concurrent descents from several starts, here of the negative quantity over the
box of the parameters. With fewer than four parameters, differences are cheaper than the adjoint and replace
it, as in tuning. The search is compared with random search at equal cost.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypedDict, Unpack

import numpy as np
from scipy.special import ndtr

from optim.campaign.sampling.parameter_space import units_of
from optim.campaign.sampling.samplers import probabilities, quantiles
from optim.json_files import JsonResult
from optim.methods.nlp import GRADIENT
from optim.methods.run_method import run_method
from optim.methods.settings import Effort, EvolutionSettings, NlpSettings
from optim.problem.problem import Evaluation, EvaluationCost, Linearisation, OptimisationProblem
from optim.reliability.limit_state import RolloutLimitState, build_limit_state
from optim.search.search import Progress
from optim.search.session import SearchSession
from spacerobot.common.arrays import Array
from spacerobot.common.errors import DivergedError
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Table
from spacerobot.scene import Scene, build_scene, to_scene

STARTS = 16
SCORE = 3.0
"""Half-width of the box of a parameter without bounds, in standard deviations."""


@dataclass(frozen=True)
class WorstCaseProblem(OptimisationProblem):
    """The negative quantity over the box of the uncertain parameters, as an optimisation problem.

    Attributes:
        state: Gives the quantity.
        lower, upper: Ends of the box (k,), in the parameters' units.
    """

    state: RolloutLimitState
    lower: Array
    upper: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the uncertain parameters."""
        return self.state.names

    @property
    def start(self) -> Array:
        """The medians in the unit cube (k,)."""
        parameters = self.state.campaign.parameters.values()
        median = np.array([quantiles(one, np.array([0.5]))[0] for one in parameters])
        return (median - self.lower) / (self.upper - self.lower)

    @property
    def linear_cost(self) -> EvaluationCost:
        """Cost of one gradient."""
        return EvaluationCost(gradients=1)

    @property
    def fingerprint(self) -> str:
        """Hash of everything on which the values depend."""
        kernel = self.state.rollout.kernel
        digest = hashlib.sha256(repr((self.lower, self.upper, self.state.rollout.grid)).encode())
        for name in ("setup", "dynamics", "objective"):
            digest.update(kernel.functions[name].serialize().encode())
        digest.update(np.ascontiguousarray(self.state.rollout.values()).tobytes())
        return digest.hexdigest()

    def draws(self, u: Array) -> Array:
        """Values of the parameters at points of the unit cube, both (..., k)."""
        return self.lower + (self.upper - self.lower) * u

    def evaluate(self, u: Array) -> Evaluation:
        """Values at points u (N, k)."""
        return Evaluation(-self.state.quantities(self.draws(np.atleast_2d(u))), np.empty((len(u), 0)))

    def linearise_all(self, u: Array) -> list[Linearisation]:
        """Values and exact derivatives at points u (N, k), in lanes."""
        values, slopes = self.state.quantity_gradients(self.draws(u))
        return [
            Linearisation.of_smooth(-value, -slope)
            for value, slope in zip(values, slopes * (self.upper - self.lower), strict=True)
        ]


@dataclass(frozen=True)
class WorstCase:
    """A local maximum of the quantity, or the best of a search.

    Attributes:
        value: Value of the quantity.
        parameters: Values of the uncertain parameters by name.
        percentiles: Percentile of each value in its distribution, by name: 0 at the lower bound, 100 at the
            upper.
    """

    value: float
    parameters: Mapping[str, float]
    percentiles: Mapping[str, float]


@dataclass(frozen=True)
class Falsification(JsonResult):
    """Worst outcome of a falsification search.

    Attributes:
        quantity, unit, limit: Name, unit and limit of the quantity.
        nominal: Value of the quantity at the medians of the parameters.
        worst, random: Worst cases by gradients, and by random search at equal cost.
        changes: Changes of the scenario that give the worst outcome, by dotted path.
        cost: Cost of the search by gradients, and the budget of random search in plain rollouts.
        diverged, diverged_at: Simulations of both searches that diverged, and the parameters of the first;
            None without any.
        units: Unit of each parameter, or the way in which it changes the scenario's numbers.
    """

    key: ClassVar[str] = "falsification"

    quantity: str
    unit: str
    limit: float
    nominal: float
    worst: WorstCase
    random: WorstCase
    changes: Mapping[str, float]
    cost: str
    diverged: int = 0
    diverged_at: Mapping[str, float] | None = None
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_falsified(self) -> bool:
        """Whether the limit can be exceeded, or a simulation diverges."""
        return self.worst.value > self.limit or self.diverged > 0

    def verdict(self) -> list[str]:
        """Whether the limit is exceeded, by the worst value that was found."""
        outcome = "is exceeded" if self.is_falsified else "was not exceeded in this search"
        return [
            f"The limit of {self.quantity}, {self.limit:g} {self.unit}, {outcome}. The worst value is "
            f"{self.worst.value:.4g} {self.unit}; at the medians of the parameters it is {self.nominal:.4g} "
            f"{self.unit}."
        ]

    def rows(self) -> list[tuple[str, str]]:
        """Outcome and parameters, as text."""
        verdict = "exceeded" if self.is_falsified else "not exceeded in this search"
        random = f"{self.random.value:.6g} {self.unit}"
        if np.isnan(self.random.value):
            random = "all simulations diverged"
        stated = {name: self.units.get(name, "1") for name in self.worst.parameters}
        units = {name: "" if unit == "1" else f" {unit}" for name, unit in stated.items()}
        lost = ", ".join(f"{name} {value:.6g}" for name, value in (self.diverged_at or {}).items())
        return [
            (f"limit of {self.quantity}", f"{self.limit:g} {self.unit}: {verdict}"),
            ("at the medians", f"{self.nominal:.6g} {self.unit}"),
            ("worst, by gradients", f"{self.worst.value:.6g} {self.unit}"),
            ("worst, by random search at equal cost", random),
            ("cost", self.cost),
            *(
                (name, f"{value:.6g}{units[name]} (percentile {self.worst.percentiles[name]:.3g})")
                for name, value in self.worst.parameters.items()
            ),
            *(
                [("diverged", f"{self.diverged} simulations, the first at {lost}")]
                if self.diverged_at is not None
                else []
            ),
        ]

    @classmethod
    def of_fields(cls, fields: dict[str, Any]) -> Falsification:
        """The result with the fields of a file."""
        cases = {key: dict(fields[key]) for key in ("worst", "random")}
        for case in cases.values():
            case["value"] = np.nan if case["value"] is None else case["value"]  # as JSON has it
        return cls(**fields | {key: WorstCase(**case) for key, case in cases.items()})

    def scene(self, scene: Scene) -> Scene:
        """The scene with the worst parameters."""
        return build_scene(scene.scenario, dict(self.changes), source=scene.source)

    def __repr__(self) -> str:
        """The worst value and the limit, in one line."""
        return f"<Falsification {self.quantity}: at worst {self.worst.value:.4g}, limit {self.limit:g}>"

    def content(self) -> list[Table]:
        """Worst outcome and its parameters."""
        return [Table.of_pairs("falsification", self.rows())]


class FalsificationOptions(TypedDict, total=False):
    """Keyword arguments of :func:`falsify`.

    Attributes:
        progress: Callback with the progress of each search.
        threads: Number of threads; one for each usable core if None. Results do not depend on it.
    """

    progress: Progress | None
    threads: int | None


def falsify(
    scene: Scene | StrPath,
    quantity: str | None = None,
    limit: float | None = None,
    *,
    effort: Effort | Mapping[str, int | None] | None = None,
    folder: StrPath | None = None,
    **options: Unpack[FalsificationOptions],
) -> Falsification:
    """Search the uncertain parameters of a scene's campaign for the worst value of a quantity.

    A parameter varies between its bounds, without bounds within three standard deviations. A failure
    (``joint_failure`` and the like) takes part if its time is one of the parameters.

    Args:
        scene: A scene whose scenario has a ``campaign`` section, or the scenario's name or file.
        quantity, limit: Quantity and its limit, in its unit; those of ``campaign.limits`` if None.
        effort: Number of starts, seed, and in ``nlp`` the budget; or ``starts``, ``seed`` and ``budget`` by
            name. The default is 16 starts without a budget.
        folder: Folder of the journals, from which an interrupted call resumes; no journals if None.
        **options: See :class:`FalsificationOptions`.

    Raises:
        DivergedError: If every simulation diverged.
        KeyboardInterrupt: If the search was interrupted; called again with the same folder, it continues.
        ScenarioError: If the section is missing or does not fit; see :func:`.build_limit_state`.
    """
    scene = to_scene(scene)
    state = build_limit_state(scene, quantity, limit, threads=options.get("threads"))
    parameters = state.campaign.parameters.values()
    ends = [
        [one.lower, one.upper] if one.lower is not None else quantiles(one, ndtr(np.array([-SCORE, SCORE])))
        for one in parameters
    ]
    lower, upper = np.array(ends, dtype=float).T
    problem = WorstCaseProblem(state, lower, upper)
    session = SearchSession(folder, progress=options.get("progress"))
    if not isinstance(effort, Effort):
        stated = {name: value for name, value in (effort or {}).items() if value is not None}
        nlp = NlpSettings(budget=stated.get("budget"))
        effort = Effort(nlp=nlp, starts=stated.get("starts", STARTS), seed=stated.get("seed", 0))
    outcome = run_method(problem, "nlp", effort, session=session)
    if outcome.interrupted:
        raise KeyboardInterrupt
    best = outcome.best
    spent = int(np.ceil(best.cost.equivalent(GRADIENT)))
    protocol = EvolutionSettings(budget=spent)
    blind = Effort(protocol, protocol, runs=1, seed=effort.seed)
    outcome = run_method(problem, "random", blind, session=session)
    if outcome.interrupted:
        raise KeyboardInterrupt
    other = outcome.best
    if np.isnan(best.objective):
        raise DivergedError(
            f"all {best.diverged} simulations diverged, so no worst case was found; take a shorter "
            "`campaign.step`, or narrower parameters",
            source=scene.source,
            where="campaign.parameters",
        )
    lost = other.diverged_at if best.diverged_at is None else best.diverged_at
    cases = list[WorstCase]()
    for run in (best, other):
        draws = problem.draws(run.u)
        places = [100 * float(probabilities(one, x)) for one, x in zip(parameters, draws, strict=True)]
        named = dict(zip(problem.names, map(float, draws), strict=True))
        cases.append(WorstCase(-float(run.objective), named, dict(zip(problem.names, places, strict=True))))
    worst, random = cases
    values = state.space.values(np.array(list(worst.parameters.values())))[0]
    return Falsification(
        state.quantity.name,
        state.unit,
        state.limit,
        float(-problem.evaluate(problem.start[None]).objective[0]),
        worst,
        random,
        {path: float(value) for path, value in zip(state.space.paths, values, strict=True)},
        f"{best.cost}; {spent} rollouts of random search",
        best.diverged + other.diverged,
        None if lost is None else dict(zip(problem.names, problem.draws(lost).tolist(), strict=True)),
        units_of(state.scene, state.campaign, state.space),
    )
