"""Measures over outputs that exist for some labels only.

If an element declares no output that others of its dimension declare, its entries are constant NaN
(:func:`spacerobot.closedloop.outputs.combine`). An integral over such an entry would end every rollout at its
first step, and a cost of it would have no value; both are refused before compilation.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from spacerobot.common.errors import SpaceRobotError
from spacerobot.rollout.closed_loop_protocol import ClosedLoopFunctions
from spacerobot.rollout.measures import Measures


def check_measures(loop: ClosedLoopFunctions, measures: Measures, outputs: Sequence[ca.SX]) -> None:
    """Refuse integrals and costs that are NaN in every rollout.

    Args:
        loop: The closed loop.
        measures: Measures to check.
        outputs: The loop's outputs as expressions, in their order, each (n,).

    Raises:
        SpaceRobotError: If there is one; the message names it, its signal, and the labels that the signal
            has.
    """
    symbols = measures.signals.outputs
    absent = {
        name: [k for k in range(value.numel()) if value[k].is_constant() and np.isnan(float(value[k]))]
        for name, value in zip(symbols, outputs, strict=True)
    }
    entries = [(name, symbols[name][k]) for name, places in absent.items() for k in places]
    if not entries:
        return

    def refuse(subject: str, signal: str) -> SpaceRobotError:
        """Error that lists the existing entries of a signal."""
        size = symbols[signal].numel()
        variable = next(
            (candidate for candidate in getattr(loop, "variables", ()) if candidate.name == signal), None
        )
        labels = variable.labels if variable is not None else ()
        each = size // len(labels) if labels else 1
        existing_entries = [
            f"{label} ({k * each}:{(k + 1) * each})"
            for k, label in enumerate(labels)
            if k * each not in absent[signal]
        ]
        return SpaceRobotError(
            f"{subject} depends on {signal!r} where that does not exist; take the entries of "
            f"{', '.join(existing_entries) or 'no label'}"
        )

    r = {name: ca.SX.sym(name, measure.expression.numel()) for name, measure in measures.named.items()}
    lost: list[tuple[str, ca.SX]] = []
    for name, measure in measures.named.items():
        for k in range(measure.expression.numel()):
            lost_signals = [
                signal for signal, symbol in entries if ca.depends_on(measure.expression[k], symbol)
            ]
            if lost_signals and measure.kind == "integral":
                raise refuse(f"the integral {name!r}", lost_signals[0])
            lost += [(lost_signals[0], r[name][k])] if lost_signals else []
    p = {path: ca.SX.sym(path) for path in loop.parameter_paths}
    for name, cost in measures.cost_expressions(r, p).items() if lost else ():
        for signal, entry in lost:
            if ca.depends_on(cost, entry):
                raise refuse(f"the cost {name!r}", signal)
