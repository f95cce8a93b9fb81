"""Attempts that build on each other, made here or by Dask's workers, and kept as they come.

Which attempt begins with which is laid down before anything is done. So what is found depends neither on how
many work, nor on who is ready first, nor on how often it was interrupted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from optim.planning.searches.bench import Ask, Attempt, Bench
from optim.planning.searches.kept import Kept
from optim.planning.searches.search import search
from optim.workers.cluster import connect, distributed_module, faults_of, submit, threads_of

Found = dict[str, Attempt]


@dataclass(frozen=True)
class Task:
    """One attempt among others.

    Attributes
    ----------
    ask
        What is asked for, from what was found before.
    after
        Names of the tasks that it builds on; they stand before it.
    """

    ask: Callable[[Mapping[str, Attempt]], Ask]
    after: tuple[str, ...] = ()


def carry_out(bench: Bench, tasks: Mapping[str, Task], kept: Kept, dask: str | None = None) -> Found:
    """Make attempts, but for those that are kept already.

    Parameters
    ----------
    bench
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
    work = _Work(dict(tasks), {}, kept)
    if dask is None:
        for name, ask in work.ready():
            work.add(name, ask, search(bench, ask))
    elif asks := list(work.ready()):
        with connect(dask) as client:
            _spread(client, bench, work, asks)
    return work.found


@dataclass(frozen=True)
class _Work:
    """Tasks that are left, what was found, and where that is kept."""

    left: dict[str, Task]
    found: Found
    kept: Kept

    def ready(self) -> Iterator[tuple[str, Ask]]:
        """Tasks whose turn has come, with what is asked; what is kept already is taken from there."""
        for name, task in list(self.left.items()):
            if not self.found.keys() >= set(task.after):
                continue
            del self.left[name]
            ask = task.ask(self.found)
            known = self.kept.find(ask)
            if known is None:
                yield name, ask
            else:
                self.found[name] = known

    def add(self, name: str, ask: Ask, attempt: Attempt) -> None:
        """Keep what was found."""
        self.kept.add(ask, attempt)
        self.found[name] = attempt


def _spread(client: Any, bench: Bench, work: _Work, asks: Iterable[tuple[str, Ask]]) -> None:
    """Give every task to a worker as soon as those that it builds on are done."""
    flight = distributed_module().as_completed([], loop=client.loop, with_results=False)
    asked: dict[str, tuple[str, Ask]] = {}

    def send(asks: Iterable[tuple[str, Ask]]) -> None:
        """Hand tasks to the workers."""
        for name, ask in asks:
            future = submit(client, search, bench.recipe, ask)
            asked[future.key] = (name, ask)
            flight.add(future)

    threads_of(client)
    send(asks)
    for future in flight:
        name, ask = asked.pop(future.key)
        with faults_of(f"the search {name!r}"):
            attempt = future.result()
        work.add(name, ask, attempt)
        with faults_of("the rest"):
            send(work.ready())
