"""Monte Carlo rollouts around a design, with results sent as they arrive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from optim.campaign.sampling.samplers import draw
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.scenario import Campaign
from spacerobot.scenario.validation_errors import explain
from viz.page.campaign_spread import CampaignSpread
from viz.studio.job import Job
from viz.studio.prepared_design import DesignCache, PreparedDesign

MOST_SAMPLES = 4096
CHUNK = 64  # rollouts between two messages


def cloud(_: DesignCache, plant: PreparedDesign, numbers: Mapping[str, float], job: Job) -> None:
    """Roll out random samples chunk by chunk, and send the results so far.

    Raises:
        SpaceRobotError: If the request names an unknown metric or parameter.
    """
    request, metric = job.request, plant.metrics[job.request.text("metric")]
    # campaign section with the uncertain numbers of the request
    spreads = request.pairs("spreads")
    if not spreads:
        raise ScenarioError("pin the numbers that are uncertain first")
    nominal = plant.nominal | dict(numbers)
    parameters: dict[str, Any] = {}
    for i, (path, spread) in enumerate(spreads.items()):
        if path not in plant.free or not isinstance(spread, dict) or not isinstance(spread.get("kind"), str):
            raise ScenarioError("no number that can be drawn", where=path)
        about = {"mean": float(nominal[path])} if spread.get("kind") in ("normal", "truncated_normal") else {}
        parameters[f"n{i}"] = {"paths": [path], **about, **spread}
    document = {"parameters": parameters, "samples": request.count("samples", 256, MOST_SAMPLES)}
    try:
        campaign = Campaign.model_validate(document)
    except ValidationError as fault:
        where, message = explain(fault.errors(include_url=False)[0], document)
        raise ScenarioError(message, where=f"spreads ({where})") from None
    paths = [parameter.paths[0] for parameter in campaign.parameters.values()]
    draws = draw(campaign)
    for path, column in zip(paths, draws.T, strict=True):
        for end in (column.min(), column.max()):
            plant.leaves[path].check(float(end))
    job.tell(always=True, progress=0.0, message="compiling many rollouts at once")
    fixed_numbers = {path: value for path, value in numbers.items() if path not in paths}
    names, fixed = [*paths, *fixed_numbers], list(fixed_numbers.values())
    gathered, costs = CampaignSpread(plant.scene, plant.ready.rollout), np.zeros(0)
    chunk = min(CHUNK, gathered.most)
    for begin in range(0, len(draws), chunk):
        piece = draws[begin : begin + chunk]
        rows = np.hstack([piece, np.tile(fixed, (len(piece), 1))])
        batch = gathered.roll(names, rows, job.stop)
        if job.stop.is_set():
            break
        costs = np.concatenate([costs, batch.costs[metric.key]])
        state = "done" if len(costs) == len(draws) else "running"
        job.tell(state, always=state == "running", **_progress(gathered, metric.factor * costs, len(draws)))
    if job.stop.is_set():
        job.tell("stopped", **(_progress(gathered, metric.factor * costs, len(draws)) if costs.size else {}))


def _progress(spread: CampaignSpread, values: Array, total: int) -> dict[str, Any]:
    """Message about the samples so far: metric values, quantiles of signals over time, some paths."""
    return {
        "progress": len(values) / total,
        "message": "",
        "done": len(values),
        "samples": total,
        "lost": int(np.isnan(values).sum()),
        "values": values,
        **spread.data(),
    }
