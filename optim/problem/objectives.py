"""Objectives and constraints of a tuning problem, as measures of a rollout."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca

from optim.problem.derived_loop import extend
from optim.problem.margin_terms import MarginTerms
from optim.problem.problem import Form
from optim.problem.quantity_measures import (
    context_of,
    measure,
    required_measure,
    squared_output,
    with_added_states,
)
from spacerobot.common.errors import ScenarioError
from spacerobot.quantities import Context, find_quantity
from spacerobot.rollout import ClosedLoopFunctions, Measure, Measures, Signals, integral, peak
from spacerobot.scenario import Constraints, Objective
from spacerobot.scene import Scene

SMALLEST_LENGTH = 1e-9  # m; keeps the distance smooth where the error is zero
OBJECTIVE, MARGINS = "objective", "margins"
UNITS = {
    "minimax": (1e3, "mm"),
    "ise": (1.0, "m^2 s"),
    "itae": (1.0, "m s^2"),
    "eq45": (1.0, "m^2 s^3"),
    "eq45_printed": (1.0, "m^2 s^3"),
}
"""Factor and unit in which an objective reads well, by kind."""
EQ45 = ("eq45", "eq45_printed")


def reading(objective: Objective) -> tuple[str, float, str]:
    """Name, factor and unit in which an objective reads well; tip errors without weight are not its name."""
    return (objective.kind, *UNITS[objective.kind]) if objective.weight else (OBJECTIVE, 1.0, "")


@dataclass(frozen=True)
class ReducedObjective:
    """An objective that is a function of a measure with several components.

    Attributes:
        measure: Measure of the closed loop's outputs, with n components.
        cost: Function from symbols (n,) of the components to the objective.
    """

    measure: Measure
    cost: Callable[[ca.SX], ca.SX]


UserObjective = Callable[[Signals], Measure | ReducedObjective]
"""A user's own objective: a measure of an expression over the closed loop's outputs, a scalar or reduced."""


@dataclass(frozen=True)
class ObjectiveTerms:
    """Measures of each rollout, and the objective and constraints that are functions of them.

    Attributes:
        measures: Measures, and one cost: the objective.
        form: Form of the objective: ``smooth``, ``minimax`` or ``squares``.
        limits: Limit of each component of each constrained measure, by the measure's name.
        residuals: For ``squares``: outputs, factors w and entries of the outputs. The objective is the sum of
            w times the integral of the squared entries.
        margins: Stability margins in constraints and objective; None without them.
    """

    measures: Measures
    form: Form
    limits: Mapping[str, float] = field(default_factory=dict)
    residuals: Sequence[tuple[str, float, list[int]]] = ()
    margins: MarginTerms | None = None


def extended_loop(loop: ClosedLoopFunctions, scene: Scene, objective: Objective) -> ClosedLoopFunctions:
    """The closed loop with further states for the objective's quantities and Eq. 45.

    Eq. 45 is e = exp(-t_a t) int exp(+-t_a s) (e_x + e_y) ds. Its derivative makes e a state,
    e' = -t_a e + k (e_x + e_y). The plus sign gives k = 1, a leaky integral; the minus sign, which the paper
    prints, gives k = exp(-2 t_a t).

    Raises:
        ScenarioError: If a tip has no amnesia controller, and so no t_a.
    """
    weighed = [find_quantity(name) for name, weight in objective.given.items() if weight]
    loop = with_added_states(loop, scene, weighed, objective.jitter_frequency)
    if objective.kind not in EQ45:
        return loop
    for tip in scene.tips:
        if tip.config.amnesia is None:
            raise scene.error(
                f"Eq. 45 needs t_a, but {tip.path} has no amnesia controller", "tuning.objective.kind"
            )

    def rates(signals: Signals, memory: ca.SX) -> ca.SX:
        memory_rates, error = [], signals["tip_error"]
        for i, tip in enumerate(scene.tips):
            ta = signals.parameters[f"{tip.path}.amnesia.ta"]
            fade = ca.exp(-2 * ta * signals.t) if objective.kind == "eq45_printed" else 1
            memory_rates.append(-ta * memory[i] + fade * ca.sum1(error[3 * i : 3 * i + 3]))
        return ca.vertcat(*memory_rates)

    return extend(loop, [f"{tip.label}/eq45" for tip in scene.tips], rates)


def build_terms(
    loop: ClosedLoopFunctions,
    scene: Scene,
    objective: Objective | UserObjective,
    constraints: Constraints,
) -> ObjectiveTerms:
    """Measures of a tuning problem.

    Args:
        loop: The closed loop, from :func:`extended_loop`.
        scene: Scene of the closed loop.
        objective: The scenario's objective, or a function that gives a scalar measure.
        constraints: Quantities with upper limits.

    Raises:
        ScenarioError: If the objective is not a scalar measure, or a term does not apply to the scene.
    """
    context = context_of(scene, loop)
    signals = context.signals
    # peaks that every rollout reports; of tip errors both signs, which a minimax objective is made of
    error = tip_errors(signals, scene)
    named = {"tip_error_peak": peak(ca.vertcat(error, -error))}
    for name in WATCHED:
        components, watched = measure(find_quantity(name), context)
        if components.labels:
            named[name] = watched
    limits = constraints.given
    for name in limits:
        quantity = find_quantity(name)
        named[name] = required_measure(quantity, context, f"tuning.constraints.max_{quantity.limit}")
    if isinstance(objective, Objective):
        return _standard(context, objective, named, limits)
    function_objective = objective(signals)
    if isinstance(function_objective, Measure) and function_objective.expression.numel() == 1:
        function_objective = ReducedObjective(function_objective, lambda value: value)
    if not isinstance(function_objective, ReducedObjective):
        raise ScenarioError("an objective is one scalar measure: integral(...), peak(...) or final(...)")
    cost = function_objective.cost
    measures = Measures(
        signals, named | {"own": function_objective.measure}, costs=lambda r, _: {OBJECTIVE: cost(r["own"])}
    )
    return ObjectiveTerms(measures, "smooth", limits)


def _standard(
    context: Context, objective: Objective, named: dict[str, Measure], limits: dict[str, float]
) -> ObjectiveTerms:
    """Terms of a scenario's objective, with measures that every rollout has."""
    signals, scene = context.signals, context.scene
    weights = {find_quantity(name): weight for name, weight in objective.given.items() if weight}
    for quantity in weights:
        where = f"tuning.objective.{quantity.weight}"
        named[quantity.name] = required_measure(quantity, context, where)
    error, tips = signals["tip_error"], len(scene.tips)
    track = None  # the largest of the peaks that are watched anyway
    if objective.kind == "ise":
        track = integral(ca.sumsqr(error))
    elif objective.kind == "itae":
        parts = (error[i : i + 3] for i in range(0, error.numel(), 3))
        distances = (ca.sqrt(ca.sumsqr(part) + SMALLEST_LENGTH**2) for part in parts)
        track = integral(ca.SX(signals.t * sum(distances, ca.SX(0))))
    elif objective.kind in EQ45:
        track = integral(ca.sumsqr(signals.x[signals.x.numel() - tips :]))
    if track is not None:
        named["track"] = track

    def costs(r: Mapping[str, ca.SX], _: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        """Objective, from the reduced quantities of a rollout."""
        tracking = ca.mmax(r["tip_error_peak"]) if track is None else r["track"]
        total = objective.weight * tracking
        for quantity, weight in weights.items():
            total = total + weight * ca.sum1(ca.SX(quantity.weighed(r[quantity.name])))
        return {OBJECTIVE: total}

    squares = {quantity: squared_output(quantity, context) for quantity in weights}
    residuals = [
        (output[0], weights[quantity], output[1])
        for quantity, output in squares.items()
        if output is not None
    ]
    if objective.kind == "ise":
        residuals.append(("tip_error", objective.weight, list(range(3 * len(scene.tips)))))
    forms: dict[str, Form] = {"ise": "squares", "minimax": "minimax"}
    form = "smooth" if None in squares.values() else forms.get(objective.kind, "smooth")
    return ObjectiveTerms(Measures(signals, named, costs), form, limits, residuals)


WATCHED = ("joint_torque_peak", "grip_force_peak", "base_rotation_peak")
"""Quantities that every rollout of a tuning problem measures."""


def tip_errors(signals: Signals, scene: Scene) -> ca.SX:
    """Errors of all tips along the axes they can move along, tip by tip [m]."""
    return signals["tip_error"][error_rows(scene)]


def error_rows(scene: Scene) -> list[int]:
    """Indices in ``tip_error`` of the axes that tips can move along, tip by tip."""
    return [3 * i + axis for i in range(len(scene.tips)) for axis in scene.translation_axes]
