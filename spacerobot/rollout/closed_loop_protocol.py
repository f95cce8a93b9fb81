"""Interface of a closed loop to rollouts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import casadi as ca

from spacerobot.common.arrays import Array as Array
from spacerobot.symbolic import NoiseTable, WindowTable


class EventRule(Protocol):
    """Properties of an event that are known in advance of a rollout."""

    @property
    def name(self) -> str:
        """Name of the event, such as ``left.captured``."""

    @property
    def kind(self) -> str:
        """Kind of event, such as ``captured``."""

    @property
    def who(self) -> str:
        """Robot, grasp or element that the event belongs to, such as ``left``."""

    @property
    def sets(self) -> tuple[tuple[int, bool], ...]:
        """Switches that it sets: positions in ``switches``, and whether each is on afterwards."""

    @property
    def ends(self) -> bool:
        """Whether the event ends the rollout."""

    @property
    def kink(self) -> bool:
        """Whether the event only marks a kink of a law: neither state nor rate jumps there."""

    @property
    def gap(self) -> bool:
        """Whether the guard is minus a gap between two bodies; ``guards`` then bounds the gap's rate."""

    @property
    def clock(self) -> bool:
        """Whether the guard is time minus an instant that only events change."""

    @property
    def silent(self) -> bool:
        """Whether the event is not recorded."""

    @property
    def routine(self) -> bool:
        """Whether batches do not record the event."""

    @property
    def quantised(self) -> bool:
        """Whether the updated values are quantised; derivatives ignore the steps."""


class OutputRule(Protocol):
    """An output variable."""

    @property
    def name(self) -> str:
        """Name of the output."""

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the output besides time."""

    @property
    def labels(self) -> tuple[str, ...]:
        """Along the first of them; empty for joints."""


class LoopParameters(Protocol):
    """Names and numbers of a closed loop."""

    @property
    def parameter_paths(self) -> tuple[str, ...]:
        """Dotted paths of the parameters p."""

    @property
    def parameter_values(self) -> Array:
        """Nominal p, in scenario units."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the entries of x."""


class ClosedLoopFunctions(LoopParameters, Protocol):
    """A closed loop as SX functions without free variables.

    The state is x = (q, v, z): Pinocchio's configuration and velocity, and the states of controllers.

    A closed loop with events is a hybrid system: its motion is smooth between events, while its switches are
    constant. Values that an event stores (its time, a measurement) are states with zero derivative.
    """

    @property
    def nq(self) -> int:
        """Length of q."""

    @property
    def nv(self) -> int:
        """Length of v."""

    @property
    def nz(self) -> int:
        """Length of z."""

    @property
    def jumps(self) -> tuple[int, ...]:
        """Indices in c of the times [s] at which the dynamics jump.

        The dynamics test ``t < c[place]`` to find the side of a jump, and use these entries for nothing else.
        A step of a rollout never crosses a jump: the rollout writes plus infinity there before the jump and
        minus infinity after it.
        """

    @property
    def switches(self) -> tuple[int, ...]:
        """Indices in c of the switches, 1 (on) or 0 (off); ``setup`` sets their initial values."""

    @property
    def events(self) -> Sequence[EventRule]:
        """Events of the loop; ``guards`` and ``update`` are not read if there are none."""

    @property
    def fine(self) -> tuple[tuple[int, float, float], ...]:
        """Triples: index in ``switches``, longest step [s] while that switch is on, and window.

        The longest step may be infinite, which means the step of the rollout. The window is a number of
            longest steps: within it, steps grow after the switch turns on and shrink before it turns off. It
            is zero if the law is smooth up to both instants.
        """

    @property
    def tables(self) -> Sequence[WindowTable]:
        """Tables in c; a rollout copies rows of them into windows, the only entries that functions read."""

    @property
    def rows(self) -> ca.Function:
        """``(t, x, c) -> (row)``: row of each cursor; read only if there are tables.

        A row changes only at jumps and events. An event's ``update`` reads the rows from before the event.
        """

    @property
    def noise(self) -> Sequence[NoiseTable]:
        """Random numbers, one rule after the other, into which tables have windows."""

    @property
    def guards(self) -> ca.Function:
        """``(t, x, c, xdot) -> (g, rate, speed)``: one guard for each event, and its rate along xdot.

        For an event whose guard is minus a gap, speed [m/s] is an upper bound of the gap's closing speed for
        any xdot.

        An event fires where its guard is above zero. An event that is not armed has a guard of minus infinity
        and a rate of zero; arming depends on switches only. ``xdot`` is used for the rate only.
        """

    @property
    def update(self) -> ca.Function:
        """``(t, x, c, e) -> (x)``: state after event e, with the switches in c as they are after it."""

    @property
    def setup(self) -> ca.Function:
        """``(p) -> (x0, c)``: initial state and prepared constants."""

    @property
    def dynamics(self) -> ca.Function:
        """``(t, x, c) -> (xdot)``."""

    @property
    def normalise(self) -> ca.Function:
        """``(x) -> (x)``: puts cos/sin pairs and quaternions back on their unit sphere."""

    @property
    def gaps(self) -> ca.Function:
        """``(p) -> (gap)``: initial gaps in m of the grasps that may begin open."""

    @property
    def max_gaps(self) -> Mapping[str, float]:
        """Greatest gaps allowed in m, by name of the grasp, in the order of ``gaps``."""

    @property
    def outputs(self) -> ca.Function:
        """``(t, x, c) -> (named vectors)``."""

    @property
    def variables(self) -> Sequence[OutputRule]:
        """The outputs as variables, in their order."""
