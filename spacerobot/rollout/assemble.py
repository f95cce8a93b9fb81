"""Assembly of trajectories, batches and gradients from the arrays that engines fill."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.engines import Engine
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.rollout_arrays import AT_END, CHATTERING, COINCIDENT, ENDED, GRAZING, RolloutArrays
from spacerobot.rollout.time_grid import TimeGrid
from spacerobot.rollout.trajectory import Batch, BatchEvents, FiredEvent, Gradient, Status, Trajectory, frozen


def trajectory_of(raw: RolloutArrays, kernel: Kernel, grid: TimeGrid, p: Array) -> Trajectory:
    """Trajectory of ``raw``, one rollout with every state and output, up to the rollout's end."""
    sample_count, ended = int(raw.done[0]), raw.status[0] == ENDED
    (cause,) = kernel.closure.messages(raw.gaps)
    lost: Status = "chattering" if raw.status[0] == CHATTERING else "diverged"
    status: Status = "unclosed" if cause else "completed" if raw.completed[0] else lost
    # the first sample is there also where an event ends the rollout at once
    samples = max(1, int(np.searchsorted(grid.time, raw.reached[0], side="left" if ended else "right")))
    if status == "diverged" and raw.x is not None and samples:
        # the states without a finite rate at that time, else the state that grows fastest, its rate
        # compared with how far it may go
        time = raw.reached[0] + grid.step_s
        c = kernel.functions["setup"](p)[1].full().ravel()
        for place in kernel.jumps:
            c[place] = np.inf if time < c[place] else -np.inf
        rate = kernel.functions["dynamics"](time, raw.x[0, samples - 1], c)[0].full().ravel()
        (missing,) = np.nonzero(~np.isfinite(rate))
        if len(missing):
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            cause = f"{kernel.names[missing[0]]}{more}: its rate is not a number"
        else:
            cause = f"{kernel.names[int(np.argmax(np.abs(rate) * kernel.scale))]} grows fastest"
    state = np.empty((0, 0)) if raw.x is None else raw.x[0, :samples, : kernel.nx]
    y = np.empty((samples, 0)) if raw.y is None else raw.y[0, :samples]
    events = []
    if kernel.events and raw.log.jump is not None:
        switches = kernel.functions["setup"](p)[1].full().ravel()[list(kernel.switches)]
        jump = raw.log.jump[0, :, :, : kernel.nx]
        for k, event in enumerate(raw.log.event[0, : raw.log.fired[0]]):
            for place, on in kernel.events[event].sets:
                switches[place] = on
            before, after = (frozen(state.copy()) for state in jump[k])
            when = float(raw.log.when[0, k])
            events.append(FiredEvent(when, int(event), before, after, frozen(switches.copy())))
    return Trajectory(
        time=frozen(grid.time[:samples]),
        state=frozen(state),
        outputs={name: frozen(y[:, where]) for name, where in kernel.outputs.items()},
        measures={name: frozen(raw.r[0, where]) for name, where in kernel.measures.items()},
        costs={
            name: float(value) if status == "completed" else float("nan")
            for name, value in zip(kernel.costs, raw.cost[0], strict=True)
        },
        status=status,
        cause=cause,
        diverged_at_s=None if status == "completed" else float(raw.reached[0]),
        steps=sample_count,
        step_s=grid.step_s,
        backend="",
        wall_s=0.0,
        step_error=float("nan") if raw.error is None else float(raw.error[0]),
        events=tuple(events),
        ended_at_s=float(raw.reached[0]) if ended else None,
    )


