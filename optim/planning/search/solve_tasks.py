"""Solve tasks that build on each other, run here or by Dask's workers, and stored as they end.

Which attempt begins with which is laid down before anything is done. So what is found depends neither on how
many work, nor on who is ready first, nor on how often it was interrupted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from optim.planning.search.plan_solver import PlanSolver, SolveRequest, SolveResult
from optim.planning.search.result_store import ResultStore
from optim.planning.search.solve_request import solve_request
from optim.workers.cluster import connect, distributed_module, faults_of, submit, threads_of

ResultsByTask = dict[str, SolveResult]


@dataclass(frozen=True)
class SolveTask:
    """One solve among others.

    Attributes
    ----------
    request
        What is asked for, from what was found before.
    after
        Names of the tasks that it builds on; they stand before it.
    """

    request: Callable[[Mapping[str, SolveResult]], SolveRequest]
    after: tuple[str, ...] = ()


def run_tasks(
    solver: PlanSolver, tasks: Mapping[str, SolveTask], kept: ResultStore, dask: str | None = None
) -> ResultsByTask:
    """Run tasks, except those whose results are stored already.

    Parameters
    ----------
    solver
        The problem.
    tasks
        By name, each after those that it builds on.
    kept
        Where attempts are kept as soon as they are there.
    dask
        Address of a cluster as for :func:`optim.workers.cluster.connect`; this process if None.

    Raises
    ------
    SpaceRobotError
        If the cluster cannot be reached, or loses an attempt on one worker after the other.
    """
    work = _TaskQueue(dict(tasks), {}, kept)
    if dask is None:
        for name, request in work.ready():
            work.add(name, request, solve_request(solver, request))
    elif requests := list(work.ready()):
        with connect(dask) as client:
            _spread(client, solver, work, requests)
    return work.found


@dataclass(frozen=True)
class _TaskQueue:
    """Tasks that are left, what was found, and where that is kept."""

    left: dict[str, SolveTask]
    found: ResultsByTask
    kept: ResultStore

    def ready(self) -> Iterator[tuple[str, SolveRequest]]:
        """Tasks whose turn has come, with what is asked; what is kept already is taken from there."""
        for name, task in list(self.left.items()):
            if not self.found.keys() >= set(task.after):
                continue
            del self.left[name]
            request = task.request(self.found)
            known = self.kept.find(request)
            if known is None:
                yield name, request
            else:
                self.found[name] = known

    def add(self, name: str, request: SolveRequest, result: SolveResult) -> None:
        """Keep what was found."""
        self.kept.add(request, result)
        self.found[name] = result


def _spread(
    client: Any, solver: PlanSolver, work: _TaskQueue, requests: Iterable[tuple[str, SolveRequest]]
) -> None:
    """Give every task to a worker as soon as those that it builds on are done."""
    flight = distributed_module().as_completed([], loop=client.loop, with_results=False)
    asked: dict[str, tuple[str, SolveRequest]] = {}

    def send(requests: Iterable[tuple[str, SolveRequest]]) -> None:
        """Hand tasks to the workers."""
        for name, request in requests:
            future = submit(client, solve_request, solver.recipe, request)
            asked[future.key] = (name, request)
            flight.add(future)

    threads_of(client)
    send(requests)
    for future in flight:
        name, request = asked.pop(future.key)
        with faults_of(f"the search {name!r}"):
            result = future.result()
        work.add(name, request, result)
        with faults_of("the rest"):
            send(work.ready())
