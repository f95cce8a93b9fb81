"""Trajectories: the results of rollouts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt

from spacerobot.common.tables import Table
from spacerobot.common.tabular import Tabular
from spacerobot.rollout.closed_loop_protocol import Array

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
        count: Number of events of each rollout, shape (N,), recorded or not, without silent and routine ones.
        event, time_s: Indices in the closed loop's ``events`` and times [s], shape (N, most), in order of
            time; -1 and NaN beyond the last.
        ended_at_s: Time of the event that ended the rollout [s], shape (N,); NaN if none did.
        chattering: Whether too many events occurred in too short a time, shape (N,). Such rollouts count as
            diverged.
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
        status: ``diverged`` if a state left its bounds or is not finite, ``unclosed`` if a grasp did not
            close at the start, ``chattering`` if too many events occurred in too short a time.
        cause: Grasp that did not close, with its gap, or state that diverged; else empty.
        diverged_at_s: Time of the last valid state [s] if the rollout did not complete, else None.
        steps, step_s: Number of steps and their length [s]; zero and NaN for an adaptive integrator.
        backend: Backend: ``compiled``, ``interpreted`` or ``pinocchio``.
        wall_s: Wall time [s].
        step_error: Largest estimate of a single step's error in any state, relative to that state's largest
            value if that is above one; NaN if not requested.
        events: Fired events, in order of time.
        ended_at_s: Time of the event that ended the rollout [s]; None if none did.
        state_names: Names of the states after q and v if they differ from the closed loop's; else empty.
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
        costs: Named costs, each of shape (N,); NaN where a rollout diverged, did not start or did not run.
        measures: Named measures, each of shape (N, n).
        diverged_at_s: Time of the last valid state [s], shape (N,); NaN where the rollout completed or did
            not run.
        unclosed: N sentences: grasp that did not close at the start and its gap; empty where all closed. Such
            a rollout counts as diverged at the start.
        gaps: Initial gaps of the grasps that no base closes, by name, each (N,) [m].
        done: Whether each rollout ran, shape (N,); all true unless the batch was cancelled.
        time: Sample times in s, shape (nt,).
        outputs: Requested outputs, each of shape (N, nt, n); NaN after divergence.
        state: States, shape (N, nt, nx), None if not requested.
        backend, lanes, threads: Backend, number of SIMD lanes, number of threads.
        wall_s: Wall time [s].
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
        held_names = ", ".join(dict.fromkeys([*self.costs, *self.measures, *self.outputs])) or "nothing"
        return (
            f"<Batch of {len(self.done)} rollouts: {ran} ran, {lost} diverged, {self.backend}; "
            f"holds {held_names}>"
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
        paths: Dotted paths of the k parameters of the derivatives.
        costs: Named costs, each of shape (N,), or () for a single rollout.
        gradients: Named gradients, each of shape (N, k), or (k,); NaN where a rollout diverged.
        measures: Named measures, each of shape (N, n), or (n,).
        diverged_at_s: Time of the last valid state [s], shape (N,), or (); NaN where the rollout completed.
        unclosed, gaps: See :class:`Batch`; one sentence, and gaps of shape (), for a single rollout.
        backend: Backend.
        wall_s: Wall time [s].
        status: Gradient status of each rollout (N texts, one for a single rollout): ``exact``, ``lost``, or
            the reason why the gradient may not hold. Reasons: it grazes an event; two events may change
            order; outputs or measurements are quantised (``inaccurate: quantised``); half the step changes a
            derivative by more than 1 % (``inaccurate: step``). ``unchecked`` if half the step was not tried.
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
        paths: Dotted paths of the k parameters.
        trajectory: The rollout.
        measures: Derivative of each measure, shape (n, k); NaN if the rollout diverged.
        outputs: Derivative of each requested output, shape (nt, n, k); NaN after divergence.
        wall_s: Wall time [s].
        status: Gradient status; see :class:`Gradient`.
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
        paths: Dotted paths of the k parameters.
        measures: Value of each measure (N, n); NaN where a rollout diverged.
        slopes: Derivative of each measure (N, n, k); NaN where a rollout diverged.
        unclosed: See :class:`Batch`.
        wall_s: Wall time [s].
        status: Gradient status of each rollout; see :class:`Gradient`.
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
