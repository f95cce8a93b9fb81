"""All samples of a campaign for its animated page: their metrics, and some of them rolled out again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from optim.campaign import CampaignEvaluator

MOST_AGAIN = 100
"""Samples that are rolled out again."""


def spreads(evaluator: CampaignEvaluator, data: xr.Dataset) -> list[dict[str, Any]]:
    """Data of all samples for the page, one entry for each set of gains.

    Parameters
    ----------
    evaluator
        Of the campaign.
    data
        Its draws and metrics.
    """
    if evaluator.members[0].continuous.engines.toolchain is None:  # opened again without its rollouts
        evaluator = evaluator.recipe.build()
    return [_spread(evaluator, data, name, MOST_AGAIN) for name in evaluator.gains]


def distributions(evaluator: CampaignEvaluator, data: xr.Dataset) -> list[dict[str, Any]]:
    """The same as far as it is known without a rollout: how the metrics are distributed."""
    return [_spread(evaluator, data, name, 0) for name in evaluator.gains]


def _spread(evaluator: CampaignEvaluator, data: xr.Dataset, gains: str, again: int) -> dict[str, Any]:
    from spacerobot.quantities import metrics as all_metrics
    from viz.figures.style import unit_scale
    from viz.page.campaign_spread import CampaignSpread
    from viz.page.meshcat_scene import packed

    member = evaluator.member(gains)
    again = 0 if evaluator.solves_plans else again  # each takes seconds
    spread = CampaignSpread(member.scene, member.continuous)
    rows = member.space.values(data.draw.values[:again])
    for begin in range(0, len(rows), spread.most):
        spread.roll(member.space.paths, rows[begin : begin + spread.most])
    metrics = []
    for key, quantity in all_metrics().items():
        if key in data:
            factor, unit = unit_scale(str(data[key].attrs["units"]))
            values = factor * data[key].sel(gains=gains).max(f"{key}_of", skipna=False)
            metrics.append(
                {"key": key, "label": quantity.label, "unit": unit, "values": packed(values.values)}
            )
    return {"name": gains, "metrics": metrics, **spread.data()}
