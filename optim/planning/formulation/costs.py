"""Terms of the cost: the kinds of the `costs` section at one instant, and what is reported of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import casadi as ca
import numpy as np

from optim.planning.formulation.instant_view import InstantView
from optim.planning.formulation.stage import Stage
from spacerobot.elements.plan_cost import PlanCost
from spacerobot.scenario.plan import PlanSection


def cost_terms(stage: Stage, plan: PlanSection) -> tuple[dict[str, ca.SX], dict[str, ca.SX]]:
    """Integrands, and what the last instant costs, by name, without their weights.

    Those without a weight are left out, and those about nothing that there is at this instant.
    """
    found: dict[str, dict[str, ca.SX]] = {"motion": {}, "end": {}}
    for name, cost in plan.costs.items():
        if cost.weight and cost.of != "duration":
            value = ca.SX(cost.expression(InstantView(stage, f"plan.costs.{name}", plan.goals)))
            if ca.depends_on(value, stage.z):
                found[cost.of][name] = value
    return found["motion"], found["end"]


def magnitudes(stage: Stage, plan: PlanSection, terms: Iterable[str]) -> dict[str, ca.SX]:
    """Forces (n x 1) [N] whose magnitudes terms round off, by name, where there are any."""
    views = {name: InstantView(stage, f"plan.costs.{name}", plan.goals) for name in terms}
    found = {name: ca.SX(plan.costs[name].magnitudes(one)) for name, one in views.items()}
    return {name: forces for name, forces in found.items() if forces.numel()}


def reported(cost: PlanCost, integral: float, duration: float) -> float:
    """Value that is reported of a term, from its integral without the weight, and the duration [s]."""
    if cost.reported == "integral":
        return integral
    return float(np.sqrt(integral / (duration if cost.reported == "rms" else 1.0)))


def headings(costs: Mapping[str, PlanCost]) -> dict[str, str]:
    """Words for what is reported of each term, by name."""
    found = {}
    for name, cost in costs.items():
        words = "duration" if cost.of == "duration" else name.replace("_", " ")
        found[name] = f"{words}, rms" if cost.reported == "rms" else words
    return found
