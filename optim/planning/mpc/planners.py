"""Planners for many simulations, with one horizon each, in this process or in several local processes.

CasADi's solver holds Python's global lock, so that parallel solves need processes. Each simulation stays with
one process, and its solves depend on no other simulation. The plans are therefore the same for any number of
processes.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO

from optim.planning.mpc.flown_scene import FlownScene
from optim.planning.mpc.handover import Handover
from optim.planning.mpc.horizon import Horizon
from optim.planning.search.plan_solver import PlanSolver
from optim.problem.scene_recipe import SceneRecipe
from spacerobot.common.arrays import Array
from spacerobot.common.errors import NoPlanError, SpaceRobotError
from spacerobot.common.interrupts import leave
from spacerobot.scene import Scene

OFTEN = 1000
"""Number of planned motions assumed in the rule for compiling: in flight each solve should be fast."""
Notify = Callable[[str], None]


class Planners:
    """Horizons of simulations by their number, in this process.

    Args:
        scene: Scene whose motion is planned.
        backend: ``auto``, ``compiled`` or ``interpreted``.
        notify: Callback that receives a short message at each step.
        begun: Flown scene and handover to the planned one; at the start of the simulation if None.
    """

    def __init__(
        self,
        scene: Scene,
        backend: str = "auto",
        notify: Notify = lambda _: None,
        begun: tuple[FlownScene, Handover] | None = None,
    ) -> None:
        self._flown, self._handover = begun or (FlownScene.of(scene), Handover.at_start(scene))
        scene = self._handover.scene
        self._solver = PlanSolver.of(scene, backend, notify, motions=OFTEN)
        self._horizons: dict[int, Horizon] = {}

    def first(self, numbers: Sequence[int], measured: Array, inertia: Sequence[Array | None]) -> list[str]:
        """Make the first plan of each simulation, from an initial guess.

        Args:
            numbers: Numbers of the simulations.
            measured: Estimated configuration and velocity of each at its start (n, nq + nv).
            inertia: Estimated inertial parameters of the target (10,) of each; None for those of the model.

        Returns:
            list: Reason why a simulation has no plan; an empty text if it has one.
        """
        failures = []
        for number, state, target_inertia in zip(numbers, measured, inertia, strict=True):
            try:
                horizon = Horizon.of(self._solver, state, self._flown.settings.min_horizon, target_inertia)
            except NoPlanError as fault:
                failures.append(fault.message)
                continue
            self._horizons[number] = horizon
            failures.append("")
        return failures

    def replan(
        self, numbers: Sequence[int], begin: float, measured: Array, inertia: Sequence[Array | None]
    ) -> None:
        """Replan each simulation, warm-started by its present plan.

        Args:
            numbers: Numbers of the simulations.
            begin: Time at which the plans begin, since the first ones began [s].
            measured: Estimated configuration and velocity of each at that time (n, nq + nv).
            inertia: Estimated inertial parameters of the target (10,) of each; None for the previous ones.
        """
        for number, state, target_inertia in zip(numbers, measured, inertia, strict=True):
            self._horizons[number].replan(begin, state, self._flown.settings.iterations, target_inertia)

    def points(self, numbers: Sequence[int], now: float) -> list[Array]:
        """Points of each plan in the period from ``now`` [s] on; see :meth:`FlownScene.numbers`."""
        begin, locked = self._handover.begin_s, self._handover.locked
        return [self._flown.numbers(self._horizons[number], now, begin, locked) for number in numbers]

    def end(self, numbers: Sequence[int]) -> list[dict[str, Any]]:
        """Return the statistics of each simulation's plans, and delete its horizon."""
        return [self._horizons.pop(n).statistics if n in self._horizons else {} for n in numbers]


