"""Onboard software of a scenario: fields, and tasks that read and write them."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import casadi as ca

from spacerobot.common.arrays import Array

Role = Literal["state", "sample", "count", "truth", "mode", "plan", "draw", "command"]
"""Roles of fields: stored states; samples of sensors and their number; true values that ideal sensors or
onboard models read; switches of the plant; plans as inputs; numbers of the initial errors; commands."""

INPUTS: tuple[Role, ...] = ("sample", "count", "truth", "mode", "plan", "draw")
"""Roles of fields that the caller sets."""


@dataclass(frozen=True, eq=False)
class Field:
    """Numbers that software reads or writes together.

    Attributes:
        name: C identifier.
        path: Name in the closed loop.
        role: See :data:`Role`.
        symbol: Symbols of the numbers (n x 1).
        initial: Values at the start (n,).
        text, unit, frame: Description, SI unit, and frame.
        period_s: Time between two changes [s]; zero for values of the present instant.
        places: Indices of the numbers in the closed loop: in its state x, or in its constants c of switches
            and noise, or in its parameters p of plans.
    """

    name: str
    path: str
    role: Role
    symbol: ca.SX
    initial: Array
    text: str
    unit: str = "1"
    frame: str = "-"
    period_s: float = 0.0
    places: tuple[int, ...] = ()

    @property
    def size(self) -> int:
        """Number of numbers."""
        return int(self.symbol.numel())


@dataclass(frozen=True, eq=False)
class Task:
    """Function that computes new values of fields from fields.

    Attributes:
        name: C identifier.
        path: Name of the event in the closed loop.
        text: Description.
        period, offset: Ticks between two calls, and first tick; period 0 for a single call.
        function: (time, read fields) -> (written fields).
        reads, writes: Fields that the function reads and writes.
        continual: Whether it is called at every tick and decides itself whether to act.
    """

    name: str
    path: str
    text: str
    period: int
    offset: int
    function: ca.Function
    reads: tuple[Field, ...]
    writes: tuple[Field, ...]
    continual: bool = False

    def is_due(self, tick: int) -> bool:
        """Whether the task is called at a tick."""
        if tick < self.offset:
            return False
        return tick == self.offset if not self.period else (tick - self.offset) % self.period == 0


@dataclass(frozen=True)
class OnboardSoftware:
    """Onboard software of a scenario, called once per tick.

    Attributes:
        name: C prefix of all names.
        title: Name of the scenario.
        tick: Time between two calls [s].
        fields: All fields: inputs first, then states, then commands.
        flow: Task that integrates states between instants over one tick; None if there are none.
        conditions: Tasks evaluated in each tick before the others.
        tasks: Tasks in their order at one instant; detections follow the tasks that write their inputs.
        allocation: Commands of wheels and thrusters, at the end of each tick and after transitions; None if
            there are none.
        entries: Phase transitions, which a mode manager calls.
        output: Task that computes commands from states.
        sampling: Periods and first instants of the sensors [s].
        plant_side: Parts of the scenario's software that stay in the plant, each with the reason.
    """

    name: str
    title: str
    tick: Fraction
    fields: tuple[Field, ...]
    flow: Task | None
    conditions: tuple[Task, ...]
    tasks: tuple[Task, ...]
    allocation: Task | None
    entries: tuple[Task, ...]
    output: Task
    sampling: tuple[tuple[float, float], ...]
    plant_side: Mapping[str, str]

    def of_role(self, *roles: Role) -> list[Field]:
        """Fields of some roles."""
        return [field for field in self.fields if field.role in roles]

    @property
    def inputs(self) -> list[Field]:
        """Fields that the caller sets."""
        return [field for role in INPUTS for field in self.of_role(role)]

    @property
    def states(self) -> list[Field]:
        """Fields that the software stores."""
        return self.of_role("state")

    @property
    def commands(self) -> list[Field]:
        """Fields that the software returns."""
        return self.of_role("command")

    @functools.cached_property
    def functions(self) -> list[Task]:
        """All functions, each listed once."""
        flow, allocation = ([] if one is None else [one] for one in (self.flow, self.allocation))
        return [*flow, *self.conditions, *self.tasks, *allocation, *self.entries, self.output]

    @property
    def detections(self) -> list[Task]:
        """Tasks that are called at every tick."""
        return [task for task in self.tasks if task.continual]

    def time(self, tick: int) -> float:
        """Time of a tick [s]."""
        return float(tick) * float(self.tick.numerator) / float(self.tick.denominator)

    @functools.cached_property
    def cycle(self) -> int:
        """Ticks after which the calls repeat."""
        return math.lcm(*(task.period for task in self.tasks if task.period), 1)

    def is_busy(self, tick: int) -> bool:
        """Whether a task is due at a tick."""
        return any(task.is_due(tick) for task in self.tasks if not task.continual)


def common_tick(times: Sequence[float]) -> Fraction:
    """Largest time [s] of which all times are multiples.

    Args:
        times: Periods and offsets [s].

    Raises:
        ValueError: If there is none above 1 microsecond.
    """
    tick = Fraction(0)
    for time in times:
        exact = Fraction(time).limit_denominator(1_000_000)
        if abs(float(exact) - time) > 1e-12 * max(time, 1.0):
            raise ValueError(f"found {time!r} s, allowed: a fraction of whole numbers up to 1000000")
        tick = Fraction(
            math.gcd(tick.numerator * exact.denominator, exact.numerator * tick.denominator),
            tick.denominator * exact.denominator,
        )
    if tick < Fraction(1, 1_000_000):
        raise ValueError(f"found a common divisor of {float(tick):.3g} s, allowed: at least 1e-6 s")
    return tick
