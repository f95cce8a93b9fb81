"""Cost terms at one instant, from the kinds of the `costs` section, and their labels in reports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import casadi as ca
import numpy as np

from optim.planning.formulation.instant_view import InstantView
from optim.planning.formulation.stage import Stage
from spacerobot.elements.goals.plan_instant import BoundedRow, zero
from spacerobot.scenario.plan import PlanSection
from spacerobot.scenario.plan_cost import PlanCost


def cost_terms(
    stage: Stage, plan: PlanSection, forces: Mapping[str, ca.SX]
) -> tuple[dict[str, ca.SX], dict[str, ca.SX]]:
    """Integrands and terminal costs by name, without their weights.

    Terms without a weight are left out, and so are terms about something that is absent at this instant.

    Args:
        stage, plan: Instant, with symbols of the parts of forces, and the plan section.
        forces: Forces whose magnitudes are integrands, by name, as :func:`magnitudes` finds them.
    """
    terms, ends = dict[str, ca.SX](), dict[str, ca.SX]()
    parts = dict(zip(forces, split_parts(stage, forces), strict=True))
    for name, cost in plan.costs.items():
        if name in parts:
            terms[name] = ca.sum1(ca.vertcat(*parts[name]))
        elif cost.weight and name != "time":
            value = cost.expression(InstantView(stage, f"plan.costs.{name}", plan.goals))
            if ca.depends_on(value, stage.z):
                (ends if cost.weighs.reducer == "final_length" else terms)[name] = value
    return terms, ends


def magnitudes(stage: Stage, plan: PlanSection) -> dict[str, ca.SX]:
    """Forces (n x 1) [N] whose magnitudes are integrands of weighted terms, by name.

    They are linear in the drives. The solver splits each into two parts, f = f+ - f- with f+ >= 0 and f- >=
    0. At a minimum of f+ + f- one part is zero, so the sum is the magnitude |f|, without its kink at zero.
    """
    forces_by_name = dict[str, ca.SX]()
    for name, cost in plan.costs.items():
        if cost.weight and cost.weighs.reducer == "magnitude":
            columns = cost.columns(InstantView(stage, f"plan.costs.{name}", plan.goals))
            forces = ca.vertcat(ca.SX(0, 1), *columns.values())
            forces_by_name[name] = forces[forces.sparsity().row()]
    return {name: forces for name, forces in forces_by_name.items() if forces.numel()}


def split_parts(stage: Stage, forces: Mapping[str, ca.SX]) -> list[tuple[ca.SX, ca.SX]]:
    """Positive and negative parts (n x 1 each) of each term's forces, in the order of ``forces``."""
    sizes = [one.numel() for one in forces.values() for _ in range(2)]
    parts = ca.vertsplit(stage.s, np.cumsum([0, *sizes]).tolist()) if sizes else []
    return list(zip(parts[::2], parts[1::2], strict=True))


def split_rows(stage: Stage, forces: Mapping[str, ca.SX]) -> Iterator[BoundedRow]:
    """Equality constraints f = f+ - f- between forces and their parts."""
    for (name, each), (positive, negative) in zip(forces.items(), split_parts(stage, forces), strict=True):
        for k, off in enumerate(ca.vertsplit(each - (positive - negative))):
            yield zero(f"{name}: parts of force {k + 1}", "N", off)


def headings(costs: Mapping[str, PlanCost]) -> dict[str, str]:
    """Label of the quantity of each cost term, by name."""
    return {
        name: cost.weighs.label if name == cost.kind else f"{name}: {cost.weighs.label}"
        for name, cost in costs.items()
    }
