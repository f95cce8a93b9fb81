"""Quantity of a failure, and its limit."""

from __future__ import annotations

from optim.campaign.sampling.parameter_space import campaign_of
from spacerobot.quantities import Quantity, find_quantity
from spacerobot.scene import Scene


def bounded_quantity(
    scene: Scene, quantity: str | None = None, limit: float | None = None
) -> tuple[Quantity, float]:
    """Quantity whose values above a limit are failures, and that limit in the quantity's unit.

    Args:
        scene: A scene whose scenario has a ``campaign`` section.
        quantity: Name of a registered quantity; the one that ``campaign.limits`` bounds if None.
        limit: Largest value that is not a failure; that of ``campaign.limits`` if None.

    Raises:
        ScenarioError: If the section is missing, or does not bound exactly one quantity where none is named.
        SpaceRobotError: If there is no such quantity.
    """
    limits = campaign_of(scene).limits.given
    if quantity is None and len(limits) != 1:
        limited_names = ", ".join(limits) or "none"
        raise scene.error(
            f"limits of exactly one quantity are needed, found {limited_names}; "
            "name one with --metric and --limit",
            "campaign.limits",
        )
    chosen = find_quantity(quantity or next(iter(limits)))
    bound = limits.get(chosen.name) if limit is None else limit
    if bound is None:
        raise scene.error(f"no limit of {chosen.name}; give one with --limit", "campaign.limits")
    return chosen, float(bound)
