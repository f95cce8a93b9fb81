"""Data of a campaign that pages show, made from its folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import xarray as xr

from optim.campaign import (
    CampaignEvaluator,
    load_campaign,
    read_bands,
    reopen,
    simulate_sample,
    summary_data,
)
from spacerobot.common.errors import ResultError, SpaceRobotError
from spacerobot.common.tables import unit_scale
from spacerobot.quantities import metrics
from spacerobot.result import Result
from viz.page.animation import still
from viz.page.campaign_spread import CampaignSpread
from viz.page.meshcat_scene import packed
from viz.report.campaign_section import CampaignReport, campaign_report

MAX_ROLLOUTS = 100
"""Maximum number of samples that are rolled out again for the animated page."""


def campaign_data(
    folder: Path, progress: Callable[[str], object], evaluator: CampaignEvaluator | None = None
) -> CampaignReport:
    """Data of a campaign that pages show.

    Args:
        folder: Folder of the campaign.
        progress: Called with a text at each stage.
        evaluator: Evaluator of the campaign; rebuilt from the folder if None.

    Raises:
        ResultError: If the folder has no readable campaign (see :func:`optim.campaign.reopen`), or none of
            its samples starts.
    """
    if evaluator is None:
        progress("opening the campaign")
        evaluator = reopen(folder)
    progress("computing statistics")
    summary = summary_data(folder, evaluator)
    worst = {name: statistics["worst"][0] for name, statistics in summary["gains"].items()}
    progress("reading the kept signals")
    bands = {
        signal: {name: read_bands(folder, signal, name, row["sample"]) for name, row in worst.items()}
        for signal in evaluator.recording.names
    }
    progress("simulating the worst samples")
    results: dict[str, Result] = {}
    faults: dict[str, str] = {}
    for name, row in worst.items():
        if row["unclosed"]:
            continue
        try:
            results[name] = simulate_sample(evaluator, list(row["draw"].values()), name)
        except SpaceRobotError as fault:  # the page states why the sample cannot begin
            faults[name] = fault.message
    if not results and not faults:
        cause = next(iter(worst.values()))["unclosed"]
        raise ResultError(f"no sample begins, so there is nothing to show: {cause}", source=folder)
    progress("simulating some samples for the animation")
    data = load_campaign(folder)
    return CampaignReport(summary, data, results, bands, spreads(evaluator, data) if results else (), faults)


def campaign_page(
    folder: Path, progress: Callable[[str], object], evaluator: CampaignEvaluator | None = None
) -> str:
    """HTML of the report about a campaign; see :func:`campaign_data`."""
    campaign = campaign_data(folder, progress, evaluator)
    progress("writing the page")
    return campaign_report(campaign)


def first_page(folder: Path, evaluator: CampaignEvaluator) -> dict[str, Any]:
    """Data of the animated page that need no compilation: the scene at rest, and the spread of the metrics.

    Raises:
        ResultError: If the samples cannot be read.
    """
    data, scene = load_campaign(folder), evaluator.members[0].scene
    design = {"name": scene.scenario.name, "values": [], "numbers": {}}
    distributions = [_spread(evaluator, data, name, 0) for name in evaluator.gains]
    panel = {"metrics": [], "designs": [design], "first": 1, "spreads": distributions}
    about = f"campaign of {data.sizes['sample']} samples; the worst ones are being simulated"
    return still(scene, about=about) | {"panel": panel}


def spreads(evaluator: CampaignEvaluator, data: xr.Dataset) -> list[dict[str, Any]]:
    """Data of all samples for the animated page, one entry for each set of gains.

    Args:
        evaluator: Evaluator of the campaign.
        data: Draws and metrics of its samples.
    """
    if evaluator.members[0].rollout.continuous.engines.toolchain is None:  # opened again without its rollouts
        evaluator = evaluator.recipe.build()
    return [_spread(evaluator, data, name, MAX_ROLLOUTS) for name in evaluator.gains]


def _spread(evaluator: CampaignEvaluator, data: xr.Dataset, gains: str, rollouts: int) -> dict[str, Any]:
    """Metrics of all samples with one set of gains, and signals and paths of the first rollouts."""
    member = evaluator.member(gains)
    rollouts = 0 if evaluator.has_updates else rollouts  # each takes seconds
    spread = CampaignSpread(member.scene, member.rollout.continuous)
    rows = member.space.values(data.draw.values[:rollouts])
    for begin in range(0, len(rows), spread.most):
        spread.roll(member.space.paths, rows[begin : begin + spread.most])
    columns = []
    for key, quantity in metrics().items():
        if key in data:
            factor, unit = unit_scale(str(data[key].attrs["units"]))
            values = factor * data[key].sel(gains=gains).max(f"{key}_of", skipna=False)
            columns.append(
                {"key": key, "label": quantity.label, "unit": unit, "values": packed(values.values)}
            )
    return {"name": gains, "metrics": columns, **spread.data()}
