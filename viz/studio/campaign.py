"""A cloud of rollouts around a design: its numbers drawn at random, told as it grows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from optim.campaign.draws.sampling import draw
from spacerobot.arrays import Array
from spacerobot.errors import ScenarioError
from spacerobot.rollout import Batch
from spacerobot.scenario import Campaign
from spacerobot.scenario.faults import explain
from viz.studio.job import Job
from viz.studio.messages import Request
from viz.studio.metrics import Metric
from viz.studio.plant import Plant, Plants

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
MOST_SAMPLES = 4096
MOST_TIMES = 201
MOST_PATHS = 100
CHUNK = 64  # rollouts between two messages
OUTPUTS = ("tip_error", "tip_position")


def cloud(_: Plants, plant: Plant, numbers: Mapping[str, float], job: Job) -> None:
    """Roll out samples chunk by chunk, and tell what they say so far.

    Raises
    ------
    SpaceRobotError
        If the request asks for what there is not.
    """
    request, metric = job.request, plant.metric(job.request.text("metric"))
    campaign = _campaign(request, plant, numbers)
    paths = [parameter.paths[0] for parameter in campaign.parameters.values()]
    draws = draw(campaign)
    for path, column in zip(paths, draws.T, strict=True):
        for end in (column.min(), column.max()):
            plant.leaves[path].check(float(end))
    job.tell(always=True, progress=0.0, message="compiling many rollouts at once")
    others = {path: value for path, value in numbers.items() if path not in paths}
    names, fixed = [*paths, *others], list(others.values())
    parts: list[Batch] = []
    for begin in range(0, len(draws), CHUNK):
        piece = draws[begin : begin + CHUNK]
        rows = np.hstack([piece, np.tile(fixed, (len(piece), 1))])
        parts.append(plant.ready.rollout.batch(names, rows, outputs=OUTPUTS, stop=job.stop))
        if job.stop.is_set():
            parts.pop()
            break
        done = begin + len(piece)
        state = "done" if done == len(draws) else "running"
        job.tell(state, always=state == "running", **_told(plant, metric, parts, done, len(draws)))
    if job.stop.is_set():
        done = sum(len(part.done) for part in parts)
        job.tell("stopped", **(_told(plant, metric, parts, done, len(draws)) if parts else {}))


def _campaign(request: Request, plant: Plant, numbers: Mapping[str, float]) -> Campaign:
    """Campaign section of what a request says is uncertain."""
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
        return Campaign.model_validate(document)
    except ValidationError as fault:
        where, message = explain(fault.errors(include_url=False)[0], document)
        raise ScenarioError(message, where=f"spreads ({where})") from None


def _told(plant: Plant, metric: Metric, parts: list[Batch], done: int, total: int) -> dict[str, Any]:
    """What samples say so far: the metric of each, quantiles of tip errors over time, paths of some."""
    every = max(1, len(parts[0].time) // (MOST_TIMES - 1))
    values = metric.factor * np.concatenate([part.costs[metric.key] for part in parts])
    tips = [tip.label for tip in plant.scene.tips]
    return {
        "progress": done / total,
        "message": "",
        "done": done,
        "samples": total,
        "lost": int(np.isnan(values).sum()),
        "quantiles": list(QUANTILES),
        "signals": [{"name": tip, "unit": "mm"} for tip in tips],
        "values": values,
        "time": parts[0].time[::every],
        "bands": _bands(parts, every, len(tips)),
        "paths": _paths(parts, every, len(tips)),
    }


def _bands(parts: list[Batch], every: int, tips: int) -> Array:
    """Quantiles (tips, quantiles, nt) of the sizes of tip errors [mm]."""
    sizes = [
        np.linalg.norm(part.outputs["tip_error"][:, ::every].reshape(len(part.done), -1, tips, 3), axis=-1)
        for part in parts
    ]
    together = 1e3 * np.concatenate(sizes)
    good = together[np.isfinite(together).all(axis=(1, 2))]
    if not len(good):
        return np.full((tips, len(QUANTILES), together.shape[1]), np.nan)
    return np.asarray(np.quantile(good, QUANTILES, axis=0).transpose(2, 0, 1))


def _paths(parts: list[Batch], every: int, tips: int) -> Array:
    """Where the tips of the first samples go (shown, nt, tips, 3) [m]."""
    found: list[Array] = []
    for part in parts:
        if sum(map(len, found)) < MOST_PATHS:
            found.append(part.outputs["tip_position"][:, ::every].reshape(len(part.done), -1, tips, 3))
    return np.concatenate(found)[:MOST_PATHS]
