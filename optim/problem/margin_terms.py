"""Stability margins as constraints and objective of a tuning problem, with exact derivatives.

The requirement m >= m0 on a margin becomes the constraint g <= 0 with ``g = m0 / m - 1`` for m > m0 and
``g = 1 - m / m0`` otherwise. It is continuously differentiable at m0, tends to -1 for an infinite margin, and
is the relative shortfall below m0. The loop is linearised at the state of the simulation with the same
values, whose derivatives are forward sensitivities. A further state z' = 1 is the time, so that its
sensitivity at an event is that of the event's time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import casadi as ca
import numpy as np

from optim.problem.derived_loop import DerivedLoop, extend, tie
from optim.problem.variables import Variables
from spacerobot.closedloop.break_points import matching_points
from spacerobot.common.arrays import Array
from spacerobot.common.errors import DivergedError, ScenarioError, SpaceRobotError
from spacerobot.linear.instants import instants
from spacerobot.linear.margin_gradients import MARGINS, MarginValue, ParametricLinearisation
from spacerobot.rollout import Rollout, build_rollout, time_grid
from spacerobot.rollout.batch import run_one
from spacerobot.scenario.tuning import MarginRequirement
from spacerobot.scene import Scene
from spacerobot.simulation import Backend

INFINITE = 1e3
"""Finite value that stands for an infinite margin in the objective."""


@dataclass(frozen=True)
class MarginRow:
    """A margin of one loop at one instant.

    Attributes:
        requirement: Requirement on the margin.
        instant, label: Number of the instant, and its label: ``2.5 s``, or ``captured, after``.
        loop: Break point.
    """

    requirement: MarginRequirement
    instant: int
    label: str
    loop: str

    @property
    def name(self) -> str:
        """Kind, loop and instant, in one line."""
        return f"{self.requirement.kind} margin of {self.loop} at {self.label}"

    def text(self, value: float) -> str:
        """A value with its unit and the required minimum, as text."""
        unit, least = MARGINS[self.requirement.kind], self.requirement.least
        value_text = f"{value:.6g}" + ("" if unit == "1" else f" {unit}")
        return value_text if least is None else f"{value_text}, at least {least:g}"


@dataclass(frozen=True)
class MarginTerms:
    """Margins that a tuning problem requires or weighs.

    Attributes:
        rows: Margins that are computed.
        at: Times [s] and events.
        linear: Linearised closed loop as a function of the variables.
        simulation: Rollout with the time as its last state, its parameters the variables; None where all
            instants are the start, whose state follows the variables by itself.
    """

    rows: tuple[MarginRow, ...]
    at: tuple[float | str, ...]
    linear: ParametricLinearisation
    simulation: Rollout | None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the constraints."""
        return tuple(row.name for row in self.rows if row.requirement.least is not None)

    @property
    def fingerprint(self) -> str:
        """Text that identifies the margins; it differs for different margins."""
        return repr((self.rows, None if self.simulation is None else self.simulation.grid))

    def values(self, values: Array, *, slopes: bool = False) -> list[MarginValue]:
        """Margins at values (k,) of the variables, and with ``slopes`` their derivatives by the variables.

        All are NaN if the simulation does not reach an instant.
        """
        lost = MarginValue("", np.nan, np.full(len(values), np.nan))
        margins = list[MarginValue]()
        try:
            linear = self._following(values, slopes=slopes)
            for _, group in groupby(self.rows, key=lambda row: (id(row.requirement), row.instant)):
                rows_of_group = list(group)
                kind, loops = rows_of_group[0].requirement.kind, [row.loop for row in rows_of_group]
                sizes = linear.sizes(rows_of_group[0].instant, values, kind, loops, slopes=slopes)
                margin_by_loop = {one.loop: one for one in sizes}
                margins += [margin_by_loop.get(loop, lost) for loop in loops]
        except (DivergedError, ScenarioError):  # an event that does not happen, a delay that is too long
            return [lost] * len(self.rows)
        return margins

    def constraints(self, values: Array) -> tuple[Array, Array]:
        """Constraints (..., m), and their derivatives by the margins, at values (..., n) of all margins."""
        least = [row.requirement.least for row in self.rows]
        limited = [i for i, one in enumerate(least) if one is not None]
        m, m0 = values[..., limited], np.array([least[i] for i in limited], dtype=float)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            above = m > m0
            g = np.where(above, m0 / m - 1, 1 - m / m0)
            return np.where(np.isnan(m), np.nan, g), np.where(above, -m0 / m**2, -1 / m0)

    def penalty(self, values: Array) -> tuple[Array, Array]:
        """Addition (...) to the objective, and its derivatives by the margins, at values (..., n) of them."""
        weights = -np.array([row.requirement.weight or 0.0 for row in self.rows])
        weighted_rows = weights != 0
        return np.minimum(values[..., weighted_rows], INFINITE) @ weights[weighted_rows], weights

    def _following(self, values: Array, *, slopes: bool) -> ParametricLinearisation:
        """Linearisation about the simulation with these values of the variables."""
        linear, simulation = self.linear, self.simulation
        if simulation is None:
            return linear
        loop = linear.lineariser.loop
        p = loop.parameter_values.astype(float)
        for places, value in zip(linear.places, values, strict=True):
            p[list(places)] = value
        names = simulation.loop.parameter_paths[: len(values)]  # the variables, tied
        parameter_values = simulation.values(dict(zip(names, values, strict=True)))
        moved = replace(loop, parameter_values=p)
        run = replace(simulation, loop=DerivedLoop.of(simulation.loop, parameter_values=parameter_values))
        operating_points = tuple(instants(run, moved, self.at))
        linear = replace(linear, instants=operating_points)
        return replace(linear, motion=self._motion(parameter_values, names)) if slopes else linear

    def _motion(self, p: Array, names: Sequence[str]) -> tuple[Array, ...]:
        """Derivatives (nx + 1, k) of the state and the time of each instant by the variables."""
        rollout, derivatives = self.simulation, list[Array]()
        assert rollout is not None
        engine = rollout.engines.sensitivity(tuple(rollout.indices(names)), ())
        state_derivatives = slice(rollout.kernel.nx, 2 * rollout.kernel.nx)  # derivatives follow the state
        rows, rules = [np.hstack([p, along]) for along in np.eye(len(names))], rollout.loop.events
        runs = [run_one(engine, rollout.grid, row, False) for row in rows if set(map(type, self.at)) & {str}]
        for place in self.at:
            if isinstance(place, str):
                kinds = [
                    {rules[event].kind, rules[event].name} for event in runs[0].log.event[0] if event >= 0
                ]
                first = next(i for i, kind in enumerate(kinds) if place in kind)
                jumps = np.array(
                    [raw.log.jump[0, first, :, state_derivatives] for raw in runs if raw.log.jump is not None]
                )
                derivatives += [jumps[:, side].T for side in (0, 1)]
            elif place == 0:
                derivatives.append(np.zeros((rollout.kernel.nx, len(names))))
            else:
                grid = time_grid(float(place), rollout.grid.step_s, float(place))
                ends = [run_one(engine, grid, row, False).x for row in rows]
                derivatives.append(np.array([x[0, -1, state_derivatives] for x in ends if x is not None]).T)
        return tuple(derivatives)


