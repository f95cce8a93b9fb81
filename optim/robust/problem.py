"""Robust tuning: a statistic of the objective over common samples, and a test on fresh ones.

The samples are the same for every design (common random numbers), so that the objective is as smooth in the
design as one rollout is, and its gradients are exact.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np
from scipy import stats

from optim.campaign.analysis.statistics import percentile
from optim.campaign.sampling.parameter_space import (
    ParameterSpace,
    campaign_of,
    check_range,
    gain_set,
    resolve_space,
)
from optim.campaign.sampling.samplers import draw
from optim.json_files import write_design
from optim.methods.run_method import MethodOutcome, refuse_periods, run_method, stored_number
from optim.methods.settings import Effort, stated_effort
from optim.methods.tuning_method import check_robust_method
from optim.problem import worker_operations
from optim.problem.objectives import OBJECTIVE
from optim.problem.problem import Evaluation, EvaluationCost, Form, Linearisation
from optim.problem.scene_recipe import changed_scene, tuning_of
from optim.problem.tuning_problem import DerivedProblem, build_problem
from optim.search.search import Progress
from optim.search.session import SearchSession
from optim.workers import Workers
from spacerobot.common.arrays import Array
from spacerobot.common.files import StrPath, readable
from spacerobot.common.tables import Content, Table
from spacerobot.common.tabular import Tabular
from spacerobot.result.store import SCENARIO
from spacerobot.scene import Scene, build_scene, load_scene, to_scene

FILE = "robust.json"
"""File of a robust tuning's folder."""
Kind = Literal["mean", "percentile", "worst"]
PERCENT = 95.0
"""Percentile that is minimised unless another is given."""
SAMPLES = 64
"""Number of common samples."""
FRESH = 512
"""Number of fresh samples by which designs are verified."""
AT_ONCE = 8192
"""Maximum number of rollouts of a batch."""


