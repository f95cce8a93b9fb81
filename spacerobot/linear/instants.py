"""States of a simulation at requested instants: at times, and just before and after events."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.common.errors import DivergedError, ScenarioError, near_names
from spacerobot.rollout import FiredEvent, Rollout, Trajectory, time_grid

InstantNames = float | str | Iterable[float | str]
"""Times [s], and kinds or names of events; one, or several."""


@dataclass(frozen=True)
class Instant:
    """State of a simulation at an instant.

    Attributes:
        label: ``12.3 s``, or an event: ``captured, before``.
        time_s: Time [s].
        x, c: State (nx,) and constants (nc,) of the closed loop, with the switches of that instant.
    """

    label: str
    time_s: float
    x: Array
    c: Array

    @property
    def is_start(self) -> bool:
        """Whether it is the start of the simulation, whose state is the scenario's initial state."""
        return self.time_s == 0 and "," not in self.label


def as_instants(at: InstantNames) -> list[float | str]:
    """Times and events as a list, also of a single one."""
    return [at] if isinstance(at, str | int | float | np.integer) else list(at)


def check_times(duration_s: float, at: Iterable[float | str]) -> None:
    """Check of times; names of events are ignored.

    Args:
        duration_s: Duration of the simulation [s].
        at: Times [s], and kinds or names of events.

    Raises:
        ScenarioError: If a time lies outside the simulation.
    """
    for place in at:
        if not isinstance(place, str) and not 0 <= place <= duration_s:
            raise ScenarioError(f"found {place:g} s, allowed: from 0 to {duration_s:g} s", where="at")


def check_instants(loop: ClosedLoop, duration_s: float, at: Iterable[float | str]) -> None:
    """Check of times and of names of events, before anything is simulated.

    Args:
        loop: The closed loop.
        duration_s: Duration of the simulation [s].
        at: Times [s], and kinds or names of events.

    Raises:
        ScenarioError: If a time lies outside the simulation, or there is no such event.
    """
    check_times(duration_s, at)
    kinds = dict.fromkeys(kind for rule in loop.events for kind in (rule.kind, rule.name))
    for place in at:
        if isinstance(place, str) and place not in kinds:
            # names of a tip's own events, `robot/tip:path.to.number.passed`, are too long for a list
            hint = near_names(place, [kind for kind in kinds if ":" not in kind])
            raise ScenarioError(f"no event {place!r}; {hint}", where="at")


def instants(rollout: Rollout, loop: ClosedLoop, at: Iterable[float | str]) -> Iterator[Instant]:
    """Yield the states at times and at events.

    Args:
        rollout, loop: The rollout and its closed loop; states of the rollout that the closed loop does not
            have are left out.
        at: Times [s], and kinds or names of events. For each event, the states just before and just after its
            first occurrence.

    Raises:
        DivergedError: If the simulation does not reach an instant.
        ScenarioError: If a time is outside the simulation, or an event does not occur.
    """
    places = list(at)
    check_instants(loop, rollout.grid.duration_s, places)
    trajectory = _run(rollout) if any(isinstance(place, str) for place in places) else None
    for place in places:
        if isinstance(place, str) and trajectory is not None:
            yield from _at_event(loop, trajectory, place)
        elif place == 0:
            x0, c = (value.full().ravel() for value in loop.setup(loop.parameter_values))
            yield _instant(loop, "0 s", 0.0, x0, c[list(loop.switches)])
        else:
            time_s = float(place)
            grid = time_grid(time_s, rollout.grid.step_s, time_s)
            value = _run(dataclasses.replace(rollout, grid=grid))
            if value.ended_at_s is not None and value.ended_at_s < time_s:
                ended = f"the simulation ended at {value.ended_at_s:g} s, before {time_s:g} s"
                raise ScenarioError(ended, where="at")
            yield _instant(loop, f"{time_s:.6g} s", time_s, value.state[-1], _switches(loop, value.events))


def samples(rollout: Rollout, loop: ClosedLoop, count: int) -> Iterator[Instant]:
    """Yield states at equidistant times from the start to the end, both included.

    Args:
        rollout, loop: As for :func:`instants`.
        count: Number of times; an event at one of the times has already occurred there.
    """
    grid = rollout.grid
    grid = time_grid(grid.duration_s, grid.step_s, grid.duration_s / (count - 1))
    trajectory = _run(dataclasses.replace(rollout, grid=grid))
    for time_s, x in zip(trajectory.time, trajectory.state, strict=True):
        past = [fired for fired in trajectory.events if fired.time_s <= time_s]
        yield _instant(loop, f"{time_s:.6g} s", float(time_s), x, _switches(loop, past))


def events_of(rollout: Rollout, loop: ClosedLoop, kinds: Collection[str]) -> tuple[tuple[float, str], ...]:
    """Times [s] and kinds of events of a simulation.

    Args:
        rollout, loop: As for :func:`instants`.
        kinds: Kinds of events to return.
    """
    fired = [(one.time_s, loop.events[one.event].kind) for one in _run(rollout).events]
    return tuple(one for one in fired if one[1] in kinds)


def _run(rollout: Rollout) -> Trajectory:
    """Completed rollout."""
    trajectory = rollout.run()
    if trajectory.status != "completed":
        why = f"{trajectory.cause or trajectory.status} at {trajectory.diverged_at_s:g} s"
        raise DivergedError(f"the simulation does not reach the instant: {why}")
    return trajectory


def _at_event(loop: ClosedLoop, trajectory: Trajectory, name: str) -> Iterator[Instant]:
    """Instants before and after the first event of a kind or name."""
    for place, fired in enumerate(trajectory.events):
        rule = loop.events[fired.event]
        if name in (rule.kind, rule.name):
            before = _switches(loop, trajectory.events[:place])
            yield _instant(loop, f"{name}, before", fired.time_s, fired.before, before)
            yield _instant(loop, f"{name}, after", fired.time_s, fired.after, fired.switches)
            return
    raise ScenarioError(f"'{name}' does not happen in the simulation", where="at")


def _switches(loop: ClosedLoop, past: Sequence[FiredEvent]) -> Array:
    """Values of the switches after these events."""
    if past:
        return past[-1].switches
    return np.asarray(loop.setup(loop.parameter_values)[1].full().ravel()[list(loop.switches)])


def _instant(loop: ClosedLoop, label: str, time_s: float, x: Array, switches: Array) -> Instant:
    c = loop.setup(loop.parameter_values)[1].full().ravel()
    c[list(loop.switches)] = switches
    x = np.array(x[: loop.nx])
    return Instant(label, time_s, x, np.array(loop.at(time_s, x, c), dtype=float).ravel())
