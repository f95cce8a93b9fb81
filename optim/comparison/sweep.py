"""The paper's sensitivity analysis of the GA: probabilities 0.1 to 0.9 and population sizes."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from optim.methods.evolutionary import evolve
from optim.methods.settings import EvolutionSettings
from optim.problem.problem import OptimisationProblem
from optim.search.journal import Journal
from optim.search.search import Search, SearchRun
from optim.search.session import SearchSession
from spacerobot.arrays import Array

PROBABILITIES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
POPULATIONS = (10, 20, 50, 100, 200)


@dataclass(frozen=True)
class SweepRun:
    """Runs of the GA with one setting changed.

    Attributes
    ----------
    setting, value
        ``crossover``, ``mutation`` or ``population``, and what it was set to.
    runs
        Outcome for each seed.
    """

    setting: str
    value: float
    runs: tuple[SearchRun, ...]

    @property
    def objectives(self) -> Array:
        """Best of each run; infinite if it found nothing feasible."""
        return np.array([run.objective if run.feasible else np.inf for run in self.runs])


def sweep(
    problem: OptimisationProblem,
    *,
    protocol: EvolutionSettings | None = None,
    runs: int = 3,
    seed: int = 0,
    session: SearchSession | None = None,
) -> Iterator[SweepRun]:
    """Run the GA with each setting in turn, the others as in the protocol; every run has the same budget.

    Parameters
    ----------
    problem
        The problem.
    protocol
        Settings that do not vary; 1000 rollouts a run and the paper's values if None.
    runs
        Seeds for each setting; the same ones everywhere.
    seed
        The first.
    session
        Who does the runs, and where journals are kept; this process, and nowhere, if None.
    """
    session = session or SearchSession()
    folder, progress = session.place, session.progress
    protocol = protocol or EvolutionSettings(budget=1000)
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
