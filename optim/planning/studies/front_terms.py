"""Check of the two terms of a Pareto front, before the problem is formulated."""

from __future__ import annotations

from collections.abc import Sequence

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.quantities import planned
from spacerobot.scenario.document import MISSING_SECTIONS
from spacerobot.scene import Scene


def check_terms(scene: Scene, terms: Sequence[str]) -> None:
    """Check the terms of a front.

    Args:
        scene: The scene.
        terms: Names of the terms.

    Raises:
        ScenarioError: If they are not two different terms with weights, the duration to be swept is fixed,
            the plan has several phases, or the scene has no ``plan`` section.
    """
    plan = scene.scenario.plan
    if plan is None:
        raise scene.error(MISSING_SECTIONS["plan"], "plan")
    if len(terms) != 2:
        message = f"found {','.join(terms)!r}, allowed: two terms of the cost, as time,base_rotation"
        raise ScenarioError(message, where="--pareto")
    if len(plan.by_phase) > 1:
        raise scene.error("a front takes a plan of one phase", "plan.phases")
    (section,) = plan.by_phase.values()
    known = dict.fromkeys([*section.costs, *planned()])
    for name in terms:
        if name not in known:
            raise ScenarioError(f"no term {name!r}; {near_names(name, known)}", where="--pareto")
        if name != "time" and not (name in section.costs and section.costs[name].weight):
            raise scene.error(
                "has no weight, so that nothing makes it small; give it one", f"plan.costs.{name}"
            )
    if terms[0] == terms[1]:
        raise ScenarioError(f"found {terms[0]!r} twice, allowed: two terms", where="--pareto")
    if "time" in terms and section.duration.lower == section.duration.upper:
        raise scene.error(
            f"found {section.duration.lower:g} s; a front over time needs limits of the duration, as "
            "{lower: 6, upper: 12}",
            "plan.duration",
        )
