"""Solve tasks that depend on each other, run here or by Dask's workers, and stored when finished.

The dependencies are fixed before the first task runs. The results therefore depend neither on the number of
workers, nor on the order in which they finish, nor on interruptions.
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
        request: Function from the previous results to the request.
        after: Names of the tasks on whose results it depends; they precede it.
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
        folder: Folder in which finished results are stored; not stored if None.
        dask: Address of a cluster as for :func:`optim.workers.cluster.connect`; this process if None.

    Raises:
        SpaceRobotError: If the cluster cannot be reached, or if several workers fail in turn on one task.
    """
    left, results, store = dict(tasks), ResultsByTask(), ResultStore(folder, solver.recipe.key)

    def ready() -> Iterator[tuple[str, SolveRequest]]:
        """Tasks to run whose dependencies are complete, with their requests; stored results are loaded."""
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
        # submit every task as soon as its dependencies are complete
        flight = distributed_module().as_completed([], loop=client.loop, with_results=False)
        pending: dict[str, tuple[str, SolveRequest]] = {}

        def send(requests: Iterable[tuple[str, SolveRequest]]) -> None:
            """Submit tasks to the workers."""
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
