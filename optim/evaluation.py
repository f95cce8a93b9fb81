"""Quantities of a scene at many values of its parameters, and their exact gradients."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self, TypedDict, Unpack

import casadi as ca
import numpy as np
import numpy.typing as npt
import xarray as xr

from optim.problem.quantity_measures import (
    context_of,
    measures_of,
    table_values,
    with_added_states,
)
from spacerobot.closedloop.loop_cache import SceneContent, cached_closed_loop
from spacerobot.common.arrays import Array
from spacerobot.common.datasets import read_dataset, write_dataset
from spacerobot.common.errors import ResultError, ScenarioError, SpaceRobotError
from spacerobot.common.files import StrPath
from spacerobot.common.section import numbers
from spacerobot.common.tables import Table
from spacerobot.common.tabular import Tabular
from spacerobot.quantities import Quantity, find_quantity
from spacerobot.rollout import Measure, Measures, build_rollout
from spacerobot.rollout.build import Backend, Options
from spacerobot.scenario.load import to_document
from spacerobot.scenario.paths import expand, get
from spacerobot.scenario.units import limits_at, unit_at
from spacerobot.scene import Scene, to_scene
from spacerobot.updates import UpdatedRollout, UpdatedScene
from spacerobot.updates.scheme import update_schemes

JITTER_FREQUENCY_HZ = 1.0
"""Corner frequency of the high pass of the quantity ``jitter``, as campaigns have it by default."""

COMPILER_SETTINGS = ("SPACEROBOT_COMPILER", "SPACEROBOT_COMPILER_FLAGS", "CXX")
"""Environment variables that decide how a rollout is compiled."""

MOST_PREPARED = 8
"""Number of rollouts that stay ready for further calls of :func:`gradient` and :func:`batch`."""


@dataclass(frozen=True)
class DatasetResult(Tabular):
    """Base class of results that are one netCDF file.

    Attributes:
        data: Content of the file.
        needed: Variable without which a file holds no such result.
    """

    needed: ClassVar[str]
    data: xr.Dataset

    def save(self, path: StrPath) -> None:
        """Write it to a netCDF file, whose name ends in ``.nc``.

        Raises:
            ResultError: If the name ends otherwise, or the file cannot be written.
        """
        suffix = Path(path).suffix
        if suffix != ".nc":
            problem = f"found the suffix {suffix!r}" if suffix else "found no suffix"
            raise ResultError(f"{problem}, allowed: .nc", source=Path(path))
        write_dataset(self.data, path)

    @classmethod
    def load(cls, path: StrPath) -> Self:
        """Read what :meth:`save` wrote.

        Raises:
            ResultError: If it cannot be read.
        """
        data = read_dataset(path)
        if cls.needed not in data:
            raise ResultError(f"holds no {cls.needed!r}, so it is not such a result", source=Path(path))
        return cls(data)


@dataclass(frozen=True)
class GradientResult(DatasetResult):
    """Quantities of one simulation, and their exact derivatives.

    Attributes:
        data: ``value`` (quantity) and ``gradient`` (quantity, parameter), with units; the parameters' own
            values are ``parameter_value`` (parameter).
    """

    needed: ClassVar[str] = "gradient"

    @property
    def values(self) -> Array:
        """Values (n,) of the quantities, in the order in which they were named."""
        return np.asarray(self.data["value"].values)

    @property
    def gradients(self) -> Array:
        """Gradients (n, k) of the quantities with respect to the parameters."""
        return np.asarray(self.data["gradient"].values)

    @property
    def status(self) -> str:
        """``exact``, or why the gradient may not hold; see :class:`spacerobot.rollout.Gradient`."""
        return str(self.data.attrs["status"])

    def __repr__(self) -> str:
        """Quantities, number of parameters and status, in one line."""
        names = ", ".join(map(str, self.data.quantity.values))
        count = self.data.sizes["parameter"]
        return f"<GradientResult {names} by {count} parameter{'' if count == 1 else 's'}: {self.status}>"

    def content(self) -> list[Table]:
        """Status, values and derivatives."""
        rows = [("status", self.status)]
        for name in self.data.quantity.values:
            entry = self.data.sel(quantity=name)
            rows.append((str(name), f"{float(entry.value):.6g} {entry.unit.item()}"))
            for path, slope in zip(self.data.parameter.values, entry.gradient.values, strict=True):
                rows.append((f"d {name} / d {path}", f"{slope:.6g}"))
        return [Table.of_pairs("Gradient", rows)]


@dataclass(frozen=True)
class BatchResult(DatasetResult):
    """Quantities of many simulations.

    Attributes:
        data: One variable for each quantity, (sample, ``<quantity>_of``), with units; ``diverged_at``
            (sample) [s], NaN where a simulation reached its end. The values of each parameter are a
            coordinate along ``sample``, under its dotted path. Where one parameter varies, its path replaces
            ``sample`` as the dimension, so that xarray's ``plot`` draws against it:
            ``data.NAME.plot(hue="NAME_of")``.
    """

    needed: ClassVar[str] = "diverged_at"

    def __repr__(self) -> str:
        """Number of simulations, and quantities, in one line."""
        lost = int(np.isfinite(self.data.diverged_at.values).sum())
        count = self.data.diverged_at.size
        return f"<BatchResult of {count} simulation{'' if count == 1 else 's'}, {lost} diverged>"

    def content(self) -> list[Table]:
        """Table of the minimum, median and maximum of each quantity."""
        rows = []
        for name, variable in self.data.data_vars.items():
            if f"{name}_of" in variable.dims:
                good = variable.values[np.isfinite(variable.values)]
                if good.size:
                    numbers = " .. ".join(f"{value:.4g}" for value in np.quantile(good, [0, 0.5, 1]))
                    rows.append((f"{name} [{variable.attrs['units']}]", numbers))
        lost = int(np.isfinite(self.data.diverged_at.values).sum())
        title = f"{self.data.diverged_at.size} simulations, {lost} diverged: minimum .. median .. maximum"
        return [Table.of_pairs(title, rows)]


def load_evaluation(path: StrPath) -> GradientResult | BatchResult:
    """Read what :meth:`GradientResult.save` or :meth:`BatchResult.save` wrote.

    Raises:
        ResultError: If it cannot be read.
    """
    if GradientResult.needed in read_dataset(path):
        return GradientResult.load(path)
    return BatchResult.load(path)


def gradient(
    scene: Scene | StrPath,
    quantities: str | Sequence[str],
    parameters: Sequence[str],
    *,
    at: Mapping[str, float] | None = None,
    backend: Backend = "auto",
) -> GradientResult:
    """Exact derivatives of quantities of a simulation, by the discrete adjoint through all events.

    Further calls for the same scene, quantities and parameters reuse what the first one built and compiled.

    Args:
        scene: The scene, or the name or file of its scenario.
        quantities: Names of registered quantities, such as ``tip_error_rms``; the components of each (tips,
            robots) are combined as :attr:`spacerobot.quantities.Quantity.total` says.
        parameters: Dotted paths of the scenario's numbers to differentiate with respect to, as
            :func:`parameter_paths` takes them.
        at: Values by dotted path at which to differentiate; other numbers have the scene's values. The step
            stays the one chosen for the scene's values.
        backend: ``auto``, ``compiled`` or ``interpreted``.

    Returns:
        GradientResult: Values and gradients; its status says where the gradient may not hold.

    Raises:
        ScenarioError: If a quantity does not apply to the scene, or the scene does not depend on a parameter.
        SpaceRobotError: If there is no such quantity or parameter.
        DivergedError: If no step keeps to the tolerance.
    """
    scene, chosen = to_scene(scene), find_quantities(quantities)
    if at is not None and not isinstance(at, Mapping):
        raise ScenarioError(f"found {type(at).__name__}, allowed: values by dotted path", where="at")
    values = dict(at or {})
    parameters = parameter_paths(scene, parameters)
    if not parameters:
        raise ScenarioError("found none, allowed: dotted paths of numbers", where="parameters")
    # each quantity once, and once more with half the step; other values are asked for again and again
    rollouts = 3 * len(chosen) if at is None else None
    vary = tuple(dict.fromkeys((*parameters, *values)))
    rollout, _ = _prepared(scene, chosen, vary, backend, rollouts)
    derivatives = rollout.value_and_gradient(values, wrt=parameters)
    names = [each.name for each in chosen]
    data = xr.Dataset(
        {
            "value": ("quantity", [float(derivatives.costs[name]) for name in names]),
            "gradient": (
                ("quantity", "parameter"),
                np.array([derivatives.gradients[name] for name in names]),
            ),
            "parameter_value": ("parameter", rollout.values(values)[rollout.indices(parameters)]),
        },
        {
            "quantity": names,
            "parameter": list(parameters),
            "unit": ("quantity", [each.unit_in(scene) for each in chosen]),
        },
    )
    return GradientResult(data.assign_attrs(status=derivatives.status[0], scenario=scene.scenario.name))


def batch(
    scene: Scene | StrPath,
    quantities: str | Sequence[str],
    values: Mapping[str, npt.ArrayLike],
    *,
    backend: Backend = "auto",
    threads: int | None = None,
) -> BatchResult:
    """Quantities of many simulations that differ in some of the scenario's numbers.

    Further calls for the same scene, quantities and parameters reuse what the first one built and compiled.

    Args:
        scene: The scene, or the name or file of its scenario.
        quantities: Names of registered quantities.
        values: Values (N,) of each parameter that varies, by dotted path.
        backend: ``auto``, ``compiled`` or ``interpreted``.
        threads: Number of threads; one for each usable core if None. Results do not depend on it.

    Returns:
        BatchResult: N samples; NaN where a simulation diverged or a quantity is undefined (the time of a
            missed capture).

    Raises:
        ScenarioError: If a quantity does not apply to the scene.
        SpaceRobotError: If there is no such quantity or parameter, the values differ in number, or a value
            is outside the limits of its key.
    """
    scene, chosen = to_scene(scene), find_quantities(quantities)
    columns = {path: _column(path, column) for path, column in values.items()}
    lengths = sorted({len(column) for column in columns.values()})
    if len(lengths) != 1:
        found = f"lists of {' and '.join(map(str, lengths))} numbers" if lengths else "no parameter"
        allowed = "a list of numbers for each parameter, all of the same length"
        raise ScenarioError(f"found {found}, allowed: {allowed}", where="values")
    (count,) = lengths
    if update_schemes(scene):  # whose processes, such as planners, end with it
        rollout, labels = build_quantity_rollout(scene, chosen, tuple(columns), backend, rollouts=count)
    else:
        rollout, labels = _prepared(scene, chosen, tuple(columns), backend, count)
    for path, column in columns.items():
        lower, upper = limits_at(scene.scenario, path)
        outside = column[(column < lower) | (column > upper)]
        if outside.size:
            bounds = f"at least {lower:g}" if upper == np.inf else f"{lower:g} to {upper:g}"
            raise ScenarioError(f"found {outside[0]:g}, allowed: {bounds}", where=path)
    trajectories = rollout.batch(list(columns), np.column_stack(list(columns.values())), threads=threads)
    duration = scene.scenario.simulation.duration
    sample = next(iter(columns)) if len(columns) == 1 else "sample"
    data: dict[str, object] = {"diverged_at": (sample, np.array(trajectories.diverged_at_s), {"units": "s"})}
    coordinates: dict[str, object] = {
        path: (sample, column, {"units": unit_at(scene.scenario, path), "long_name": path})
        for path, column in columns.items()
    }
    for each in chosen:
        reduced = table_values(each, trajectories.measures, duration)
        owners = np.array(labels[each.name])
        unique = list(dict.fromkeys(labels[each.name]))
        of = f"{each.name}_of"
        grouped = np.column_stack([reduced[:, owners == label].max(axis=1) for label in unique])
        attributes = {"units": each.unit_in(scene), "long_name": each.label}
        data[each.name] = ((sample, of), grouped, attributes)
        coordinates[of] = unique
    return BatchResult(xr.Dataset(data, coordinates, {"scenario": scene.scenario.name}))


def _column(path: str, numbers: npt.ArrayLike) -> Array:
    """Values (N,) of a parameter.

    Raises:
        ScenarioError: If they are no numbers.
    """
    try:
        return np.atleast_1d(np.asarray(numbers, dtype=float))
    except (TypeError, ValueError):
        raise ScenarioError(f"found {numbers!r}, allowed: a list of numbers", where=path) from None


def find_quantities(names: str | Sequence[str]) -> tuple[Quantity, ...]:
    """Quantities by their names.

    Raises:
        SpaceRobotError: If there is no such quantity.
    """
    listed = [names] if isinstance(names, str) else names
    if not isinstance(listed, Sequence) or not listed:
        allowed = "names of quantities, such as 'tip_error_rms'"
        raise SpaceRobotError(f"quantities: found {names!r}, allowed: {allowed}")
    return tuple(find_quantity(name) for name in listed)


def parameter_paths(scene: Scene, parameters: str | Sequence[str]) -> tuple[str, ...]:
    """Dotted paths of the single numbers that patterns match.

    Args:
        scene: The scene.
        parameters: Paths of numbers, or of lists and sections, which match all numbers in them
            (``robots.free.controllers.policy.layers``); ``*`` matches every key.

    Raises:
        ScenarioError: If a pattern matches no number.
    """
    document, paths = to_document(scene.scenario), list[str]()
    for pattern in [parameters] if isinstance(parameters, str) else parameters:
        for path in expand(document, pattern):
            inside = [name for name, _ in numbers(get(document, path), path)]
            if not inside:
                raise scene.error("holds no number by which to differentiate", path)
            paths += inside
    return tuple(dict.fromkeys(paths))


def _prepared(
    scene: Scene,
    chosen: tuple[Quantity, ...],
    vary: tuple[str, ...],
    backend: Backend,
    rollouts: int | None,
) -> tuple[Any, dict[str, tuple[str, ...]]]:
    """Rollout of :func:`build_quantity_rollout`; scenes of equal content share one, which is cached."""
    compiler = tuple(os.environ.get(name) for name in COMPILER_SETTINGS)
    return _build_once(SceneContent(scene), chosen, vary, backend, rollouts, compiler)


@functools.lru_cache(maxsize=MOST_PREPARED)
def _build_once(
    content: SceneContent,
    chosen: tuple[Quantity, ...],
    vary: tuple[str, ...],
    backend: Backend,
    rollouts: int | None,
    _: tuple[str | None, ...],
) -> tuple[Any, dict[str, tuple[str, ...]]]:
    return build_quantity_rollout(content.scene, chosen, vary, backend, many=False, rollouts=rollouts)


class RolloutRequest(TypedDict, total=False):
    """Keyword arguments of :func:`build_quantity_rollout`.

    Attributes:
        many: Whether the rollout serves many samples, also where Python updates controllers; default true.
        step: Step of the rollout [s]; the simulation's step and tolerance if None.
        rollouts: Expected number of rollouts; see :class:`~spacerobot.rollout.build.Settings`.
    """

    many: bool
    step: float | None
    rollouts: int | None


def build_quantity_rollout(
    scene: Scene,
    chosen: Sequence[Quantity],
    vary: Sequence[str],
    backend: Backend = "auto",
    **request: Unpack[RolloutRequest],
) -> tuple[Any, dict[str, tuple[str, ...]]]:
    """Rollout whose measures and costs are quantities, and the labels of each one's components.

    Args:
        scene: The scene.
        chosen: The quantities.
        vary: Dotted paths of numbers that vary.
        backend: ``auto``, ``compiled`` or ``interpreted``.
        **request: As :class:`RolloutRequest` has it.

    Raises:
        ScenarioError: If the scene has nothing that a quantity describes.
    """
    step = request.get("step")
    updated = UpdatedScene.of(scene, vary) if request.get("many", True) else None
    loop = cached_closed_loop(scene if updated is None else updated.scene, vary=vary)
    extended = with_added_states(loop, scene, chosen, JITTER_FREQUENCY_HZ)
    context = context_of(scene, extended)
    simulation, labels = scene.scenario.simulation, {}
    named = dict[str, Measure]()
    for each in chosen:
        labelled, quantity_measures = measures_of(each, context)
        named |= quantity_measures
        labels[each.name] = labelled.labels
        if not labelled.labels:
            raise scene.error(f"{each.name}: {each.absent}")

    def costs(reduced: Mapping[str, ca.SX], _: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        duration = simulation.duration
        return {each.name: each.combined(each.reduced(reduced[each.name], duration)) for each in chosen}

    measures = Measures(context.signals, named, costs)
    options: Options = {
        "step_s": simulation.step if step is None else step,
        "output_step_s": simulation.output_step if step is None else None,
        "tolerance": simulation.tolerance,
        "method": simulation.method,
        "backend": backend,
        "rollouts": request.get("rollouts"),
    }
    if updated is not None:
        rolled = UpdatedRollout(updated, loop, extended, measures, duration_s=updated.duration_s, **options)
        return rolled, labels
    return build_rollout(extended, duration_s=simulation.duration, measures=measures, **options), labels
