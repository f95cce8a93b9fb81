"""Terms of the cost: the kinds of the `costs` section at one instant, and what is reported of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import casadi as ca
import numpy as np

from optim.planning.formulation.instant_view import InstantView
from optim.planning.formulation.stage import Stage
from spacerobot.elements.plan_cost import PlanCost
from spacerobot.elements.plan_instant import BoundedRow, zero
from spacerobot.scenario.plan import PlanSection


def cost_terms(
    stage: Stage, plan: PlanSection, forces: Mapping[str, ca.SX]
) -> tuple[dict[str, ca.SX], dict[str, ca.SX]]:
    """Integrands, and what the last instant costs, by name, without their weights.

    Those without a weight are left out, and those about nothing that there is at this instant.

    Parameters
    ----------
    stage, plan
        An instant with the parts of the forces, and the section.
    forces
        Forces whose magnitudes are integrands, by name, as :func:`magnitudes` finds them.
    """
    found: dict[str, dict[str, ca.SX]] = {"motion": {}, "end": {}}
    parts = dict(zip(forces, split_parts(stage, forces), strict=True))
    for name, cost in plan.costs.items():
        if name in parts:
            found["motion"][name] = ca.sum1(ca.vertcat(*parts[name]))
        elif cost.weight and cost.of != "duration":
            value = ca.SX(cost.expression(InstantView(stage, f"plan.costs.{name}", plan.goals)))
            if ca.depends_on(value, stage.z):
                found[cost.of][name] = value
    return found["motion"], found["end"]


def magnitudes(stage: Stage, plan: PlanSection) -> dict[str, ca.SX]:
    """Forces (n x 1) [N] whose magnitudes are integrands of weighted terms, by name, where there are any."""
    found = {
        name: ca.SX(cost.magnitudes(InstantView(stage, f"plan.costs.{name}", plan.goals)))
        for name, cost in plan.costs.items()
        if cost.weight
    }
    return {name: forces for name, forces in found.items() if forces.numel()}


def split_parts(stage: Stage, forces: Mapping[str, ca.SX]) -> list[tuple[ca.SX, ca.SX]]:
    """Positive and negative parts (n x 1 each) of the forces of each term, in turn."""
    sizes = [one.numel() for one in forces.values() for _ in range(2)]
    parts = ca.vertsplit(stage.s, np.cumsum([0, *sizes]).tolist()) if sizes else []
    return list(zip(parts[::2], parts[1::2], strict=True))


def split_rows(stage: Stage, forces: Mapping[str, ca.SX]) -> Iterator[BoundedRow]:
    """Equations of forces and their parts: f = f+ - f-."""
    for (name, each), (positive, negative) in zip(forces.items(), split_parts(stage, forces), strict=True):
        for k, off in enumerate(ca.vertsplit(each - (positive - negative))):
            yield zero(f"{name}: parts of force {k + 1}", "N", off)


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
