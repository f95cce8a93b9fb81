"""Smallest stability margins over uncertain parameters, by exact gradients from several starts.

The minimum over several loops of their margins is minimised over the parameters. A local minimum of it is a
local minimum of one loop's margin, which is smooth there, so that bounded quasi-Newton descents (L-BFGS-B)
converge to it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from optim.problem.scene_recipe import changed_scene, tuning_of
from optim.problem.variables import variables_of
from spacerobot.closedloop.break_points import matching_points
from spacerobot.common.arrays import Array
from spacerobot.common.errors import DivergedError, ScenarioError, SpaceRobotError, near_names
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Table
from spacerobot.common.tabular import Tabular
from spacerobot.linear.instants import InstantNames, as_instants
from spacerobot.linear.margin_gradients import MARGINS, MarginValue, ParametricLinearisation
from spacerobot.scene import Scene, build_scene, to_scene
from spacerobot.simulation import Backend, Progress

STARTS = 4
"""Number of descents at each instant: from the best of the nominal point, corners and a Sobol' sequence."""
CORNERS = 4
"""Maximum number of parameters whose corners are all evaluated."""
INFINITE = 1e3
"""Finite value that stands for an infinite margin in the descents."""


@dataclass(frozen=True)
class WorstMargin:
    """Minimum stability margin at an instant.

    Attributes:
        label, time_s: Label and time [s] of the instant.
        nominal, nominal_loop: Minimum margin at the scenario's own values, and its break point.
        value, loop: Minimum margin that was found over the parameters, and its break point; negative if the
            closed loop is unstable.
        parameters: Values of the variables at the minimum, by name.
        simulated: The loop's margin there at the state of a simulation with these parameters; NaN if it does
            not reach the instant. The search keeps the nominal simulation's state.
    """

    label: str
    time_s: float
    nominal: float
    nominal_loop: str
    value: float
    loop: str
    parameters: Mapping[str, float]
    simulated: float


@dataclass(frozen=True)
class WorstMargins(Tabular):
    """Smallest margins over uncertain parameters, one for each instant.

    Attributes:
        margin, unit: Kind and unit of the margin; ``gain_down`` is negated.
        cases: Smallest margin at each instant.
        evaluations: Linearisations with gradients that the search took.
    """

    margin: str
    unit: str
    cases: tuple[WorstMargin, ...]
    evaluations: int

    def __repr__(self) -> str:
        """Smallest margin over all instants, in one line."""
        least = min(self.cases, key=lambda case: case.value)
        return f"<WorstMargins: {self.margin} {least.value:.4g} {self.unit} at {least.label}, {least.loop}>"

    def rows(self) -> list[tuple[str, str]]:
        """Outcome as text, by instant."""
        return [
            (
                case.label,
                f"nominal {case.nominal:.4g} ({case.nominal_loop}); worst {case.value:.4g} ({case.loop}) at "
                + ", ".join(f"{name} {value:.5g}" for name, value in case.parameters.items())
                + f"; simulated there {case.simulated:.4g}",
            )
            for case in self.cases
        ]

    def content(self) -> list[Table]:
        """Table of the nominal and the smallest margin at each instant."""
        return [Table.of_pairs(f"least {self.margin} margins [{self.unit}]", self.rows())]


def worst_margins(
    scene: Scene | StrPath,
    at: InstantNames = 0.0,
    *,
    margin: str = "disk",
    loops: str = "*",
    backend: Backend = "auto",
    progress: Progress | None = None,
) -> WorstMargins:
    """Smallest margin of a scene's loops over uncertain parameters, at each instant.

    Args:
        scene: The scene, or the name or file of its scenario; its tuning section's variables are the
            uncertain parameters.
        at: Instants, as in :func:`spacerobot.linearise`.
        margin: ``disk``, ``gain_up``, ``gain_down``, ``phase`` or ``delay``.
        loops: Break points, ``torque/*``.
        backend, progress: See :func:`spacerobot.simulate`.

    Raises:
        DivergedError: If the nominal simulation does not reach an instant.
        ScenarioError: If a variable's path or an instant does not exist.
        SpaceRobotError: If there is no such margin or loop.
    """
    if margin not in MARGINS:
        raise SpaceRobotError(f"no margin '{margin}', {near_names(margin, MARGINS)}")
    tell, at = progress or (lambda _: None), as_instants(at)
    scene = changed_scene(to_scene(scene))
    free = variables_of(scene, tuning_of(scene).variables)
    # refuse a range that no scenario may have, such as one of negative masses
    for end, u in (("lower", 0.0), ("upper", 1.0)):
        try:
            build_scene(
                scene.scenario, free.as_changes(free.values(np.full(len(free), u))), source=scene.source
            )
        except ScenarioError as fault:
            message = f"the {end} end of the range is not allowed: {fault.message}"
            raise scene.error(message, fault.where) from None
    linear = ParametricLinearisation.of(scene, at, free.paths, backend, tell, loops)
    names = matching_points(linear.lineariser.perturbed.inputs, loops)
    cases, count, size = list[WorstMargin](), 0, len(free)
    points = [np.clip(free.unit(free.start), 0, 1)]
    if size <= CORNERS:
        points += [np.array(corner) for corner in itertools.product((0.0, 1.0), repeat=size)]
    points += list(qmc.Sobol(size, rng=np.random.default_rng(0)).random(2 * STARTS))
    for k, instant in enumerate(linear.instants):
        tell(f"least margins at {instant.label}")

        def least(u: Array, k: int = k) -> MarginValue:
            smallest = linear.sizes(k, free.values(u), margin, names, least=True)
            if not smallest:
                raise SpaceRobotError(f"every loop of {loops} varies in time")
            return smallest[0]

        def function(u: Array, least: Callable[[Array], MarginValue] = least) -> tuple[float, Array]:
            nonlocal count
            count += 1
            margin_value = least(u)
            if not np.isfinite(margin_value.value):
                return INFINITE, np.zeros(size)
            return margin_value.value, margin_value.gradient * free.slope(u)

        # several descents, from the best of all points
        screened = sorted(points, key=lambda u: function(u)[0])[:STARTS]
        box = [(0, 1)] * size
        ended = [minimize(function, u, jac=True, method="L-BFGS-B", bounds=box) for u in screened]
        u = np.clip(min(ended, key=lambda one: one.fun).x, 0, 1)
        nominal, worst = least(points[0]), least(u)
        values = free.values(u)
        changed = build_scene(scene.scenario, free.as_changes(values), source=scene.source)
        try:
            relinearisation = ParametricLinearisation.of(changed, at, [], backend)
        except (DivergedError, ScenarioError):
            simulated = float("nan")
        else:
            (again,) = relinearisation.sizes(k, None, margin, [worst.loop])
            simulated = again.value
        cases.append(
            WorstMargin(
                instant.label,
                instant.time_s,
                nominal.value,
                nominal.loop,
                worst.value,
                worst.loop,
                free.as_mapping(values),
                simulated,
            )
        )
    return WorstMargins(margin, MARGINS[margin], tuple(cases), count)
