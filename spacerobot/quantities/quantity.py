"""A quantity of a motion: its expression, its reduction over time, its unit and its name for people.

A quantity is defined once, in a file of this package or in a plugin, and is available everywhere: as an
objective or a constraint of tuning, as a metric and a limit of campaigns, as a cost of plans, in the studio
and in reports. Its expression is one of signals, which a rollout provides and an instant of a plan too.
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
"""Columns of a signal by label: of each joint, tip, body or grasp."""
Expression = Any
"""A CasADi expression or a NumPy array: reductions are written once for both."""
BODIES = {
    "base_rotation": ("body_rotation", False),
    "base_position": ("body_position", False),
    "target_rotation": ("body_rotation", True),
}
"""Signals that are an output's entries of bodies, and whether of the target or of the others."""


class MeasuredScene(Protocol):
    """The part of a :class:`spacerobot.scene.Scene` that quantities read.

    Scenes are built from scenarios, whose sections name quantities: a protocol keeps the imports one-way.
    """

    @property
    def model(self) -> Any:
        """Pinocchio model of every body."""

    @property
    def scenario(self) -> Any:
        """Scenario that the scene was built from."""

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
        """Error of the scenario's file, to be raised."""


class SignalSource(Protocol):
    """A rollout or an instant of a plan: the signals that quantities are expressions of."""

    def signal(self, name: str) -> Columns:
        """Columns of a signal by label; none where the scene has nothing that it describes."""


@dataclass(frozen=True)
class Context:
    """A rollout as quantities see it: a :class:`SignalSource`.

    Attributes:
        scene: The scene.
        loop: Its closed loop, with the states that quantities added.
        signals: Symbols of its time, state and outputs.
    """

    scene: MeasuredScene
    loop: ClosedLoopFunctions
    signals: Signals

    def signal(self, name: str) -> Columns:
        """Columns of an output by label; also rates of joints, and displacements of bases since the start."""
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
        """Output that a signal is part of, and its entries by label; none where there is no such output.

        Left out are bodies whose elements do not declare the output: they have no number in its place.
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
        """Expressions of the outputs."""
        function = self.loop.outputs
        return self._outputs(*(ca.SX.sym(n, function.sparsity_in(n)) for n in function.name_in()))

    def _outputs(self, *point: Any) -> Mapping[str, ca.SX]:
        """Outputs by name at a time, state and constants."""
        function = self.loop.outputs
        return dict(zip(function.name_out(), function.call(list(point)), strict=True))


@dataclass(frozen=True)
class Components:
    """The expression that is reduced, one entry for each label.

    Attributes:
        labels: What each entry belongs to: a tip, a joint, a robot, a grasp, ``total``; none where the scene
            has nothing that the quantity describes. Entries of the same label count as one: the largest.
        values: Expression (n,); of ``rms`` and ``final_length`` the squares.
    """

    labels: tuple[str, ...]
    values: ca.SX


@dataclass(frozen=True)
class AddedStates:
    """States that a quantity needs in addition to the closed loop's.

    Attributes:
        names: Of the states (n).
        rates: Function of (symbols of the closed loop, the states (n,)) that returns their rates (n,).
    """

    names: tuple[str, ...]
    rates: Callable[[Any, ca.SX], ca.SX]


@dataclass(frozen=True)
class PlanBound:
    """A key of ``plan.limits`` that bounds a quantity at all times of a plan.

    Bounded are the length of each column of a root, and each entry of other quantities. Bounds on joint
    rates, joint torques and forces and torques on bases are bounds on the plan's unknowns.

    Attributes:
        key, unit, description: Name, unit and text of the limit in scenarios. Degrees bound radians.
        allowed: Range of the limit, as options of :func:`pydantic.Field`.
        joints: Kinds of joints that it bounds.
        is_relative: Whether violations between the mesh's points are relative to the limit.
    """

    key: str
    unit: str
    description: str
    allowed: Mapping[str, Any] = field(default_factory=lambda: {"gt": 0}, hash=False)
    joints: tuple[str, ...] = ("revolute", "continuous", "prismatic")
    is_relative: bool = False


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number, or one number per tip, robot or grasp, of each motion; the smaller the better.

    Attributes:
        name: In scenarios, files and tables.
        label, description: For people: a short name, and one phrase on what it is.
        unit: Of each component after reduction.
        reducer: ``integral`` over time, ``peak`` (largest) or ``lowest`` value, ``final`` value, ``rms`` or
            ``final_length`` of columns, or integral of their entries' ``magnitude``.
        expression: Columns by label, as a function of a :class:`SignalSource`, or the name of the signal that
            they are.
        total: How components become one number: the ``largest``, their ``sum`` or their ``norm``.
        limit: Key under which ``campaign.limits`` bounds it, and ``tuning.constraints`` as ``max_`` and this
            key; it cannot be bounded if None.
        weight: Key under which ``tuning.objective`` weighs the sum of its components, or of their squares
            where it is a root; it is no part of objectives if None.
        cost: Key under which ``plan.costs`` weighs the same; it is no cost of plans if None.
        bounds: Keys under which ``plan.limits`` bounds it; an ``rms`` or a ``peak`` may have some.
        relative_to_start: Whether it is measured from where bases are at the start.
        is_metric: Whether rollouts have its signals, so that campaigns and the studio may keep it.
        is_default: Whether campaigns keep it if their section names no metrics.
        absent: Why a scene may have nothing that it describes.
        symbol: Letter that marks a failure by this quantity in a campaign's map.
        states: Function of (scene, corner frequency [Hz]) that returns the states it needs; none if None.
        scene_unit: Unit where it depends on the scene.
        exists: Columns by label whose final values are negative where a rollout has no value, as the time of
            a capture that was missed. Tables hold NaN there; objectives need a number and take the
            expression's.
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
        """Whether it is the root of squares, which objectives and plans weigh in its place."""
        return self.reducer in ("rms", "final_length")

    @property
    def weighed_unit(self) -> str:
        """Unit of what a weight multiplies."""
        if not self.is_root:
            return self.unit
        square = f"({self.unit})^2" if set(self.unit) & set(" /^") else f"{self.unit}^2"
        return f"{square} s" if self.reducer == "rms" else square

    def weight_unit(self, of: str = "1") -> str:
        """Unit of a weight in what has a unit itself, as an objective."""
        unit = self.weighed_unit
        return of if unit == "1" else f"{of}/({unit})" if set(unit) & set(" /") else f"{of}/{unit}"

    def unit_in(self, scene: MeasuredScene) -> str:
        """Unit in a scene."""
        return self.unit if self.scene_unit is None else self.scene_unit(scene)

    def columns(self, source: SignalSource) -> Columns:
        """Columns by label; none where the scene has nothing that the quantity describes."""
        return source.signal(self.expression) if isinstance(self.expression, str) else self.expression(source)

    def components(self, source: SignalSource) -> Components:
        """The expression that is reduced, of a rollout or an instant of a plan."""
        return self.entries(self.columns(source))

    def entries(self, columns: Columns) -> Components:
        """The expression that is reduced: squared lengths or magnitudes of columns, or their entries."""
        size = ca.sumsqr if self.is_root else ca.norm_1 if self.reducer == "magnitude" else ca.SX
        parts = {label: size(column) for label, column in columns.items()}
        labels = tuple(label for label, part in parts.items() for _ in range(part.numel()))
        return Components(labels, ca.vertcat(ca.SX(0, 1), *parts.values()))

    def weighed(self, measured: Expression) -> Expression:
        """Values that are weighed, from what the rollout's measure gives for the components.

        Args:
            measured: Integral, peak or final values, any shape; of ``lowest`` the peak of the negated
                expression.
        """
        return -measured if self.reducer == "lowest" else measured

    def reduced(self, measured: Expression, duration_s: float) -> Expression:
        """Values of the components, from what the rollout's measure gives for them.

        Args:
            measured: As for :meth:`weighed`.
            duration_s: Of the rollout.
        """
        if self.is_root:
            return (measured / (duration_s if self.reducer == "rms" else 1.0)) ** 0.5
        return self.weighed(measured)

    def combined(self, values: ca.SX) -> ca.SX:
        """One number of all components' values (n,)."""
        if values.numel() == 1:
            return values
        if self.total == "norm":
            return ca.sqrt(ca.sumsqr(values))
        return ca.sum1(values) if self.total == "sum" else ca.mmax(values)


