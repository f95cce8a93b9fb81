"""A quantity of a rollout: its expression, its reduction over time, its unit and its name for people.

A quantity is defined once, in a file of this package or in a plugin, and is available everywhere: as an
objective or a constraint of tuning, as a metric and a limit of campaigns, in the studio and in reports.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, Protocol

import casadi as ca
import numpy as np

from spacerobot.errors import SpaceRobotError, near_names

if TYPE_CHECKING:
    from spacerobot.rollout.measures import Signals
    from spacerobot.scene import Scene

Reducer = Literal["integral", "peak", "lowest", "final", "rms"]
Total = Literal["largest", "sum", "norm"]
Expression = Any
"""A CasADi expression or a NumPy array: reductions are written once for both."""


class Loop(Protocol):
    """Interface of a closed loop that quantities use."""

    @property
    def state_names(self) -> Sequence[str]:
        """Names of all states."""

    @property
    def outputs(self) -> ca.Function:
        """(t, x, c) -> outputs by name."""


@dataclass(frozen=True)
class Context:
    """A rollout as quantities see it.

    Attributes
    ----------
    scene
        The scene.
    loop
        Its closed loop, with the states that quantities added.
    signals
        Symbols of its time, state and outputs.
    """

    scene: Scene
    loop: Loop
    signals: Signals

    def vectors(self, output: str) -> list[ca.SX]:
        """An output of three components each, one vector for each label."""
        stacked = self.signals[output]
        return [stacked[i : i + 3] for i in range(0, stacked.numel(), 3)]

    def bodies(self, output: str) -> tuple[tuple[str, ...], list[ca.SX]]:
        """Names of the bodies that have an output, and its part for each.

        A body whose elements do not declare the output has a constant that is not a number in its place.
        """
        bodies = self.scene.bodies
        names = self.loop.outputs.name_out()
        if output not in names:
            return (), []
        function = self.loop.outputs
        given = [ca.SX.sym(name, function.sparsity_in(name)) for name in function.name_in()]
        value = function.call(given)[names.index(output)]
        size = value.numel() // len(bodies)
        chosen = [
            i
            for i in range(len(bodies))
            if not (value[size * i].is_constant() and np.isnan(float(value[size * i])))
        ]
        parts = [self.signals[output][size * i : size * (i + 1)] for i in chosen]
        return tuple(bodies[i].name for i in chosen), parts


@dataclass(frozen=True)
class Components:
    """The expression that is reduced, one entry for each label.

    Attributes
    ----------
    labels
        What each entry belongs to: a tip, a joint's robot, a grasp, ``total``; none where the scene has
        nothing that the quantity describes. Entries of the same label count as one: the largest.
    values
        Expression (n,); for the reducer ``rms`` the squares whose mean is taken.
    """

    labels: tuple[str, ...]
    values: ca.SX


NOTHING = Components((), ca.SX(0, 1))


@dataclass(frozen=True)
class AddedStates:
    """States that a quantity needs in addition to the closed loop's.

    Attributes
    ----------
    names
        Of the states (n).
    rates
        Function of (symbols of the closed loop, the states (n,)) that returns their rates (n,).
    """

    names: tuple[str, ...]
    rates: Callable[[Any, ca.SX], ca.SX]


@dataclass(frozen=True)
class Quantity:
    """A number, or one number per tip, robot or grasp, of each rollout; the smaller the better.

    Attributes
    ----------
    name
        In scenarios, files and tables.
    label, description
        For people: a short name, and one phrase on what it is.
    unit
        Of each component after reduction.
    reducer
        ``integral`` over time, ``peak`` (largest) or ``lowest`` value, ``final`` value, or ``rms``.
    components
        The expression, from a :class:`Context`.
    total
        How components become one number: the ``largest``, their ``sum`` or their ``norm``.
    limit
        Key under which ``campaign.limits`` bounds it, and ``tuning.constraints`` as ``max_`` and this key; it
        cannot be bounded if None.
    weight, weight_unit
        Key under which ``tuning.objective`` weighs the sum of its components, and the unit of that weight; it
        is no part of objectives if None.
    is_metric
        Whether campaigns and the studio may keep it.
    is_default
        Whether campaigns keep it if their section names no metrics.
    absent
        Why a scene may have nothing that it describes.
    symbol
        Letter that marks a failure by this quantity in a campaign's map.
    states
        Function of (scene, corner frequency [Hz]) that returns the states it needs; none if None.
    scene_unit
        Unit where it depends on the scene.
    """

    name: str
    label: str
    description: str
    unit: str
    reducer: Reducer
    components: Callable[[Context], Components]
    total: Total = "largest"
    limit: str | None = None
    weight: str | None = None
    weight_unit: str = ""
    is_metric: bool = True
    is_default: bool = True
    absent: str = "this scene has nothing that it describes"
    symbol: str = ""
    states: Callable[[Scene, float], AddedStates] | None = None
    scene_unit: Callable[[Scene], str] | None = None

    def unit_in(self, scene: Scene) -> str:
        """Unit in a scene."""
        return self.unit if self.scene_unit is None else self.scene_unit(scene)

    def reduced(self, measured: Expression, duration_s: float) -> Expression:
        """Values of the components, from what the rollout's measure gives for them.

        Parameters
        ----------
        measured
            Integral, peak or final values, any shape; of ``lowest`` the peak of the negated expression.
        duration_s
            Of the rollout.
        """
        if self.reducer == "rms":
            return (measured / duration_s) ** 0.5
        return -measured if self.reducer == "lowest" else measured

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

    Raises
    ------
    SpaceRobotError
        If another quantity has its name.
    """
    _load()
    return _add(quantity)


def _add(quantity: Quantity) -> Quantity:
    known = _REGISTERED.get(quantity.name)
    if known is not None and known.components.__code__ != quantity.components.__code__:
        raise SpaceRobotError(f"the quantity {quantity.name!r} is registered already")
    _REGISTERED[quantity.name] = quantity
    return quantity


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
    found = [module.name for module in pkgutil.iter_modules(package.__path__) if module.name != "quantity"]
    for name in sorted(found, key=lambda n: (ORDER.index(n) if n in ORDER else len(ORDER), n)):
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


def find_quantity(name: str) -> Quantity:
    """The quantity of a name.

    Raises
    ------
    SpaceRobotError
        If there is none; with the near names.
    """
    known = quantities()
    if name not in known:
        raise SpaceRobotError(f"no quantity {name!r}; {near_names(name, known)}")
    return known[name]


def sizes(vectors: Sequence[ca.SX], smallest: float = 0.0) -> Iterator[ca.SX]:
    """Lengths of vectors, smooth at zero where ``smallest`` is above it."""
    for vector in vectors:
        yield ca.sqrt(ca.sumsqr(vector) + smallest**2)
