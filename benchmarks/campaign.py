"""Campaign of the paper's scenario, including its store, against a batch of the same rollouts."""

from __future__ import annotations

import itertools
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.table_row import Row
from optim.campaign import CampaignEvaluator, CampaignProgress, all_draws, build_evaluator, run_campaign
from spacerobot.common.arrays import Array
from spacerobot.compiled import usable_cores
from spacerobot.scene import Scene, load_scene

SAMPLES = 2048
"""Number of samples: a first chunk, from which the rate is measured, and two chunks of the size it gives."""

PAIRS = 3
MIN_RATIO = 0.9
BUILDING, ROLLING, MERGING = "building and compiling", "rolling out", "merging"


@dataclass(frozen=True)
class Times:
    """Wall time, and processor time of all threads together [s]."""

    clock: float
    processor: float

    @classmethod
    def now(cls) -> Times:
        """Present readings of both clocks."""
        return cls(time.perf_counter(), time.process_time())

    def since(self, earlier: Times) -> Times:
        """Times between an earlier reading and this one."""
        return Times(self.clock - earlier.clock, self.processor - earlier.processor)


def row() -> Row:
    """Row: rollouts per second of the shipped campaign, relative to those of the batch.

    The rate is by wall time, which includes waiting threads, from the first rollout to the last chunk on
    disk; building and merging are stated separately. On a shared machine the ratio of processor times in the
    note scatters less, but it does not include waiting.
    """
    scene = load_scene("paper", {"campaign.samples": SAMPLES})
    evaluator = build_evaluator(scene)
    draws, rollouts = all_draws(evaluator), SAMPLES * len(evaluator.members)
    _bare(evaluator, draws[:256])
    phases: list[dict[str, Times]] = []
    bare: list[Times] = []
    for pair in range(PAIRS):
        for campaign_now in (pair % 2 == 0, pair % 2 == 1):
            if campaign_now:
                phases.append(_phases(scene))
            else:
                bare.append(_bare(evaluator, draws))
    rolling = [times[ROLLING] for times in phases]
    ratio, processor_ratio = (
        statistics.median(getattr(b, name) / getattr(c, name) for b, c in zip(bare, rolling, strict=True))
        for name in ("clock", "processor")
    )
    rate, bare_rate = (rollouts / statistics.median(s.clock for s in times) for times in (rolling, bare))
    building, merging = (statistics.median(s[name].clock for s in phases) for name in (BUILDING, MERGING))
    rollout = evaluator.members[0].rollout
    how = f"{rollout.kernel.method.name} at {rollout.grid.step_s * 1e3:g} ms"
    return Row(
        f"campaign of the paper's scenario, {rollouts} rollouts of 10 s, {usable_cores()} cores",
        "bare batch of the same rollouts",
        f"{rate:.0f} rollouts/s",
        f"{bare_rate:.0f} rollouts/s",
        ratio,
        f"at least {MIN_RATIO:g} of it",
        ratio >= MIN_RATIO,
        f"{how}; by processor time {processor_ratio:.3f}; "
        f"in addition building {building:.1f} s, merging {merging:.2f} s",
        {
            "ratio_by_processor_time": processor_ratio,
            "rolling_s": [each.clock for each in rolling],
            "bare_s": [each.clock for each in bare],
            "building_s": building,
            "merging_s": merging,
        },
    )


def _phases(scene: Scene) -> dict[str, Times]:
    """Times of each phase of a campaign with a new store."""
    phases: list[tuple[str, Times]] = []

    def note(now: CampaignProgress) -> None:
        if not now.total:
            phases.append((now.phase, Times.now()))

    with tempfile.TemporaryDirectory() as folder:
        run_campaign(scene, Path(folder) / "campaign", progress=note)
        phases.append(("end", Times.now()))
    return {phase: later.since(at) for (phase, at), (_, later) in itertools.pairwise(phases)}


def _bare(evaluator: CampaignEvaluator, draws: Array) -> Times:
    """Times of the same rollouts and measures in one batch for each set of gains, without a store."""
    begin = Times.now()
    for member in evaluator.members:
        member.rollout.batch(member.space.paths, member.space.values(draws))
    return Times.now().since(begin)
