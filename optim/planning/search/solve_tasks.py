"""Solve tasks that build on each other, run here or by Dask's workers, and stored as they end.

Which attempt begins with which is laid down before anything is done. So what is found depends neither on how
many work, nor on who is ready first, nor on how often it was interrupted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from optim.planning.search.plan_solver import PlanSolver, SolveRequest, SolveResult
from optim.planning.search.result_store import ResultStore
from optim.planning.search.solve_request import solve_request
from optim.workers.cluster import connect, distributed_module, faults_of, submit, threads_of

ResultsByTask = dict[str, SolveResult]


@dataclass(frozen=True)
class SolveTask:
    """One solve that may depend on others.

    Attributes:
        request: Function from the results so far to the request.
        after: Names of the tasks that it builds on; they stand before it.
    """

    request: Callable[[Mapping[str, SolveResult]], SolveRequest]
    after: tuple[str, ...] = ()


def run_tasks(
    solver: PlanSolver, tasks: Mapping[str, SolveTask], folder: Path | None = None, dask: str | None = None
) -> ResultsByTask:
    """Run tasks, except those whose results are stored already.

    Args:
        solver: The problem.
        tasks: Tasks by name, each after those that it depends on.
        folder: Folder in which finished attempts are stored; not stored if None.
        dask: Address of a cluster as for :func:`optim.workers.cluster.connect`; this process if None.

    Raises:
        SpaceRobotError: If the cluster cannot be reached, or loses an attempt on one worker after the other.
    """
    left, results, store = dict(tasks), ResultsByTask(), ResultStore(folder, solver.recipe.key)

    def ready() -> Iterator[tuple[str, SolveRequest]]:
        """Tasks whose turn has come, with what is asked; what is kept already is taken from there."""
        for name, task in list(left.items()):
            if not results.keys() >= set(task.after):
                continue
            del left[name]
            request = task.request(results)
            stored_result = store.find(request)
            if stored_result is None:
                yield name, request
            else:
                results[name] = stored_result

    if dask is None:
        for name, request in ready():
            results[name] = solve_request(solver, request)
            store.add(request, results[name])
        return results
    requests = list(ready())
    if not requests:
        return results
    with connect(dask) as client:
        # give every task to a worker as soon as those that it builds on are done
        flight = distributed_module().as_completed([], loop=client.loop, with_results=False)
        pending: dict[str, tuple[str, SolveRequest]] = {}

        def send(requests: Iterable[tuple[str, SolveRequest]]) -> None:
            """Hand tasks to the workers."""
            for name, request in requests:
                future = submit(client, solve_request, solver.recipe, request)
                pending[future.key] = (name, request)
                flight.add(future)

        threads_of(client)
        send(requests)
        for future in flight:
            name, request = pending.pop(future.key)
            with faults_of(f"the search {name!r}"):
                results[name] = future.result()
            store.add(request, results[name])
            with faults_of("the rest"):
                send(ready())
    return results