def build_margin_terms(scene: Scene, free: Variables) -> MarginTerms | None:
    """Margins of a scene's tuning section; None if it names none.

    Args:
        scene: Scene with the changes of its tuning section.
        free: Variables of the problem.

    Raises:
        DivergedError: If the scenario's own simulation does not reach an instant.
        ScenarioError: If there is no such instant or break point, a loop varies in time, so that its margins
            are undefined, or a weight does not belong to one loop at one instant.
    """
    tuning = scene.scenario.tuning
    if tuning is None or not tuning.margins:
        return None
    at = tuple(dict.fromkeys(one.at for one in tuning.margins))
    start_alone = at == (0,)
    backend: Backend = "interpreted" if start_alone else "auto"  # the start needs no rollout
    try:
        linear = ParametricLinearisation.of(scene, at, free.paths, backend)
    except ScenarioError as fault:
        raise scene.error(fault.message, f"tuning.margins, {fault.where}") from None
    numbers, count = dict[float | str, range](), 0
    for place in at:
        numbers[place] = range(count, count + (2 if isinstance(place, str) else 1))
        count = numbers[place].stop
    systems = [linear.system(k) for k in range(count)]
    rows = list[MarginRow]()
    for i, one in enumerate(tuning.margins):
        where, break_points = f"tuning.margins.{i}", linear.lineariser.perturbed.inputs
        try:
            named = matching_points(break_points, one.loops)
        except SpaceRobotError as fault:
            raise scene.error(fault.message, f"{where}.loops") from None
        margin_rows = [
            MarginRow(one, k, systems[k].label, name)
            for k in numbers[one.at]
            for name in named
            if systems[k].is_invariant(name)
        ]
        if not margin_rows:
            message = (
                f"found {one.loops}, whose loops vary in time and have no margins (docs/how_to/margins.md)"
            )
            raise scene.error(message, f"{where}.loops")
        if one.weight is not None and len(margin_rows) > 1:
            message = (
                f"found {len(margin_rows)} margins ({margin_rows[0].name}, ...), "
                "allowed: one, of one loop at one instant"
            )
            raise scene.error(message, f"{where}.weight")
        rows += margin_rows
    simulation = None
    if not start_alone:
        plain = linear.lineariser.rollout("auto", lambda _: None)
        timed = extend(linear.lineariser.loop, ["time"], lambda *_: ca.SX(1))
        tied = tie(timed, dict(zip(free.names, free.paths, strict=True)), list(free.start))
        method = scene.scenario.simulation.method
        grid = plain.grid
        built = build_rollout(tied, duration_s=grid.duration_s, step_s=grid.step_s, method=method)
        simulation = replace(built, grid=grid)
    return MarginTerms(tuple(rows), at, linear, simulation)
