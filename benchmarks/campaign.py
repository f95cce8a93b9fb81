"""A campaign of the paper's scenario, store and all, against the bare batch of the same rollouts."""

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
"""Enough for a first chunk, from which the rate is learnt, and two that are sized by it."""

PAIRS = 3
KEPT_AT_LEAST = 0.9
BUILDING, ROLLING, MERGING = "building and compiling", "rolling out", "merging"


@dataclass(frozen=True)
class Spent:
    """Time on the clock, and of all processors together [s]."""

    clock: float
    processor: float

    @classmethod
    def now(cls) -> Spent:
        """Since some moment in the past."""
        return cls(time.perf_counter(), time.process_time())

    def since(self, earlier: Spent) -> Spent:
        """From then to now."""
        return Spent(self.clock - earlier.clock, self.processor - earlier.processor)


def row() -> Row:
    """Rollouts a second of the shipped campaign, and how much of the bare batch's rate it keeps.

    Counted is the time on the clock, since a campaign may lose it to threads that wait, from the first
    rollout to the last chunk on disk; building and merging are told apart from it. Where others use the
    cores too, the processor time in the note is the steadier number, but it does not see threads wait.
    """
    scene = load_scene("paper", {"campaign.samples": SAMPLES})
    evaluator = build_evaluator(scene)
    draws, rollouts = all_draws(evaluator), SAMPLES * len(evaluator.members)
    _bare(evaluator, draws[:256])
    phases: list[dict[str, Spent]] = []
    bare: list[Spent] = []
    for pair in range(PAIRS):
        for campaign_now in (pair % 2 == 0, pair % 2 == 1):
            if campaign_now:
                phases.append(_phases(scene))
            else:
                bare.append(_bare(evaluator, draws))
    rolling = [spent[ROLLING] for spent in phases]
    metrics, worked = (
        statistics.median(getattr(b, name) / getattr(c, name) for b, c in zip(bare, rolling, strict=True))
        for name in ("clock", "processor")
    )
    rate, bare_rate = (rollouts / statistics.median(s.clock for s in spent) for spent in (rolling, bare))
    building, merging = (statistics.median(s[name].clock for s in phases) for name in (BUILDING, MERGING))
    rollout = evaluator.members[0].rollout
    how = f"{rollout.kernel.method.name} at {rollout.grid.step_s * 1e3:g} ms"
    return Row(
        f"campaign of the paper's scenario, {rollouts} rollouts of 10 s, {usable_cores()} cores",
        "bare batch of the same rollouts",
        f"{rate:.0f} rollouts/s",
        f"{bare_rate:.0f} rollouts/s",
        metrics,
        f"at least {KEPT_AT_LEAST:g} of it",
        metrics >= KEPT_AT_LEAST,
        f"{how}; by processor time {worked:.3f}; "
        f"in addition building {building:.1f} s, merging {merging:.2f} s",
        {
            "kept_by_processor_time": worked,
            "rolling_s": [spent.clock for spent in rolling],
            "bare_s": [spent.clock for spent in bare],
            "building_s": building,
            "merging_s": merging,
        },
    )


def _phases(scene: Scene) -> dict[str, Spent]:
    """Resources that each phase of a campaign takes, in a store of its own."""
    phases: list[tuple[str, Spent]] = []

    def note(now: CampaignProgress) -> None:
        if not now.total:
            phases.append((now.phase, Spent.now()))

    with tempfile.TemporaryDirectory() as folder:
        run_campaign(scene, Path(folder) / "campaign", progress=note)
        phases.append(("end", Spent.now()))
    return {phase: later.since(at) for (phase, at), (_, later) in itertools.pairwise(phases)}


def _bare(evaluator: CampaignEvaluator, draws: Array) -> Spent:
    """The same rollouts and measures in one batch for each set of gains, nothing kept."""
    begin = Spent.now()
    for member in evaluator.members:
        member.rollout.batch(member.space.paths, member.space.values(draws))
    return Spent.now().since(begin)
