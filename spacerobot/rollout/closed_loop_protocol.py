"""Interface of a closed loop to rollouts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import casadi as ca

from spacerobot.arrays import Array as Array
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
        """To whom it happens, such as ``left``."""

    @property
    def sets(self) -> tuple[tuple[int, bool], ...]:
        """Switches that it sets: positions in ``switches``, and whether each is on afterwards."""

    @property
    def ends(self) -> bool:
        """Whether the rollout is over with it."""

    @property
    def kink(self) -> bool:
        """Whether it only marks where a law is not smooth: neither state nor rate jumps there."""

    @property
    def gap(self) -> bool:
        """Whether its guard is minus a gap between two bodies, and ``guards`` bounds the gap's rate."""

    @property
    def clock(self) -> bool:
        """Whether its guard is time less an instant that events alone change."""

    @property
    def silent(self) -> bool:
        """Whether it is not recorded."""

    @property
    def routine(self) -> bool:
        """Whether batches do not record it."""

    @property
    def quantised(self) -> bool:
        """Whether what it updates has steps, which derivatives do not see."""


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
        """One name for each entry of x."""


class ClosedLoopFunctions(LoopParameters, Protocol):
    """A closed loop as SX functions without free variables.

    The state is x = (q, v, z): Pinocchio's configuration and velocity, and the states of controllers.

    Where it has events, its motion is hybrid: smooth between them, by switches that are constant there. What
    an event remembers (when it was, what was measured) is a state whose derivative is zero.
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
        """Places in c of the times [s] at which the dynamics jump.

        The dynamics tell by ``t < c[place]`` on which side of a jump they are, and use these entries for
        nothing else: a rollout, whose steps never cross a jump, writes plus infinity there before the jump
        and minus infinity after it.
        """

    @property
    def switches(self) -> tuple[int, ...]:
        """Places in c of the switches, 1 (on) or 0 (off); ``setup`` gives their first values as constants."""

    @property
    def events(self) -> Sequence[EventRule]:
        """The events; ``guards`` and ``update`` are not read where there are none."""

    @property
    def fine(self) -> tuple[tuple[int, float, float], ...]:
        """Positions in ``switches``, the longest step [s] while that switch is on, and a window.

        The longest step may be infinite: that of the rollout. The window is in longest steps. Within it,
        steps grow behind the instant at which the switch is turned on, and shrink to that at which it is
        turned off; zero if the law is smooth up to both.
        """

    @property
    def tables(self) -> Sequence[WindowTable]:
        """Tables in c, whose windows a rollout fills; the functions see no other of their entries."""

    @property
    def rows(self) -> ca.Function:
        """``(t, x, c) -> (row)``: row of each cursor; where there are tables, else it is not read.

        A row changes at jumps and events alone. An event's ``update`` sees what was shown before it.
        """

    @property
    def noise(self) -> Sequence[NoiseTable]:
        """Random numbers, one rule after the other, into which tables have windows."""

    @property
    def guards(self) -> ca.Function:
        """``(t, x, c, xdot) -> (g, rate, speed)``: one guard for each event, and its rate along xdot.

        Each event whose guard is minus a gap has a speed [m/s]: the gap closes no faster, whatever xdot.

        An event fires where its guard is above zero. One that is not armed has a guard of minus infinity
        and a rate of zero; whether it is armed depends on switches alone. ``xdot`` serves the rate only.
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
