"""Quantity of a motion: its expression, reduction over time, unit and label.

A quantity is defined once, in a file of this package or in a plugin. It is available as an objective or
constraint of tuning, as a metric or limit of campaigns, as a cost or limit of plans, in the studio and in
reports. Its expression depends on signals, which both a rollout and an instant of a plan provide.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, Protocol

import casadi as ca
import numpy as np

from spacerobot.common.errors import SpaceRobotError, near_names

if TYPE_CHECKING:
    from spacerobot.rollout.closed_loop_protocol import ClosedLoopFunctions
    from spacerobot.rollout.measures import Signals

Reducer = Literal["integral", "peak", "lowest", "final", "rms", "magnitude", "final_length"]
Total = Literal["largest", "sum", "norm"]
Columns = Mapping[str, ca.SX]
"""Columns of a signal by label, such as the name of a joint, tip, body or grasp."""
Expression = Any
"""CasADi expression or NumPy array, to which the same reductions apply."""
BODIES = {
    "base_rotation": ("body_rotation", False),
    "base_position": ("body_position", False),
    "target_rotation": ("body_rotation", True),
}
"""Signals that are parts of an output of bodies: the output, and whether the part is the target's."""


class MeasuredScene(Protocol):
    """Properties of a :class:`spacerobot.scene.Scene` that quantities use.

    Scenes are built from scenarios, whose sections name quantities. A protocol avoids the cyclic import.
    """

    @property
    def model(self) -> Any:
        """Pinocchio model of every body."""

    @property
    def scenario(self) -> Any:
        """Scenario from which the scene was built."""

    @property
    def bodies(self) -> Sequence[Any]:
        """Robots and target."""

    @property
    def robots(self) -> Sequence[Any]:
        """Robots."""

    @property
    def target(self) -> Any:
        """Target, or None."""

    @property
    def tips(self) -> Sequence[Any]:
        """Tips of all robots."""

    @property
    def grasps(self) -> Sequence[Any]:
        """Grasps."""

    @property
    def translation_axes(self) -> Any:
        """World axes along which bodies can move."""

    def error(self, message: str, where: str | None = None) -> SpaceRobotError:
        """Error that names the scenario's file, to be raised."""


class SignalSource(Protocol):
    """Source of signals: a rollout, or an instant of a plan."""

    def signal(self, name: str) -> Columns:
        """Columns of a signal by label; empty if the signal does not apply to the scene."""


@dataclass(frozen=True)
class Context:
    """Signals of a rollout; see :class:`SignalSource`.

    Attributes:
        scene: The scene.
        loop: Closed loop of the scene, with the states added for quantities.
        signals: Symbols of the rollout's time, state and outputs.
    """

    scene: MeasuredScene
    loop: ClosedLoopFunctions
    signals: Signals

    def signal(self, name: str) -> Columns:
        """Columns of a signal by label: of an output, ``joint_rate`` or ``base_translation``."""
        if name == "joint_rate":
            model, rates = self.scene.model, self.signals.x[self.loop.nq :]
            joints = sorted(joint for body in self.scene.robots for joint in body.driven_joints)
            return {model.names[joint]: rates[int(model.idx_vs[joint])] for joint in joints}
        if name == "base_translation":
            x0, c = self.loop.setup(ca.vertcat(*self.signals.parameters.values()))
            start = self._outputs(0, x0, c)["body_position"]
            output, labels = self.rows("base_position")
            return {label: self.signals[output][rows] - start[rows] for label, rows in labels.items()}
        output, labels = self.rows(name)
        return {label: self.signals[output][rows] for label, rows in labels.items()}

    def rows(self, name: str) -> tuple[str, Mapping[str, list[int]]]:
        """Output that contains a signal, and indices of the signal's entries by label.

        The mapping is empty if the loop has no such output. Bodies whose elements do not define the output,
        whose entries are NaN, are left out.
        """
        output, of_target = BODIES.get(name, (name, None))
        by_name = {variable.name: variable for variable in self.loop.variables}.get(output)
        if by_name is None:
            return output, {}
        scene, labels = self.scene, by_name.labels or ("total",)
        if by_name.dims == ("joint",):
            joints = sorted(joint for body in scene.bodies for joint in body.arm_joints)
            labels = tuple(scene.model.names[joint] for joint in joints)
        value = self._values[output]
        size = value.numel() // len(labels) if labels else 0
        places = {label: list(range(size * k, size * (k + 1))) for k, label in enumerate(labels)}
        target = "" if scene.target is None else scene.target.name
        return output, {
            label: rows
            for label, rows in places.items()
            if size
            and not (value[rows[0]].is_constant() and np.isnan(float(value[rows[0]])))
            and (of_target is None or (label == target) == of_target)
        }

    @cached_property
    def _values(self) -> Mapping[str, ca.SX]:
        """Expressions of the outputs by name."""
        function = self.loop.outputs
        return self._outputs(*(ca.SX.sym(n, function.sparsity_in(n)) for n in function.name_in()))

    def _outputs(self, *point: Any) -> Mapping[str, ca.SX]:
        """Outputs by name at a time, state and constants."""
        function = self.loop.outputs
        return dict(zip(function.name_out(), function.call(list(point)), strict=True))


