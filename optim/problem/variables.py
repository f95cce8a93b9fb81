"""Free numbers of a scenario, and the unit cube that optimisers see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from optim.problem.scenario_numbers import find_numbers
from spacerobot.common.arrays import Array
from spacerobot.scenario.tuning import DesignVariable
from spacerobot.scene import Scene

NEAR_BOUND = 1e-3  # of the unit cube: nearer counts as being there


@dataclass(frozen=True)
class Variables:
    """k free numbers with bounds; every array has shape (k,) and is in the scenario's units.

    Attributes:
        names: Names of the variables.
        paths: Dotted paths of the numbers that each variable sets.
        lower, upper: Bounds.
        log: Whether equal ratios count as equal distances.
        start: Values of the scenario, clipped to the bounds; if a variable sets several numbers, their mean,
            on a log scale the geometric one.
    """

    names: tuple[str, ...]
    paths: tuple[tuple[str, ...], ...]
    lower: Array
    upper: Array
    log: np.typing.NDArray[np.bool_]
    start: Array

    def __len__(self) -> int:
        return len(self.names)

    @property
    def all_paths(self) -> tuple[str, ...]:
        """Paths of all variables, one after the other."""
        return tuple(path for paths in self.paths for path in paths)

    @property
    def periods(self) -> tuple[str, ...]:
        """Names of variables that set a period; objectives may jump where instants change places."""
        pairs = zip(self.names, self.paths, strict=True)
        return tuple(name for name, paths in pairs if any(path.endswith(".period") for path in paths))

    def values(self, u: Array) -> Array:
        """Values of points u (..., k) of the unit cube."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(self.log, self.upper / np.where(self.log, self.lower, 1.0), 1.0)
            range_values = np.where(
                self.log, self.lower * ratio ** np.asarray(u), self.lower + (self.upper - self.lower) * u
            )
        return np.asarray(range_values, dtype=np.float64)

    def unit(self, values: Array) -> Array:
        """Points of the unit cube with some values (..., k)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            logs = np.log(values / self.lower) / np.log(self.upper / self.lower)
        linear = (values - self.lower) / (self.upper - self.lower)
        return np.asarray(np.where(self.log, logs, linear), dtype=np.float64)

    def slope(self, u: Array) -> Array:
        """Derivative of each value with respect to its coordinate in the unit cube (k,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            logs = self.values(u) * np.log(self.upper / self.lower)
        return np.asarray(np.where(self.log, logs, self.upper - self.lower), dtype=np.float64)

    def as_changes(self, values: Array) -> dict[str, float]:
        """Values (k,) by dotted path."""
        return {path: float(v) for v, paths in zip(values, self.paths, strict=True) for path in paths}

    def as_mapping(self, values: Array) -> dict[str, float]:
        """Values (k,) by name."""
        return {name: float(v) for name, v in zip(self.names, values, strict=True)}


def variables_of(
    scene: Scene, named: Mapping[str, DesignVariable], section: str = "tuning.variables"
) -> Variables:
    """Variables of a section.

    Args:
        scene: Scene with the section's changes.
        named: Variables by name.
        section: Dotted path of the section.

    Raises:
        ScenarioError: If a path is not in the scenario, is no number, or belongs to two variables.
    """
    numbers_by_name = find_numbers(scene, {name: variable.paths for name, variable in named.items()}, section)
    paths, start = [], []
    for name, variable in named.items():
        values = [number.value for number in numbers_by_name[name]]
        log = variable.scale == "log" and min(values) > 0
        mean = float(np.exp(np.mean(np.log(values)))) if log else float(np.mean(values))
        paths.append(tuple(number.path for number in numbers_by_name[name]))
        start.append(min(max(mean, variable.lower), variable.upper))
    return Variables(
        tuple(named),
        tuple(paths),
        np.array([v.lower for v in named.values()]),
        np.array([v.upper for v in named.values()]),
        np.array([v.scale == "log" for v in named.values()]),
        np.array(start),
    )


def at_bound(names: Sequence[str], u: Array) -> dict[str, str]:
    """Variables at or beyond a bound at a point u (k,), each with a text such as ``at its lower bound``."""
    bounds_reached = {}
    for name, x in zip(names, u, strict=True):
        if not NEAR_BOUND < x < 1 - NEAR_BOUND:
            which = "lower" if x <= NEAR_BOUND else "upper"
            how = "at" if -NEAR_BOUND <= x <= 1 + NEAR_BOUND else "below" if x < 0 else "above"
            bounds_reached[name] = f"{how} its {which} bound"
    return bounds_reached