_REGISTERED: dict[str, Quantity] = {}


def register_quantity(quantity: Quantity) -> Quantity:
    """Add a quantity; a plugin calls it as the files of this package do.

    Raises:
        SpaceRobotError: If another quantity has its name or one of its keys, or it has bounds and is no
            ``rms`` or ``peak``.
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
    """Expression as data: a plugin that is run again registers the same one under the same name."""
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
"""Modules whose quantities tables show first, in this order; those of other modules follow by name."""


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
    """Every quantity by name: those that ship first."""
    _load()
    return MappingProxyType(_REGISTERED)


def metrics() -> Mapping[str, Quantity]:
    """Quantities that campaigns and the studio may keep, by name."""
    return MappingProxyType({name: each for name, each in quantities().items() if each.is_metric})


def default_metrics() -> tuple[str, ...]:
    """Names of the metrics that are kept where none are named, those that do not fit the scene left out."""
    return tuple(name for name, each in metrics().items() if each.is_default)


def limited() -> dict[str, Quantity]:
    """Quantities that can be bounded, by the key of their limit."""
    return {each.limit: each for each in quantities().values() if each.limit is not None}


def weighted() -> dict[str, Quantity]:
    """Quantities that an objective can weigh, by the key of their weight."""
    return {each.weight: each for each in quantities().values() if each.weight is not None}


def planned() -> dict[str, Quantity]:
    """Quantities that are costs of plans, by their keys."""
    return {each.cost: each for each in quantities().values() if each.cost is not None}


def bounded() -> dict[str, tuple[PlanBound, Quantity]]:
    """Bounds of plans, each with its quantity, by their keys."""
    return {bound.key: (bound, each) for each in quantities().values() for bound in each.bounds}


def find_quantity(name: str) -> Quantity:
    """The quantity of a name.

    Raises:
        SpaceRobotError: If there is none; with the near names.
    """
    registered_quantities = quantities()
    if name not in registered_quantities:
        raise SpaceRobotError(f"no quantity {name!r}; {near_names(name, registered_quantities)}")
    return registered_quantities[name]


def sizes(columns: Columns, smallest: float = 0.0, factor: float = 1.0) -> Columns:
    """Lengths of columns, smooth at zero where ``smallest`` is above it, times a factor."""
    return {label: factor * ca.sqrt(ca.sumsqr(column) + smallest**2) for label, column in columns.items()}