@dataclass(frozen=True)
class Components:
    """Expression of a quantity before its reduction over time.

    Attributes:
        labels: Label of each entry: a tip, joint, robot, grasp or ``total``; empty if the quantity does not
            apply to the scene. Of entries with the same label, the largest counts.
        values: Entries (n,); squares for ``rms`` and ``final_length``.
    """

    labels: tuple[str, ...]
    values: ca.SX


@dataclass(frozen=True)
class AddedStates:
    """States that a quantity adds to the closed loop; their initial values are zero.

    Attributes:
        names: Names of the states (n).
        rates: Function of the closed loop's symbols and the states (n,) for the states' rates (n,).
    """

    names: tuple[str, ...]
    rates: Callable[[Any, ca.SX], ca.SX]


@dataclass(frozen=True)
class PlanBound:
    """A key of ``plan.limits`` that bounds a quantity at all times of a plan.

    The bound applies to the norm of each column of an ``rms`` quantity, and to each entry of other
    quantities. Bounds on joint rates, joint torques, and forces and torques on bases are bounds on the plan's
    variables.

    Attributes:
        key, unit, description: Name, unit and description of the limit in scenarios. A limit in degrees
            bounds a quantity in radians.
        allowed: Range of the limit, as arguments of :func:`pydantic.Field`.
        joints: Kinds of joints to which the bound applies.
        is_relative: Whether the tolerated violation between collocation points is relative to the limit.
    """

    key: str
    unit: str
    description: str
    allowed: Mapping[str, Any] = field(default_factory=lambda: {"gt": 0}, hash=False)
    joints: tuple[str, ...] = ("revolute", "continuous", "prismatic")
    is_relative: bool = False


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A quantity of a motion, with one component or one for each tip, robot or grasp; smaller is better.

    Attributes:
        name: Name in scenarios, files and tables.
        label, description: Short name and description for displays.
        unit: Unit of each component after the reduction.
        reducer: Reduction over time: ``integral``, ``peak`` (largest value), ``lowest`` or ``final`` value;
            ``rms`` or ``final_length`` (norm) of columns; ``magnitude``, the integral of the sum of absolute
            values of a column.
        expression: Function of a :class:`SignalSource` for columns by label, or the name of a signal.
        total: Combination of components to one number: the ``largest``, their ``sum`` or their ``norm``.
        limit: Key of the quantity's limit in ``campaign.limits``, and with the prefix ``max_`` in
            ``tuning.constraints``; None for a quantity that cannot be limited there.
        weight: Key of the quantity's weight in ``tuning.objective``, which multiplies the sum of the
            components, or of their squares for ``rms`` and ``final_length``; None for a quantity without a
            weight.
        cost: Key of the quantity's weight in ``plan.costs``, which multiplies the same sum; None for a
            quantity that is not a cost of plans.
        bounds: Limits in ``plan.limits``; only ``rms`` and ``peak`` quantities may have them.
        relative_to_start: Whether the quantity is relative to the initial poses of bases.
        is_metric: Whether rollouts provide its signals, so that it may be a metric of campaigns and the
            studio.
        is_default: Whether it is a metric of campaigns whose section names no metrics.
        absent: Message if the quantity does not apply to a scene.
        symbol: Letter that marks a failure by this quantity in a campaign's map.
        states: Function of scene and corner frequency [Hz] for the states that the quantity needs, or None.
        scene_unit: Function of a scene for the unit, or None if the unit does not depend on the scene.
        exists: Function for columns by label whose final values are negative if a rollout has no value, such
            as the time of a missed capture. Tables then have NaN, while objectives use the expression's
            value.
    """

    name: str
    label: str
    description: str
    unit: str
    reducer: Reducer
    expression: str | Callable[[Any], Columns]
    total: Total = "largest"
    limit: str | None = None
    weight: str | None = None
    cost: str | None = None
    bounds: tuple[PlanBound, ...] = ()
    relative_to_start: bool = False
    is_metric: bool = True
    is_default: bool = True
    absent: str = "this scene has nothing that it describes"
    symbol: str = ""
    states: Callable[[MeasuredScene, float], AddedStates] | None = None
    scene_unit: Callable[[MeasuredScene], str] | None = None
    exists: Callable[[Any], Columns] | None = None

    @property
    def keys(self) -> dict[str, set[str]]:
        """Keys of the quantity by the section that reads them."""
        single = {
            "campaign.limits": self.limit,
            "tuning.objective": self.weight,
            "plan.costs": self.cost,
        }
        keys = {section: {key} for section, key in single.items() if key is not None}
        return keys | {"plan.limits": {bound.key for bound in self.bounds}}

    @property
    def is_root(self) -> bool:
        """Whether the quantity is a root of squares; objectives and plans weigh the squares."""
        return self.reducer in ("rms", "final_length")

    @property
    def weighed_unit(self) -> str:
        """Unit of the number that a weight multiplies."""
        if not self.is_root:
            return self.unit
        square = f"({self.unit})^2" if set(self.unit) & set(" /^") else f"{self.unit}^2"
        return f"{square} s" if self.reducer == "rms" else square

    def weight_unit(self, of: str = "1") -> str:
        """Unit of a weight in a sum with the unit ``of``."""
        unit = self.weighed_unit
        return of if unit == "1" else f"{of}/({unit})" if set(unit) & set(" /") else f"{of}/{unit}"

    def unit_in(self, scene: MeasuredScene) -> str:
        """Unit of the quantity in a scene."""
        return self.unit if self.scene_unit is None else self.scene_unit(scene)

    def columns(self, source: SignalSource) -> Columns:
        """Columns by label; empty if the quantity does not apply to the scene."""
        return source.signal(self.expression) if isinstance(self.expression, str) else self.expression(source)

    def components(self, source: SignalSource) -> Components:
        """Expression before the reduction over time, from the signals of a rollout or of a plan's instant."""
        return self.entries(self.columns(source))

    def entries(self, columns: Columns) -> Components:
        """Expression before the reduction: squared norms, sums of absolute values, or entries of columns."""
        size = ca.sumsqr if self.is_root else ca.norm_1 if self.reducer == "magnitude" else ca.SX
        parts = {label: size(column) for label, column in columns.items()}
        labels = tuple(label for label, part in parts.items() for _ in range(part.numel()))
        return Components(labels, ca.vertcat(ca.SX(0, 1), *parts.values()))

    def weighed(self, measured: Expression) -> Expression:
        """Values that a weight multiplies, from a rollout's measure of the components.

        Args:
            measured: Integral, peak or final values, of any shape; for ``lowest``, the peak of the negated
                expression.
        """
        return -measured if self.reducer == "lowest" else measured

    def reduced(self, measured: Expression, duration_s: float) -> Expression:
        """Values of the components, from a rollout's measure of them.

        Args:
            measured: As for :meth:`weighed`.
            duration_s: Duration of the rollout [s].
        """
        if self.is_root:
            return (measured / (duration_s if self.reducer == "rms" else 1.0)) ** 0.5
        return self.weighed(measured)

    def combined(self, values: ca.SX) -> ca.SX:
        """Combination of all components' values (n,) to one number (1x1), as :attr:`total` states."""
        if values.numel() == 1:
            return values
        if self.total == "norm":
            return ca.sqrt(ca.sumsqr(values))
        return ca.sum1(values) if self.total == "sum" else ca.mmax(values)