class ParallelPlanners:
    """Planners in several processes; see :class:`Planners`.

    Args:
        scene: Scene whose motion is planned.
        count: Number of processes.
    """

    def __init__(self, scene: Scene, count: int) -> None:
        path = os.pathsep.join(filter(None, [*sys.path, os.environ.get("PYTHONPATH", "")]))
        command = [sys.executable, "-c", f"from {__name__} import serve; serve()"]
        self._processes = [
            subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=os.environ | {"PYTHONPATH": path},
            )
            for _ in range(count)
        ]
        weakref.finalize(self, _end, self._processes)
        for process in self._processes:
            _send(process, SceneRecipe.of(scene))

    def first(self, numbers: Sequence[int], measured: Array, inertia: Sequence[Array | None]) -> list[str]:
        """See :meth:`Planners.first`."""
        return self._spread("first", numbers, lambda rows: (measured[rows], [inertia[row] for row in rows]))

    def replan(
        self, numbers: Sequence[int], begin: float, measured: Array, inertia: Sequence[Array | None]
    ) -> None:
        """See :meth:`Planners.replan`."""
        self._spread("replan", numbers, lambda rows: (begin, measured[rows], [inertia[row] for row in rows]))

    def points(self, numbers: Sequence[int], now: float) -> list[Array]:
        """See :meth:`Planners.points`."""
        return self._spread("points", numbers, lambda _: (now,))

    def end(self, numbers: Sequence[int]) -> list[dict[str, Any]]:
        """See :meth:`Planners.end`."""
        return self._spread("end", numbers, lambda _: ())

    def _spread(
        self, what: str, numbers: Sequence[int], arguments: Callable[[list[int]], tuple[Any, ...]]
    ) -> list[Any]:
        """Call a method in all processes, each with its simulations; results in the order of ``numbers``."""
        shares: dict[int, list[int]] = {}
        for row, number in enumerate(numbers):
            shares.setdefault(number % len(self._processes), []).append(row)
        for place, rows in shares.items():
            assigned_numbers = [int(numbers[row]) for row in rows]
            _send(self._processes[place], (what, (assigned_numbers, *arguments(rows))))
        results: list[Any] = [None] * len(numbers)
        answers = {}
        for place in shares:
            process = self._processes[place]
            assert process.stdout is not None, "opened as a pipe"
            try:
                answers[place] = pickle.load(process.stdout)  # noqa: S301 (of a process that this one began)
            except EOFError:
                code = process.wait()
                message = (
                    f"a process that solves plans has ended with code {code}; its memory may not suffice"
                )
                raise SpaceRobotError(message) from None
        for place, rows in shares.items():
            if isinstance(answers[place], SpaceRobotError):
                raise answers[place]
            for row, answer in zip(rows, answers[place] or [None] * len(rows), strict=True):
                results[row] = answer
        return results


def serve() -> None:
    """Solve requests from standard input until it ends, and write the answers to standard output.

    A thread reads the requests. If the parent process is killed, the system closes the pipe, and the thread
    ends this process even during a solve: the solver calls Python at each iteration, which lets the thread
    run.
    """
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # a terminal sends Ctrl-C to all; the parent ends this process
    requests = queue.SimpleQueue[Any]()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    threading.Thread(target=_read, args=(sys.stdin.buffer, requests), name="requests", daemon=True).start()
    planners: Planners | SpaceRobotError
    try:
        planners = Planners(requests.get().build())
    except SpaceRobotError as fault:
        planners = fault
    while True:
        what, arguments = requests.get()
        try:
            answer = (
                planners if isinstance(planners, SpaceRobotError) else getattr(planners, what)(*arguments)
            )
        except SpaceRobotError as fault:
            answer = fault
        try:
            pickle.dump(answer, answers)
            answers.flush()
        except BrokenPipeError:  # before the thread had its turn
            leave("")


def _read(pipe: BinaryIO, requests: queue.SimpleQueue[Any]) -> None:
    """Read requests; end this process and its compilers when the pipe ends or a request is truncated."""
    try:
        while True:
            requests.put(pickle.load(pipe))  # noqa: S301 (of the process that began this one)
    except (EOFError, pickle.UnpicklingError):
        pass
    finally:
        leave("")


def _send(process: subprocess.Popen[bytes], what: Any) -> None:
    assert process.stdin is not None, "opened as a pipe"
    with contextlib.suppress(BrokenPipeError):  # reported where its answer is missing
        pickle.dump(what, process.stdin)
        process.stdin.flush()


def _end(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    for process in processes:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()
