"""Registered quantities as measures of a rollout."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import casadi as ca
import numpy as np

from optim.problem.derived_loop import extend
from spacerobot.common.arrays import Array
from spacerobot.quantities import Components, Context, Quantity
from spacerobot.rollout import ClosedLoopFunctions, Measure, Signals, final, integral, peak
from spacerobot.scene import Scene

_REDUCERS = {
    "integral": integral,
    "rms": integral,
    "magnitude": integral,
    "final": final,
    "final_length": final,
}


def context_of(scene: Scene, loop: ClosedLoopFunctions) -> Context:
    """A closed loop of a scene as quantities see it."""
    return Context(scene, loop, Signals.of(loop))


def with_added_states(
    loop: ClosedLoopFunctions, scene: Scene, quantities: Iterable[Quantity], frequency_hz: float
) -> ClosedLoopFunctions:
    """The closed loop with the states that quantities need.

    Args:
        loop, scene: The closed loop, and its scene.
        quantities: Quantities to be measured.
        frequency_hz: Corner frequency of high passes.
    """
    for states in dict.fromkeys(each.states for each in quantities if each.states is not None):
        added = states(scene, frequency_hz)
        if added.names:
            loop = extend(loop, added.names, added.rates)
    return loop


def measure(quantity: Quantity, context: Context) -> tuple[Components, Measure]:
    """Components of a quantity, and their reduction; :meth:`Quantity.reduced` completes it."""
    components = quantity.components(context)
    values = -components.values if quantity.reducer == "lowest" else components.values
    return components, _REDUCERS.get(quantity.reducer, peak)(values)


def measures_of(quantity: Quantity, context: Context) -> tuple[Components, dict[str, Measure]]:
    """Components of a quantity, and the measures by name that :func:`table_values` needs."""
    components, reduced = measure(quantity, context)
    named = {quantity.name: reduced}
    if quantity.exists is not None and components.labels:
        named[_existence(quantity)] = final(ca.vertcat(*quantity.exists(context).values()))
    return components, named


def table_values(quantity: Quantity, measured: Mapping[str, Array], duration_s: float) -> Array:
    """Values (N, n) of a quantity's components; NaN where a rollout diverged or has no such value.

    Args:
        quantity: The quantity.
        measured: Values of the measures of :func:`measures_of` by name, each (N, n).
        duration_s: Duration of the rollouts.
    """
    values = np.asarray(quantity.reduced(np.array(measured[quantity.name]), duration_s))
    if quantity.exists is None:
        return values
    return np.where(np.asarray(measured[_existence(quantity)]) < 0, np.nan, values)


def _existence(quantity: Quantity) -> str:
    return f"{quantity.name}_exists"


def squared_output(quantity: Quantity, context: Context) -> tuple[str, list[int]] | None:
    """Output, and its entries, the integral of whose squares a weight multiplies; None if it is of none."""
    if quantity.reducer != "rms" or not isinstance(quantity.expression, str):
        return None
    output, labels = context.rows(quantity.expression)
    return (output, [row for rows in labels.values() for row in rows]) if labels else None


def required_measure(quantity: Quantity, context: Context, where: str) -> Measure:
    """Measure of a quantity that a scenario names.

    Raises:
        ScenarioError: If the scene has nothing that the quantity describes; ``where`` is the place in the
            scenario.
    """
    components, reduced = measure(quantity, context)
    if not components.labels:
        raise context.scene.error(quantity.absent, where)
    return reduced
