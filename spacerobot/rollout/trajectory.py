"""Trajectories: the results of rollouts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.tables import Table, Tabular

Status = Literal["completed", "diverged", "unclosed", "chattering"]
Integers = npt.NDArray[np.int64]


@dataclass(frozen=True)
class FiredEvent:
    """An event of a rollout. Every array is read-only.

    Attributes:
        time_s: When it was [s].
        event: Which, as a place in the closed loop's ``events``.
        before, after: States before and after it, shape (nx,).
        switches: Values of the closed loop's switches after it, 0 or 1, shape (ns,).
    """

    time_s: float
    event: int
    before: Array
    after: Array
    switches: Array


@dataclass(frozen=True)
class BatchEvents:
    """Events of many rollouts. Every array is read-only.

    Attributes:
        count: How many each had, shape (N,), without those that are silent or routine.
        event, time_s: Which, as places in the closed loop's ``events``, and when [s], shape (N, most): the
            first ones of each in turn; -1 and NaN beyond its last.
        ended_at_s: When an event ended the rollout, shape (N,); NaN where none did.
        chattering: Which rollouts had too many events in too short a time, shape (N,). They count as diverged
            then.
    """

    count: Integers
    event: Integers
    time_s: Array
    ended_at_s: Array
    chattering: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Trajectory:
    """One rollout. Every array is read-only.

    Attributes:
        time: Sample times in s, shape (nt,); cut short where the rollout diverged or an event ended it.
        state: x = (q, v, z) at the samples, shape (nt, nx).
        outputs: Named outputs at the samples, each of shape (nt, n).
        measures: Named measures of the rollout, NaN if it diverged.
        costs: Named costs of the rollout, NaN if it diverged.
        status: ``diverged`` if a state left its bounds or was no number, ``unclosed`` if a grasp did not
            close at the start, ``chattering`` if too many events came in too short a time.
        cause: Which grasp did not close, and its gap; else empty.
        diverged_at_s: Time of the last good state if it was not completed, else None.
        steps, step_s: Steps done and their length; zero and NaN for an adaptive integrator.
        backend: What ran: ``compiled``, ``interpreted`` or ``pinocchio``.
        wall_s: Time it took.
        step_error: Largest estimate of a single step's error in any state, relative to that state's largest
            value where it is above one; NaN if it was not asked for.
        events: The events that fired, in turn.
        ended_at_s: When an event ended the rollout [s]; None if none did.
        state_names: Names of the states behind q and v where they are not the closed loop's; else none.
    """

    time: Array
    state: Array
    outputs: Mapping[str, Array]
    measures: Mapping[str, Array]
    costs: Mapping[str, float]
    status: Status
    diverged_at_s: float | None
    steps: int
    step_s: float
    backend: str
    wall_s: float
    step_error: float = float("nan")
    cause: str = ""
    events: tuple[FiredEvent, ...] = ()
    ended_at_s: float | None = None
    state_names: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Status and size of the trajectory, in one line."""
        return f"<Trajectory: {self.status}, {len(self.time)} samples, {self.steps} steps, {self.backend}>"