_REGISTERED: dict[str, Quantity] = {}


def register_quantity(quantity: Quantity) -> Quantity:
    """Register a quantity of a plugin and return it.

    Raises:
        SpaceRobotError: If another quantity has its name or one of its keys, or if it has bounds but is not
            an ``rms`` or ``peak`` quantity.
    """
    _load()
    return _add(quantity)


def _add(quantity: Quantity) -> Quantity:
    registered_quantity = _REGISTERED.get(quantity.name)
    if registered_quantity is not None and source_of(registered_quantity) != source_of(quantity):
        raise SpaceRobotError(f"the quantity {quantity.name!r} is registered already")
    if quantity.bounds and quantity.reducer not in ("rms", "peak"):
        raise SpaceRobotError(
            f"the quantity {quantity.name!r}: bounds of plans are of `rms` or `peak` quantities"
        )
    for other in (each for each in _REGISTERED.values() if each.name != quantity.name):
        for section, keys in other.keys.items():
            for key in sorted(keys & quantity.keys.get(section, set())):
                message = f"its key {key!r} in `{section}` is that of {other.name!r}"
                raise SpaceRobotError(f"the quantity {quantity.name!r}: {message}")
    _REGISTERED[quantity.name] = quantity
    return quantity


def source_of(quantity: Quantity) -> object:
    """Code of a quantity's expression, by which a plugin that is loaded twice is recognised."""
    return quantity.expression if isinstance(quantity.expression, str) else quantity.expression.__code__


