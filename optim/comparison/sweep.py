"""The paper's sensitivity analysis of the GA: probabilities 0.1 to 0.9 and population sizes."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.comparison.statistics import statistics
from optim.json_files import write_json
from optim.methods.evolutionary import evolve
from optim.methods.settings import EvolutionSettings
from optim.problem.problem import OptimisationProblem
from optim.problem.scene_recipe import tuning_of
from optim.problem.tuning_problem import TuningProblem, build_problem
from optim.search.journal import Journal
from optim.search.search import Progress, Search, SearchRun
from optim.search.session import SearchSession
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.common.files import StrPath, readable
from spacerobot.common.tables import Content, Table
from spacerobot.common.tabular import Tabular
from spacerobot.scene import Scene, to_scene

BUDGET = 1000
"""Rollouts of a run."""
FILE = "sweep.json"
"""File of a sweep's folder."""
PROBABILITIES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
POPULATIONS = (10, 20, 50, 100, 200)


@dataclass(frozen=True)
class SweepRun:
    """Runs of the GA with one setting changed.

    Attributes:
        setting, value: ``crossover``, ``mutation`` or ``population``, and its value.
        runs: Outcome for each seed.
    """

    setting: str
    value: float
    runs: tuple[SearchRun, ...]

    @property
    def objectives(self) -> Array:
        """Best objective of each run; infinite for a run without a feasible point."""
        return np.array([run.objective if run.feasible else np.inf for run in self.runs])


@dataclass(frozen=True)
class SweepResult(Tabular):
    """Sensitivity of the GA to its settings.

    Attributes:
        settings: Entries of ``sweep.json``: ``setting``, its ``value``, and ``best``, ``median``, ``lower``
            and ``upper`` quartile and ``worst`` of the objectives of its runs, infinite where none was
            feasible.
    """

    settings: tuple[Mapping[str, Any], ...]

    def save(self, folder: StrPath) -> None:
        """Write ``sweep.json``.

        Raises:
            ResultError: If the folder cannot be written.
        """
        write_json(Path(folder) / FILE, self.settings)

    @classmethod
    def load(cls, folder: StrPath) -> SweepResult:
        """Read what :meth:`save` wrote.

        Raises:
            ResultError: If it cannot be read.
        """
        file = Path(folder) / FILE
        with readable("sweep", file):
            rows = json.loads(file.read_text(encoding="utf-8"))
            settings = tuple(
                {key: np.inf if value is None else value for key, value in row.items()} for row in rows
            )
            cls(settings).content()
        return cls(settings)

    def content(self) -> list[Content]:
        """Best, median and worst objective by setting."""
        keys = ("best", "median", "worst")
        rows = [
            [one["setting"], f"{one['value']:g}", *(f"{one[key]:.6g}" for key in keys)]
            for one in self.settings
        ]
        title = "GA with one setting changed at a time, the others as in the paper"
        return [Table(title, ("setting", "value", *keys), rows)]

    def __repr__(self) -> str:
        """Number of settings and the best of them, in one line."""
        best = min(self.settings, key=lambda one: float(one["median"]))
        return (
            f"<SweepResult of {len(self.settings)} settings: least median {best['median']:.4g} with "
            f"{best['setting']} {best['value']:g}>"
        )


def sweep(
    problem: Scene | StrPath | TuningProblem,
    *,
    budget: int = BUDGET,
    runs: int = 3,
    seed: int = 0,
    folder: StrPath | None = None,
    progress: Progress | None = None,
) -> SweepResult:
    """Sensitivity of the GA to its settings: crossover and mutation probability, population size.

    Args:
        problem: Problem of :func:`optim.build_problem`; or a scene, or the name or file of its scenario.
        budget: Maximum number of rollouts of a run. Settings that do not vary are the population of the
            tuning section and the paper's probabilities.
        runs: Number of runs of each setting.
        seed: Seed of the first run of each setting.
        folder: Folder of the journals, from which an interrupted sweep continues; none if None.
        progress: Called with the progress of each run.

    Raises:
        ScenarioError: If the problem does not fit the scene, or the budget is below the population.
    """
    stated = problem if isinstance(problem, TuningProblem) else build_problem(to_scene(problem))
    population = tuning_of(stated.scene).population
    if budget < population:  # no run would end its first generation
        raise ScenarioError(
            f"found {budget}, allowed: the population, {population}, and more", where="budget"
        )
    protocol = EvolutionSettings(population, budget)
    session = SearchSession(folder, stated.workers, progress)
    trials = run_sweep(stated, protocol=protocol, runs=runs, seed=seed, session=session)
    return SweepResult(
        tuple(
            {"setting": trial.setting, "value": trial.value, **statistics(trial.objectives)}
            for trial in trials
        )
    )


def run_sweep(
    problem: OptimisationProblem,
    *,
    protocol: EvolutionSettings | None = None,
    runs: int = 3,
    seed: int = 0,
    session: SearchSession | None = None,
) -> Iterator[SweepRun]:
    """Run the GA with each setting in turn, the others as in the protocol; every run has the same budget.

    Args:
        problem: The problem.
        protocol: Settings that do not vary; 1000 rollouts per run and the paper's values if None.
        runs: Number of runs of each setting.
        seed: Seed of the first run of each setting; later runs have the following seeds.
        session: Workers, journals and callbacks; None uses threads of this process and no journals.
    """
    session = session or SearchSession()
    folder, progress = session.place, session.progress
    protocol = protocol or EvolutionSettings(budget=BUDGET)
    settings = [("crossover", p, dataclasses.replace(protocol, crossover=(p, p))) for p in PROBABILITIES]
    for p in (0.01, protocol.mutation, *PROBABILITIES):
        settings.append(("mutation", p, dataclasses.replace(protocol, mutation=p)))
    for n in POPULATIONS:
        if n <= protocol.budget:
            settings.append(("population", n, dataclasses.replace(protocol, population=n)))
    for setting, value, changed in settings:

        def run(
            i: int, setting: str = setting, value: float = value, changed: EvolutionSettings = changed
        ) -> SearchRun:
            settings = changed.fingerprint("ga", seed + i)
            key = hashlib.sha256(f"{problem.fingerprint} sweep {settings}".encode()).hexdigest()
            path = folder / f"{setting}-{value:g}-{i}.journal" if folder is not None else None
            return evolve(Search(problem, "ga", i, seed + i, Journal(path, key), progress), changed)

        outcomes = session.workers.together([partial(run, i) for i in range(runs)])
        if any(ended.status == "interrupted" for ended in outcomes):
            raise KeyboardInterrupt
        yield SweepRun(setting, value, tuple(outcomes))