@dataclass(frozen=True)
class Batch(Tabular):
    """Many rollouts. Every array is read-only; rows follow the rows of the parameters.

    Attributes:
        costs: Named costs, each of shape (N,); NaN where a rollout diverged, did not begin or did not run.
        measures: Named measures, each of shape (N, n).
        diverged_at_s: Time of the last good state, shape (N,); NaN where the rollout completed or did not
            run.
        unclosed: Of each rollout, which grasp did not close at the start and its gap, N sentences; empty
            where all did. Such a rollout counts as diverged at the start.
        gaps: Initial gaps of the grasps that no base closes, by name, each (N,) [m].
        done: Whether each rollout ran, shape (N,); all true unless the batch was cancelled.
        time: Sample times in s, shape (nt,).
        outputs: The outputs that were asked for, each of shape (N, nt, n); NaN after divergence.
        state: States if they were asked for, shape (N, nt, nx), else None.
        backend, lanes, threads: What ran.
        wall_s: Time it took.
        events: Events of each rollout; None where the closed loop has none.
    """

    costs: Mapping[str, Array]
    measures: Mapping[str, Array]
    diverged_at_s: Array
    unclosed: tuple[str, ...]
    gaps: Mapping[str, Array]
    done: npt.NDArray[np.bool_]
    time: Array
    outputs: Mapping[str, Array]
    state: Array | None
    backend: str
    lanes: int
    threads: int
    wall_s: float
    events: BatchEvents | None = None

    def __repr__(self) -> str:
        """Number of rollouts, their statuses and outputs, in one line."""
        ran, lost = int(self.done.sum()), int(np.isfinite(self.diverged_at_s).sum())
        named = ", ".join(dict.fromkeys([*self.costs, *self.measures, *self.outputs])) or "nothing"
        return (
            f"<Batch of {len(self.done)} rollouts: {ran} ran, {lost} diverged, {self.backend}; holds {named}>"
        )

    def content(self) -> list[Table]:
        """Statuses, and minimum, median and maximum of the outputs."""
        lost = int(np.isfinite(self.diverged_at_s).sum())
        ran = f"{int(self.done.sum())}, {lost} of them diverged; {self.backend}, {self.wall_s:.3g} s"
        rows = [("ran", ran)]
        for name, values in {**self.measures, **self.costs}.items():
            good = values[np.isfinite(values)]
            if good.size:
                rows.append((name, " .. ".join(f"{v:.4g}" for v in np.quantile(good, [0, 0.5, 1]))))
        return [Table.of_pairs(f"Batch of {len(self.done)} rollouts: least .. median .. greatest", rows)]

    @property
    def cancelled(self) -> bool:
        """Whether some rollouts were left out."""
        return not bool(self.done.all())

    @property
    def rate(self) -> float:
        """Rollouts per second."""
        return float(self.done.sum()) / max(self.wall_s, 1e-9)


@dataclass(frozen=True)
class Gradient:
    """Costs of rollouts and their exact derivatives. Every array is read-only.

    Attributes:
        paths: Parameters that the derivatives are with respect to, k of them.
        costs: Named costs, each of shape (N,), or () for a single rollout.
        gradients: Named gradients, each of shape (N, k), or (k,); NaN where a rollout diverged.
        measures: Named measures, each of shape (N, n), or (n,).
        diverged_at_s: Time of the last good state, shape (N,), or (); NaN where the rollout completed.
        unclosed, gaps: As of :class:`Batch`; for a single rollout one sentence, and gaps of shape ().
        backend: What ran.
        wall_s: Time it took.
        status: Of each rollout ``exact``, or ``lost``, or why its gradient may not hold: it grazes an event,
            two events may change places, outputs or measurements are quantised (``inaccurate: quantised``),
            or half the step changes a derivative by more than 1 % (``inaccurate: step``); ``unchecked`` where
            that was not asked for. N words or sentences, one for a single rollout.
    """

    paths: tuple[str, ...]
    costs: Mapping[str, Array]
    gradients: Mapping[str, Array]
    measures: Mapping[str, Array]
    diverged_at_s: Array
    unclosed: tuple[str, ...]
    gaps: Mapping[str, Array]
    backend: str
    wall_s: float
    status: tuple[str, ...] = ()


@dataclass(frozen=True)
class Jacobian:
    """Forward sensitivities of one rollout with respect to k parameters.

    Attributes:
        paths: The parameters.
        trajectory: The rollout itself.
        measures: Derivative of each measure, shape (n, k); NaN if the rollout diverged.
        outputs: Derivative of each asked-for output, shape (nt, n, k); NaN after divergence.
        wall_s: Time it took.
        status: As one of :class:`Gradient`.
    """

    paths: tuple[str, ...]
    trajectory: Trajectory
    measures: Mapping[str, Array]
    outputs: Mapping[str, Array]
    wall_s: float
    status: str = "exact"


@dataclass(frozen=True)
class Slopes:
    """Measures of N rollouts and their derivatives with respect to k parameters.

    Attributes:
        paths: The parameters.
        measures: Value of each measure (N, n); NaN where a rollout diverged.
        slopes: Derivative of each measure (N, n, k); NaN likewise.
        unclosed: As of :class:`Batch`.
        wall_s: Time it took.
        status: As of :class:`Gradient`.
    """

    paths: tuple[str, ...]
    measures: Mapping[str, Array]
    slopes: Mapping[str, Array]
    unclosed: tuple[str, ...]
    wall_s: float
    status: tuple[str, ...] = ()


Kind = TypeVar("Kind", bound=np.generic)


def frozen(array: npt.NDArray[Kind]) -> npt.NDArray[Kind]:
    """The array, made read-only."""
    array.setflags(write=False)
    return array