ORDER = (
    "tip_error",
    "rotation",
    "joint_torque",
    "grip_force",
    "capture",
    "impact",
    "attitude_error",
    "wheel_momentum",
    "propellant",
    "jitter",
)
"""Modules whose quantities are listed first, in this order; other modules follow by name."""


def _load() -> None:
    if _REGISTERED:
        return
    package = importlib.import_module("spacerobot.quantities")
    modules = [module.name for module in pkgutil.iter_modules(package.__path__) if module.name != "quantity"]
    for name in sorted(modules, key=lambda n: (ORDER.index(n) if n in ORDER else len(ORDER), n)):
        module = importlib.import_module(f"{package.__name__}.{name}")
        for quantity in module.QUANTITIES:
            _add(quantity)


def quantities() -> Mapping[str, Quantity]:
    """All quantities by name, the shipped ones first."""
    _load()
    return MappingProxyType(_REGISTERED)


def metrics() -> Mapping[str, Quantity]:
    """Quantities that may be metrics of campaigns and the studio, by name."""
    return MappingProxyType({name: each for name, each in quantities().items() if each.is_metric})


def default_metrics() -> tuple[str, ...]:
    """Names of the default metrics; a scene uses those that apply to it."""
    return tuple(name for name, each in metrics().items() if each.is_default)


def limited() -> dict[str, Quantity]:
    """Quantities with a limit in campaigns and tuning, by the key of the limit."""
    return {each.limit: each for each in quantities().values() if each.limit is not None}


def weighted() -> dict[str, Quantity]:
    """Quantities with a weight in objectives, by the key of the weight."""
    return {each.weight: each for each in quantities().values() if each.weight is not None}


def planned() -> dict[str, Quantity]:
    """Quantities that are costs of plans, by the key of the cost."""
    return {each.cost: each for each in quantities().values() if each.cost is not None}


def bounded() -> dict[str, tuple[PlanBound, Quantity]]:
    """Limits of plans with their quantities, by key."""
    return {bound.key: (bound, each) for each in quantities().values() for bound in each.bounds}


def find_quantity(name: str) -> Quantity:
    """Find a quantity by its name.

    Raises:
        SpaceRobotError: If there is no such quantity; the message has similar names.
    """
    registered_quantities = quantities()
    if name not in registered_quantities:
        raise SpaceRobotError(f"no quantity {name!r}; {near_names(name, registered_quantities)}")
    return registered_quantities[name]


def sizes(columns: Columns, smallest: float = 0.0, factor: float = 1.0) -> Columns:
    """Norms of columns times a factor, differentiable at zero if ``smallest`` is positive."""
    return {label: factor * ca.sqrt(ca.sumsqr(column) + smallest**2) for label, column in columns.items()}
