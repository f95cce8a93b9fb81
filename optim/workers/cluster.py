"""Dask clusters: connection, and tasks built from recipes.

Dask is optional and imported only here, on first use. A task is a recipe (plain data) and the rows to
evaluate. A worker caches the object that it builds from a recipe, and its machine caches the compiled code.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import logging
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from optim.workers.workers import Recipe
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.version import __version__
from spacerobot.compiled.cache import cache_folder

ATTEMPTS = 3  # workers that a piece of work may cost before it is given up
KEPT = 8  # problems that a worker keeps
CONNECT_S = 20  # that a scheduler may take to answer
ANSWER_S = 60  # until its first worker must be there

_built: dict[str, Any] = {}
_lock = threading.Lock()


@contextlib.contextmanager
def connect(address: str) -> Iterator[Any]:
    """Client of a cluster, as a context; a cluster on this machine ends with it.

    Args:
        address: ``local:N`` for N processes of this machine, ``tcp://host:port`` or another address of Dask,
            or a scheduler file.

    Raises:
        SpaceRobotError: If Dask is not installed, the address is not valid, or no scheduler answers there.
    """
    distributed = distributed_module()
    with _quiet():
        if address.startswith("local:"):
            # processes of this machine, which listen to it alone and end with the context
            options: dict[str, Any] = {"n_workers": _local_count(address), "threads_per_worker": 1}
            places = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
            with _spared():
                cluster = distributed.LocalCluster(**options, **places, silence_logs=logging.CRITICAL)
            with cluster, distributed.Client(cluster) as client:
                yield client
            return
        place = {"address": address} if "://" in address else {"scheduler_file": _scheduler_file(address)}
        try:
            client = distributed.Client(**place, timeout=CONNECT_S)
        except (OSError, TimeoutError, ValueError) as fault:
            raise SpaceRobotError(f"no scheduler answers at {address}: {fault}", where="--dask") from None
        with client:
            yield client


@contextlib.contextmanager
def _spared() -> Iterator[None]:
    """Context in which new processes ignore Ctrl-C; a terminal sends it to all, and this one ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before if before is not None else signal.default_int_handler)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Context that hides Dask's log of lost workers; errors are raised in one line instead."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


def threads_of(client: Any) -> int:
    """Total number of threads of all workers, at least one; waits for the first worker.

    Raises:
        SpaceRobotError: If no worker connects in time.
    """
    try:
        with faults_of("the work"):
            client.wait_for_workers(1, timeout=ANSWER_S)
            return max(1, int(sum(client.nthreads().values())))
    except TimeoutError:
        message = f"the scheduler has no worker after {ANSWER_S} s: start some with `dask worker`"
        raise SpaceRobotError(message, where="--dask") from None


def submit(client: Any, work: Any, recipe: Recipe, *arguments: Any) -> Any:
    """Future of ``work(recipe.build(), *arguments)``; another worker repeats it if its worker dies."""
    return client.submit(_work, __version__, work, recipe, *arguments, pure=False, retries=ATTEMPTS)


@contextlib.contextmanager
def faults_of(what: str) -> Iterator[None]:
    """Say in one line that a cluster has lost some work.

    Raises:
        SpaceRobotError: If the work ended one worker after the other, or the scheduler is gone.
    """
    distributed = distributed_module()
    try:
        yield
    except distributed.KilledWorker:
        message = f"{what} ended {ATTEMPTS + 1} workers; what is there is kept"
        raise SpaceRobotError(message, where="--dask") from None
    except TimeoutError:
        raise
    except (distributed.CancelledError, OSError) as fault:
        message = f"{what}: lost the cluster ({fault or type(fault).__name__}); what is there is kept"
        raise SpaceRobotError(message, where="--dask") from None


def _work(version: str, work: Any, recipe: Recipe, *arguments: Any) -> Any:
    """Run a work on a recipe's object, in a worker."""
    if version != __version__:
        message = f"a worker has spacerobot {__version__}, this process {version}: install the same"
        raise SpaceRobotError(message, where="--dask")
    key = recipe.key
    with _lock:  # built once in this process
        if key not in _built:
            while len(_built) >= KEPT:
                _built.pop(next(iter(_built)))
            with alone_on_this_machine():
                _built[key] = recipe.build()
        operations = _built[key]
    return work(operations, *arguments)


@contextlib.contextmanager
def alone_on_this_machine() -> Iterator[None]:
    """Let one worker of a machine compile while the others wait, to find it compiled."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with (cache_folder() / "workers.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def distributed_module() -> Any:
    """The module ``distributed``.

    Raises:
        SpaceRobotError: If it is not installed.
    """
    try:
        return importlib.import_module("distributed")
    except ImportError:
        message = "needs Dask: pip install 'dask[distributed]'"
        raise SpaceRobotError(message, where="--dask") from None


def check_address(address: str) -> None:
    """Check the form of an address before anything is written or computed.

    Raises:
        SpaceRobotError: If it is neither ``local:N``, nor a URL, nor a scheduler file.
    """
    if address.startswith("local:"):
        _local_count(address)
    elif "://" not in address:
        _scheduler_file(address)


def _local_count(address: str) -> int:
    """Number of processes of an address ``local:N``."""
    count = address.removeprefix("local:")
    if not count.isdecimal() or int(count) < 1:
        message = f"found {address!r}, allowed: local:N with N of 1 and more"
        raise SpaceRobotError(message, where="--dask")
    return int(count)


def _scheduler_file(name: str) -> str:
    path = Path(name)
    try:
        json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        message = f"found {name!r}, allowed: local:N, tcp://HOST:PORT, or a scheduler file"
        raise SpaceRobotError(message, where="--dask") from None
    return str(path)
