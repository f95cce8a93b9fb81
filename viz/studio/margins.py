"""Stability margins of a design's loops, computed in the background."""

from __future__ import annotations

import math
from collections.abc import Mapping

from spacerobot.common.errors import ScenarioError
from spacerobot.common.section import is_number
from spacerobot.linear import margins
from spacerobot.linear.loop_margins import UNITS, is_destabilised
from viz.studio.job import Job, StoppedError
from viz.studio.prepared_design import DesignCache, PreparedDesign


def loop_margins_job(plants: DesignCache, _: PreparedDesign, __: Mapping[str, float], job: Job) -> None:
    """Compute the margins of all loops of a design at one time, and send them sorted by disk margin.

    Args:
        plants: Prepared structures of designs.
        job: Job whose request has ``values`` and the time ``at`` [s].

    Raises:
        SpaceRobotError: See :func:`spacerobot.linear.margins`.
    """

    def tell(words: str) -> None:
        if job.stop.is_set():
            raise StoppedError
        job.tell(message=words)

    at = job.request.more.get("at", 0.0)
    if not is_number(at) or not math.isfinite(at):
        raise ScenarioError(f"found {at!r}, allowed: a time in s", where="at")
    scene = plants.origin.build(plants.changes(job.request.values))
    try:
        analysis = margins(scene, [float(at)], progress=tell)
    except StoppedError:
        job.tell("stopped", progress=1.0, message="")
        return
    (linear,), (loops,) = analysis.linearisations, analysis.loops
    ranked = sorted(loops, key=lambda one: (math.isnan(one.disk), one.disk, one.phase))
    job.tell(
        "done",
        progress=1.0,
        message="",
        at=linear.label,
        growing=len(linear.growing),
        fastest=linear.growth_rate,
        destabilised=is_destabilised(linear, loops),
        units=UNITS,
        # infinite margins become null, as do all margins of a loop with a time-varying linearisation
        loops=[
            {"name": one.name, "varies": math.isnan(one.disk)} | {name: getattr(one, name) for name in UNITS}
            for one in ranked
        ],
    )