def batch_of(
    raw: RolloutArrays,
    engine: Engine,
    grid: TimeGrid,
    outputs: Sequence[str],
    threads: int,
    wall_s: float,
) -> Batch:
    """Batch of all rollouts in ``raw``, with the named outputs."""
    kernel = engine.kernel
    events = None
    if kernel.events:
        events = BatchEvents(
            count=frozen(raw.log.fired),
            event=frozen(raw.log.event),
            time_s=frozen(raw.log.when),
            ended_at_s=frozen(np.where(raw.status == ENDED, raw.reached, np.nan)),
            chattering=frozen(raw.status == CHATTERING),
        )
    return Batch(
        costs={name: frozen(raw.cost[:, i]) for i, name in enumerate(kernel.costs)},
        measures={name: frozen(raw.r[:, where]) for name, where in kernel.measures.items()},
        diverged_at_s=diverged_at(raw),
        unclosed=kernel.closure.messages(raw.gaps),
        gaps=gaps_of(raw, kernel),
        done=raw.done >= 0,
        time=frozen(grid.time),
        outputs={name: frozen(block) for name, block in split(raw, kernel, grid, outputs).items()},
        state=None if raw.x is None else frozen(raw.x[:, :, : kernel.nx]),
        backend=engine.backend,
        lanes=engine.lanes,
        threads=threads,
        wall_s=wall_s,
        events=events,
    )


def gradient_of(
    raw: RolloutArrays, gradient: Array, kernel: Kernel, paths: Sequence[str], costs: Sequence[str]
) -> Gradient:
    """Gradients of shape (N, len(costs), k), flattened to (N len(costs), k) as ``raw`` is, by cost."""
    every = len(costs)
    return Gradient(
        paths=tuple(paths),
        costs={name: frozen(raw.cost[::every, kernel.costs.index(name)]) for name in costs},
        gradients={name: frozen(gradient[i::every]) for i, name in enumerate(costs)},
        measures={name: frozen(raw.r[::every, where]) for name, where in kernel.measures.items()},
        diverged_at_s=diverged_at(raw)[::every],
        unclosed=kernel.closure.messages(raw.gaps[::every]),
        gaps={name: frozen(gap[::every]) for name, gap in gaps_of(raw, kernel).items()},
        backend="",
        wall_s=0.0,
        status=statuses(raw, kernel, every),
    )


def statuses(raw: RolloutArrays, kernel: Kernel, every: int = 1) -> tuple[str, ...]:
    """Gradient status of each rollout, as text; ``every`` consecutive rows belong to one rollout."""
    steps = next((event.who for event in kernel.events if event.quantised), "")
    quantised = f"inaccurate: quantised: derivatives leave out the steps of '{steps}'" if steps else ""

    def status_of(is_complete: bool, warning: int, event: int) -> str:
        """Gradient status of one rollout; ``event`` is the index of the event behind its gradient warning."""
        name = kernel.events[event].name if kernel.events else ""
        if not is_complete:
            return "lost"
        if warning == GRAZING:
            return f"grazing: a small change may add or remove the event '{name}'"
        if warning == COINCIDENT:
            coincident_pair = (
                f"the event '{name}' and another one" if event >= 0 else "two ends of references"
            )
            return f"coincident: {coincident_pair} may change places"
        if warning == AT_END:
            return f"at the end: a small change may move the event '{name}' past the end of the rollout"
        return quantised or "exact"

    warnings = [max(rows) for rows in raw.log.gradient_warning.reshape(-1, every, 2).tolist()]
    return tuple(
        status_of(bool(is_complete), *warning)
        for is_complete, warning in zip(raw.completed[::every], warnings, strict=True)
    )


def gaps_of(raw: RolloutArrays, kernel: Kernel) -> dict[str, Array]:
    """Initial gaps by grasp (N,) [m]."""
    return {name: frozen(gap) for name, gap in zip(kernel.closure.largest, raw.gaps.T, strict=True)}


def diverged_at(raw: RolloutArrays) -> Array:
    """Time of the last valid state of each diverged rollout [s], 0 if it did not start, else NaN."""
    lost = (raw.done >= 0) & ~raw.completed
    return frozen(np.where(lost, raw.reached, np.nan))


def split(raw: RolloutArrays, kernel: Kernel, grid: TimeGrid, outputs: Sequence[str]) -> dict[str, Array]:
    """The named outputs, which ``raw`` holds one after the other, each of shape (N, nt, n)."""
    sizes = [kernel.outputs[name].stop - kernel.outputs[name].start for name in outputs]
    ends = np.cumsum([0, *sizes])
    y = np.empty((len(raw.done), grid.intervals + 1, 0)) if raw.y is None else raw.y
    return {name: y[:, :, a:b] for name, a, b in zip(outputs, ends[:-1], ends[1:], strict=True)}
