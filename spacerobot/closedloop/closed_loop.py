"""Closed loop: x' = f(t, x, c), y = h(t, x, c), with all tunable numbers in p."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from spacerobot.closedloop.events import LoopEvent
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.tables import Table
from spacerobot.common.tabular import Tabular
from spacerobot.symbolic import NoiseTable, WindowTable


@dataclass(frozen=True)
class OutputVariable:
    """Output variable of a result.

    Attributes:
        name: Name of the output.
        dims: Dimensions after time: ``tip``, ``body``, ``grasp``, ``joint`` or another one, then ``axis`` for
            a vector.
        unit, text: SI unit, and description.
        labels: Labels along the first dimension; empty for joints, for outputs without a dimension, and if
            there are none.
        plotted: Whether pages plot it over time.
    """

    name: str
    dims: tuple[str, ...]
    unit: str
    text: str
    labels: tuple[str, ...] = ()
    plotted: bool = True


@dataclass(frozen=True)
class ClosedLoop(Tabular):
    """Robots, object, grasps and controllers as one system of differential equations.

    Attributes:
        parameter_paths: Dotted paths of p: every number of the scenario that the closed loop depends on.
        parameter_values: Their nominal values (np,), in the scenario's units.
        state_names: Names of x = (q, v, z): configuration and velocity in Pinocchio's coordinates, then the
            states of controllers and the works of the energy balance.
        nq, nv, nz: Sizes of q, v and z.
        setup: (p) -> (x0, c): initial state and prepared constants, once for each rollout.
        dynamics: (t, x, c) -> (xdot). Smooth in t between jumps; at a jump it has the value from after it.
        normalise: (x) -> (x): cosine-sine pairs and quaternions scaled to unit length.
        outputs: (t, x, c) -> named column vectors, those of ``variables``.
        gaps: (p) -> (gap): initial distances of tip and mating frame [m], for the grasps that no base closes.
        max_gaps: Maximum allowed gaps [m], by the grasp's path, in the same order.
        variables: Descriptions of the outputs, in their order.
        works: Names of the works in the energy balance, with signs: 1 for work put in, -1 for work taken out.
        outside: Reason, in words, why momentum is not conserved; empty if the outputs ``impulse_linear`` and
            ``impulse_angular`` record all external impulses.
        jumps: Indices in c of the times [s] at which the dynamics jump: where a reference ends or two pieces
            of it meet. They are only compared with t.
        switches: Indices in c of the switches: numbers 1 or 0, constant between events.
        events: Properties of the events.
        guards: (t, x, c, xdot) -> (g, rate, speed): event i fires where g[i] > 0; minus infinity while not
            armed. The rates are those of g along xdot, the speeds upper bounds of the rates of gaps.
        update: (t, x, c, e) -> (x): state after event number e, with the switches in c as after the event.
        fine: Indices in ``switches``, each with the longest step [s] while that switch is 1, and the number
            of such steps over which steps grow at first and shrink at last.
        tables: Tables in c, each with a window of one row. The functions read only windows; ``setup`` fills
            them with the first rows, rollouts and :meth:`at` with the present ones.
        rows: (t, x, c) -> (row): present row of each cursor, which changes only at jumps and events.
        noise: Random numbers of sensors, which a rollout draws by the parameters that they name.
        switch_names: Names of the switches, in their order.
    """

    parameter_paths: tuple[str, ...]
    parameter_values: Array
    state_names: tuple[str, ...]
    nq: int
    nv: int
    nz: int
    setup: ca.Function
    dynamics: ca.Function
    normalise: ca.Function
    outputs: ca.Function
    gaps: ca.Function
    max_gaps: Mapping[str, float]
    variables: tuple[OutputVariable, ...]
    works: Mapping[str, int]
    outside: tuple[str, ...]
    jumps: tuple[int, ...]
    switches: tuple[int, ...]
    events: tuple[LoopEvent, ...]
    guards: ca.Function
    update: ca.Function
    fine: tuple[tuple[int, float, float], ...]
    tables: tuple[WindowTable, ...]
    rows: ca.Function
    noise: tuple[NoiseTable, ...] = ()
    switch_names: tuple[str, ...] = ()

    def at(self, t: Any, x: Any, c: Any) -> Any:
        """Constants (nc x 1) with the rows of tables in their windows that hold at an instant.

        Args:
            t, x, c: Time [s], state and constants, numbers or symbols.
        """
        rows = self.rows(t, x, c)
        constants = type(rows)(c)
        for table in self.tables:
            if table.noise >= 0:
                continue
            block = ca.reshape(constants[table.first : table.window], table.width, table.count)
            row = block[:, 0]
            for k in range(1, table.count):
                row = ca.if_else(rows[table.cursor] == k, block[:, k], row)
            constants[table.window : table.window + table.width] = row
        return constants

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times of the jumps [s] at the nominal parameters, rising."""
        c = self.setup(self.parameter_values)[1].full().ravel()
        return tuple(sorted({float(c[place]) for place in self.jumps}))

    def __repr__(self) -> str:
        """Sizes, in one line."""
        return (
            f"<ClosedLoop: {self.nx} states ({self.nq} q, {self.nv} v, {self.nz} z), "
            f"{len(self.parameter_paths)} parameters, {len(self.variables)} outputs>"
        )

    def content(self) -> list[Table]:
        """Table of the numbers of states and parameters, and the names of the outputs."""
        rows = [("states", f"{self.nx}: {self.nq} of positions, {self.nv} of velocities, {self.nz} others")]
        rows += [("parameters", str(len(self.parameter_paths)))]
        rows += [("outputs", ", ".join(variable.name for variable in self.variables))]
        return [Table.of_pairs("Closed loop", rows)]

    @property
    def nx(self) -> int:
        """Size of the state."""
        return self.nq + self.nv + self.nz

    def index(self, path: str) -> int:
        """Place of a parameter in p.

        Raises:
            ScenarioError: If the closed loop does not depend on it; the near names are listed.
        """
        try:
            return self.parameter_paths.index(path)
        except ValueError:
            hint = near_names(path, self.parameter_paths)
            raise ScenarioError(f"the closed loop does not depend on it; {hint}", where=path) from None

    def parameters(self, changes: Mapping[str, float] | None = None) -> Array:
        """Parameter vector p (np,) with some values changed.

        Raises:
            ScenarioError: For a path the closed loop does not depend on.
        """
        values = self.parameter_values.copy()
        for path, value in (changes or {}).items():
            values[self.index(path)] = value
        return values