@dataclass(frozen=True)
class RobustProblem(DerivedProblem):
    """A tuning problem over samples; a rollout of each of them counts as one.

    Attributes:
        nominal: Nominal problem without uncertainty; its rollout has the uncertain numbers as parameters.
        space, draws: Map from draws to the scenario's numbers, and the common draws (S, k).
        kind, percent: Statistic of the samples' objectives: mean, percentile, or the largest. Constraints
            hold at every sample.
    """

    space: ParameterSpace
    draws: Array
    kind: Kind
    percent: float = PERCENT

    @property
    def form(self) -> Form:
        """``minimax`` over the samples for the worst case, else smooth."""
        return "minimax" if self.kind == "worst" else "smooth"

    @property
    def linear_cost(self) -> EvaluationCost:
        """Cost of one gradient, and with constraints of one slope per variable; all samples count as one."""
        return EvaluationCost(gradients=1, slopes=len(self.names) if self.constraint_names else 0)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of everything on which the values depend."""
        text = f"{self.nominal.fingerprint} {self.kind} {self.percent!r} {self.space.paths}"
        digest = hashlib.sha256(text.encode())
        digest.update(np.ascontiguousarray(self.space.values(self.draws)).tobytes())
        return digest.hexdigest()

    def evaluate(self, u: Array) -> Evaluation:
        """Objective (N,) and constraints (N, m) at points u (N, k); NaN where a sample diverges."""
        u = np.atleast_2d(u)
        parts = max(1, len(self.draws) * len(u) // AT_ONCE)
        objectives, constraints, limits = list[Array](), list[Array](), self.nominal.terms.limits
        for part in np.array_split(u, min(parts, len(u))):
            measures = self._measure(part, self.draws)
            objectives.append(np.array([self.reduce(row) for row in measures[OBJECTIVE]]))
            worst = [measures[name].max(axis=1) / limit - 1 for name, limit in limits.items()]
            constraints.append(np.column_stack([np.empty((len(part), 0)), *worst]))
        return Evaluation(np.concatenate(objectives), np.concatenate(constraints))

    def sample(self, u: Array) -> Evaluation:
        """Values at points u (N, k); the rows of the worst case are the objectives of all samples.

        Constraints are those of each sample, as in :meth:`linearise`.
        """
        u, limits = np.atleast_2d(u), self.nominal.terms.limits
        measures = self._measure(u, self.draws)
        each = measures[OBJECTIVE]
        rows = each if self.kind == "worst" else np.empty((len(u), 0))
        excess = [np.empty((len(u), len(self.draws), 0)), *(measures[n] / limits[n] - 1 for n in limits)]
        constraints = np.concatenate(excess, axis=2).reshape(len(u), -1)
        return Evaluation(np.array([self.reduce(row) for row in each]), constraints, rows)

    def objectives(self, u: Array, draws: Array | None = None) -> Array:
        """Objective of each sample (S,) at one point u (k,); NaN where the rollout diverged."""
        return np.array(self._measure(np.atleast_2d(u), self.draws if draws is None else draws)[OBJECTIVE][0])

    def reduce(self, objectives: Array) -> float:
        """The objective that is made small, of objectives (S,); NaN if a diverged sample decides it."""
        values = np.sort(np.where(np.isnan(objectives), np.inf, objectives))
        weights = self._weights(values)
        objective = float(weights[weights > 0] @ values[weights > 0])
        return objective if np.isfinite(objective) else float("nan")

    def linearise(self, u: Array) -> Linearisation:
        """Values and exact derivatives at one point u (k,).

        The gradient of the objective is the adjoint of every sample, weighted. Each of the S samples has its
        own m constraints, because the maximum over the samples, which :meth:`evaluate` returns, has kinks.
        """
        # every sample at this point, by the workers
        values, workers = self.space.values(self.draws), self.nominal.workers
        rows = np.column_stack([np.tile(self.nominal.variables.values(u), (len(values), 1)), values])
        paths, slope = (*self.names, *self.space.paths), self.nominal.variables.slope(u)
        batch = workers.map(self.nominal, partial(worker_operations.gradients, paths=paths), rows)
        each, slopes = batch[OBJECTIVE], batch["gradient"] * slope
        order = np.argsort(np.where(np.isnan(each), np.inf, each), kind="stable")
        weights = self._weights(each[order])
        used = order[weights > 0]
        objective, gradient = self.reduce(each), np.array(weights[weights > 0] @ slopes[used])
        plain, k = Linearisation.of_smooth(objective, gradient), len(u)
        if self.kind == "worst":
            plain = replace(
                plain, rows=np.array(each), rows_jacobian=slopes, smooth=0.0, smooth_gradient=np.zeros(k)
            )
        if not self.constraint_names:
            return plain
        limited = workers.map(self.nominal, partial(worker_operations.limited, paths=paths), rows)
        return replace(
            plain,
            constraints=limited["constraints"].ravel(),
            constraint_jacobian=limited["jacobian"].reshape(-1, k) * slope,
        )

    def linearise_all(self, u: Array) -> list[Linearisation]:
        """Linearise one point after the other: the samples of one fill the lanes."""
        return [self.linearise(point) for point in u]

    def _weights(self, ordered: Array) -> Array:
        """Weight of each sample (S,), in the order of their objectives."""
        count = len(ordered)
        if self.kind == "mean":
            return np.full(count, 1.0 / count)
        weights, at = np.zeros(count), (count - 1) * (1.0 if self.kind == "worst" else self.percent / 100)
        below = int(np.floor(at))
        weights[below] = 1 - (at - below)
        if at > below:
            weights[below + 1] = at - below
        return weights

    def _measure(self, u: Array, draws: Array) -> dict[str, Array]:
        """Measures of points u (N, k) over draws (S, k'), each (N, S) or (N, S, n)."""
        values, n = self.space.values(draws), len(u)
        plants = dict(zip(self.space.paths, np.tile(values, (n, 1)).T, strict=True))
        measures = self.nominal.measure(np.repeat(u, len(values), axis=0), plants)
        return {name: np.reshape(v, (n, len(values), *v.shape[1:])) for name, v in measures.items()}


@dataclass(frozen=True)
class Statistic:
    """Statistic of the samples' objectives that is minimised.

    Attributes:
        kind, percent: The mean, a percentile, or the largest.
        samples: Number of common samples, drawn by the campaign's distributions and seed.
    """

    kind: Kind = "worst"
    percent: float = PERCENT
    samples: int = SAMPLES


def build_robust(
    scene: Scene | StrPath,
    statistic: Statistic | None = None,
    *,
    variables: Sequence[str] | None = None,
    variant: str | None = None,
    workers: Workers | None = None,
) -> RobustProblem:
    """Robust tuning problem of a scene with a ``tuning`` and a ``campaign`` section.

    Args:
        scene: The scene, or the name or file of its scenario.
        statistic: Statistic of the samples' objectives to minimise; the largest if None.
        variables, variant, workers: See :func:`optim.problem.tuning_problem.build_problem`.

    Raises:
        ScenarioError: If a section is missing or does not fit, or an uncertain number is a variable as well.
    """
    scene = to_scene(scene)
    if tuning_of(scene).margins:
        raise scene.error("robust tuning knows no margins; `spacerobot tune` does", "tuning.margins")
    statistic = statistic or Statistic()
    changed = gain_set(changed_scene(scene, variant), {})
    space = resolve_space(changed, campaign_of(changed))
    problem = build_problem(
        gain_set(scene, {}), variables=variables, variant=variant, workers=workers, also_vary=space.paths
    )
    both = sorted(set(space.paths) & set(problem.variables.all_paths))
    if both:
        raise scene.error(f"{both[0]} is tuned and uncertain at once", "campaign")
    robust_problem = RobustProblem(
        problem, space, _draws(changed, statistic.samples, 0), statistic.kind, statistic.percent
    )
    check_range(changed, space, robust_problem.draws)
    return robust_problem


@dataclass(frozen=True)
class RobustTuningResult(Tabular):
    """Result of robust tuning.

    Attributes:
        gains: Best values by variable.
        objective: Objective at these values, over the common samples.
        changes: Changes of the scenario for the design, by dotted path: a set of gains for a campaign.
        outcome: Every run.
        common, fresh: Objective of each common and of each fresh sample, by design: ``start``, ``nominal``
            (tuned without uncertainty), ``robust``; the same samples for all, each (S,), NaN where one
            diverged.
        scene: The scene with these gains.
        statistic: Statistic of the samples' objectives that was minimised.
    """

    gains: Mapping[str, float]
    objective: float
    changes: Mapping[str, float]
    outcome: MethodOutcome
    common: Mapping[str, Array]
    fresh: Mapping[str, Array]
    scene: Scene
    statistic: Statistic

    def save(self, folder: StrPath) -> None:
        """Write ``robust.json``, and ``scenario.yaml`` with the gains unless the folder has a result of it.

        The folder is then a set of gains for a campaign.

        Raises:
            ResultError: If the folder holds something else or cannot be written.
        """
        data = {
            "measure": self.statistic.kind,
            "percent": self.statistic.percent if self.statistic.kind == "percentile" else None,
            "samples": self.statistic.samples,
            "objective": self.objective,
            "gains": dict(self.gains),
            "changes": dict(self.changes),
            "common": describe(self.common),
            "fresh": describe(self.fresh),
            "objectives": {"common": dict(self.common), "fresh": dict(self.fresh)},
            **self.outcome.to_data(),
        }
        write_design(folder, FILE, data, self.scene)

    @classmethod
    def load(cls, folder: StrPath) -> RobustTuningResult:
        """Read what :meth:`save` wrote; the history of the runs is not kept.

        Raises:
            ResultError: If it cannot be read.
        """
        folder = Path(folder)
        with readable("robust tuning", folder / FILE):
            data = json.loads((folder / FILE).read_text(encoding="utf-8"))
            common, fresh = (
                {name: np.array(values, dtype=float) for name, values in data["objectives"][key].items()}
                for key in ("common", "fresh")
            )
            statistic = Statistic(data["measure"], data["percent"] or PERCENT, data["samples"])
            numbers = data["gains"], stored_number(data["objective"]), data["changes"]
            outcome = MethodOutcome.of_data(data)
        scene = load_scene(folder / SCENARIO, expand_xacro=False)
        return cls(*numbers, outcome, common, fresh, scene, statistic)

    def content(self) -> list[Content]:
        """Gains, how each run ended, and the objective of the samples by design."""
        gains = [(name, f"{value:.6g}") for name, value in self.gains.items()]
        title = f"{self.outcome.method}, {self.statistic.kind}: {self.objective:.6g}"
        content: list[Content] = [Table.of_pairs(title, gains), *self.outcome.sentences()]
        for words, designs in (("samples of the tuning", self.common), ("fresh samples", self.fresh)):
            described = describe(designs)
            start = next(iter(described.values()))["mean"]
            rows = []
            for name, entry in described.items():
                half = {key: (entry[f"{key}_high"] - entry[f"{key}_low"]) / 2 for key in ("mean", "change")}
                numbers = [f"{entry[key]:.3g}" for key in ("median", "95 %", "largest", "diverged")]
                change = f"{100 * entry['change'] / start:+.1f}{PLUS_MINUS}{100 * half['change'] / start:.1f}"
                interval = f"{100 * half['mean'] / entry['mean']:.1f}"
                rows.append(
                    [name, f"{entry['mean']:.3g}", interval, *numbers, change if entry["change"] else ""]
                )
            count = len(next(iter(designs.values())))
            content.append(Table(f"objective on {count} {words}", COLUMNS, rows))
        content.append(
            "Gains: the scenario's (start), tuned without uncertainty (nominal), tuned for it (robust). "
            f"{PLUS_MINUS}: 95 % interval; change: of the mean, from the start's, on the same samples."
        )
        return content

    def __repr__(self) -> str:
        """Statistic, objective and gains, in one line."""
        gains = ", ".join(f"{name} {value:.4g}" for name, value in self.gains.items())
        name = self.scene.scenario.name
        return f"<RobustTuningResult {name}: {self.statistic.kind} {self.objective:.6g}; {gains}>"


PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
COLUMNS = ("gains", "mean", f"{PLUS_MINUS} [%]", "median", "95 %", "largest", "diverged", "change [%]")
"""Headings of designs' statistics."""


def describe(designs: Mapping[str, Array]) -> dict[str, dict[str, float]]:
    """Statistics of samples' objectives, by design.

    ``median``, ``95 %`` and ``largest`` count a diverged sample as infinite. ``mean`` and ``change`` are
    means over the samples that did not diverge; ``change`` is that of the difference to the first design on
    the same samples. The keys with ``_low`` and ``_high`` are their 95 % intervals by Student's t.
    ``diverged`` is the number of diverged samples.

    Args:
        designs: Objective of each sample by design, each (S,), NaN where one diverged.
    """
    statistics, first = {}, next(iter(designs.values()))
    for name, each in designs.items():
        values = np.sort(np.where(np.isnan(each), np.inf, each))
        median, most = (percentile(values, q, 0.95).value for q in (50, 95))
        entry = _mean(each, "mean") | {"median": median, "95 %": most, "largest": float(values[-1])}
        statistics[name] = entry | {"diverged": float(np.isnan(each).sum())} | _mean(each - first, "change")
    return statistics


def _mean(values: Array, name: str) -> dict[str, float]:
    """Mean of the values that are numbers, and its 95 % interval."""
    finite = values[np.isfinite(values)]
    mean = float(finite.mean()) if len(finite) else float("nan")
    away = float("nan")
    if len(finite) > 1:
        away = float(stats.t.ppf(0.975, len(finite) - 1) * finite.std(ddof=1) / np.sqrt(len(finite)))
    return {name: mean, f"{name}_low": mean - away, f"{name}_high": mean + away}


def tune_robust(
    problem: RobustProblem | Scene | StrPath,
    method: str = "nlp",
    *,
    effort: Effort | Mapping[str, int | None] | None = None,
    fresh: int = FRESH,
    folder: StrPath | None = None,
    progress: Progress | None = None,
) -> RobustTuningResult:
    """Tune robustly and nominally by the same method, and evaluate both on fresh samples.

    Args:
        problem: Problem of :func:`build_robust`; or a scene, or the name or file of its scenario, for the
            worst case.
        method: ``ga``, ``de``, ``pso``, ``cmaes`` or ``nlp``.
        effort: Budget of the method; or ``budget``, ``runs``, ``starts``, ``seed``, ... by name, which
            replace those of the tuning section. None takes those of the section.
        fresh: Number of fresh samples.
        folder: Folder of the journals, from which an interrupted call resumes.
        progress: Callback for progress.

    Raises:
        SpaceRobotError: If there is no such method, or it cannot solve this problem, as periods by gradients.
    """
    check_robust_method(method)
    if not isinstance(problem, RobustProblem):
        problem = build_robust(to_scene(problem))
    refuse_periods(problem.nominal, method)
    scene = problem.nominal.scene
    effort = stated_effort(effort, tuning_of(scene))
    places = {name: None if folder is None else Path(folder) / name for name in ("robust", "nominal")}
    sessions = {
        name: SearchSession(place, problem.nominal.workers, progress) for name, place in places.items()
    }
    outcome = run_method(problem, method, effort, session=sessions["robust"])
    other = run_method(problem.nominal, method, effort, session=sessions["nominal"])
    designs = {"start": problem.start, "nominal": other.best.u, "robust": outcome.best.u}
    draws = _draws(scene, fresh, 1)
    values = problem.nominal.variables.values(outcome.best.u)
    return RobustTuningResult(
        problem.nominal.variables.as_mapping(values),
        outcome.best.objective,
        problem.nominal.variables.as_changes(values),
        outcome,
        {name: problem.objectives(u) for name, u in designs.items()},
        {name: problem.objectives(u, draws) for name, u in designs.items()},
        build_scene(scene.scenario, problem.nominal.variables.as_changes(values), source=scene.source),
        Statistic(problem.kind, problem.percent, len(problem.draws)),
    )


def _draws(scene: Scene, samples: int, offset: int) -> Array:
    """Draws (samples, k) of a scene's campaign; the offset of its seed makes them independent of others."""
    campaign = campaign_of(scene)
    design = campaign.design if campaign.sampler.has_any_size else "sobol"
    changes = {"samples": samples, "seed": campaign.seed + offset, "design": design}
    return draw(campaign.model_copy(update=changes))
