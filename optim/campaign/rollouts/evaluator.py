"""Rollouts of a campaign: draws in, a table of numbers for each set of gains out."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from optim.campaign.rollouts.gain_sets import NOMINAL, Gains
from optim.campaign.rollouts.metrics import (
    CampaignMetrics,
    MetricColumn,
    build_campaign_metrics,
)
from optim.campaign.rollouts.series import SignalRecording, build_recording, check_size, series_step
from optim.campaign.sampling.parameter_space import (
    ParameterSpace,
    campaign_of,
    check_range,
    gain_set,
    resolve_space,
)
from optim.campaign.sampling.samplers import draw
from optim.problem.quantity_measures import with_added_states
from optim.problem.scene_recipe import BuildRecipe, SceneRecipe
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.quantities import default_metrics, find_quantity
from spacerobot.rollout import Rollout, build_rollout, time_grid
from spacerobot.rollout.build import Options
from spacerobot.scenario import Campaign
from spacerobot.scenario.load import to_document
from spacerobot.scene import Scene
from spacerobot.updates import UpdatedRollout, UpdatedScene

ASKED_AFTERWARDS = ("limits", "require_captures", "percentiles", "confidence", "gains")
"""Fields of the section that change no rollout (``gains`` are kept beside it)."""


@dataclass(frozen=True)
class SampleTable:
    """Numbers of n samples under G sets of gains.

    Attributes:
        draws: Values of the uncertain parameters (n, k).
        metrics: Values of the columns (n, G, M); NaN where a rollout diverged or has no such value.
        diverged_at_s: Time of the last good state (n, G); NaN where a rollout completed.
        gaps: Initial gaps of the L grasps that may begin open (n, G, L) [m].
        series: Signals over time by name, each (n, G, nt, c); NaN after divergence.
    """

    draws: Array
    metrics: Array
    diverged_at_s: Array
    gaps: Array
    series: Mapping[str, Array] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.draws)

    def part(self, rows: slice) -> SampleTable:
        """Some of the samples."""
        series = {name: values[rows] for name, values in self.series.items()}
        return SampleTable(
            self.draws[rows], self.metrics[rows], self.diverged_at_s[rows], self.gaps[rows], series
        )

    @classmethod
    def joined(cls, tables: Sequence[SampleTable]) -> SampleTable:
        """The samples of several tables, one after the other."""
        if len(tables) == 1:
            return tables[0]
        return cls(
            np.concatenate([table.draws for table in tables]),
            np.concatenate([table.metrics for table in tables]),
            np.concatenate([table.diverged_at_s for table in tables]),
            np.concatenate([table.gaps for table in tables]),
            {name: np.concatenate([table.series[name] for table in tables]) for name in tables[0].series},
        )


@dataclass(frozen=True)
class GainSet:
    """Compiled form of one set of gains: scene, parameter space, metrics, recorded signals and rollout."""

    scene: Scene
    space: ParameterSpace
    campaign_metrics: CampaignMetrics
    recording: SignalRecording
    rollout: Rollout | UpdatedRollout
    updated: UpdatedScene | None = None


@dataclass(frozen=True)
class CampaignEvaluator:
    """A campaign ready to run.

    Attributes:
        scene: The scenario's own scene.
        campaign: Campaign section.
        gains: Changes by name of the set.
        members: Compiled form of each set of gains.
    """

    scene: Scene
    campaign: Campaign
    gains: Gains
    members: tuple[GainSet, ...]

    def __repr__(self) -> str:
        """Scenario, samples and sets of gains, in one line."""
        name, gains = self.scene.scenario.name, ", ".join(self.gains)
        return f"<Evaluator of {name}: {self.campaign.count} samples; gains {gains}>"

    @property
    def columns(self) -> tuple[MetricColumn, ...]:
        """Metric columns that are kept, M of them."""
        return self.members[0].campaign_metrics.columns

    @property
    def recording(self) -> SignalRecording:
        """Signals that are kept over time."""
        return self.members[0].recording

    @property
    def max_gaps(self) -> Mapping[str, float]:
        """Maximum gap at the start of each grasp whose rollouts need not start closed, by grasp [m]."""
        return self.members[0].rollout.kernel.closure.largest

    @property
    def has_updates(self) -> bool:
        """Whether Python updates controllers during rollouts, such as by solving plans."""
        return any(member.updated is not None for member in self.members)

    @property
    def bytes_per_sample(self) -> int:
        """Memory of a sample's series, all sets of gains together [bytes]."""
        return len(self.members) * self.recording.bytes_per_rollout

    def member(self, gains: str) -> GainSet:
        """The member of one set of gains."""
        return self.members[list(self.gains).index(gains)]

    @property
    def recipe(self) -> BuildRecipe:
        """Recipe that builds the same evaluator in another process."""
        return BuildRecipe(SceneRecipe.of(self.scene), build_evaluator, {"gains": self.gains})

    def identity(self, draws: Array) -> dict[str, Any]:
        """Data that determines the numbers: plain data with comparable leaves, and a hash of everything.

        Args:
            draws: Draws of all samples (N, k).
        """
        document = to_document(self.scene.scenario)
        document.pop("tuning", None)
        for name in ASKED_AFTERWARDS:
            document["campaign"].pop(name)
        plain: dict[str, Any] = {
            "scenario": document,
            "gains": {name: dict(changes) for name, changes in self.gains.items()},
            "urdf": {body.name: body.description.sha256 for body in self.scene.bodies},
        }
        plain = json.loads(json.dumps(plain))
        digest = hashlib.sha256(json.dumps(plain, sort_keys=True).encode())
        digest.update(np.ascontiguousarray(draws).tobytes())
        for member in self.members:
            for name in ("setup", "dynamics", "normalise", "final"):
                function = member.rollout.kernel.functions.get(name)
                digest.update(b"-" if function is None else function.serialize().encode())
            digest.update(np.ascontiguousarray(member.rollout.values()).tobytes())
        return plain | {"fingerprint": digest.hexdigest()}

    def evaluate(self, draws: Array, threads: int | None = None) -> SampleTable:
        """Evaluate rollouts of some draws under every set of gains.

        The numbers of a draw depend neither on the others nor on the threads, not even by a bit.

        Args:
            draws: Draws of k parameters, (n, k).
            threads: Number of threads; one for each usable core if None.

        Returns:
            SampleTable: Metrics, times of divergence, gaps and series of the draws.

        Raises:
            KeyboardInterrupt: If the run was interrupted.
        """
        draws = np.ascontiguousarray(np.atleast_2d(draws), dtype=float)
        tables, times, gaps = [], [], []
        series = {
            one.name: np.empty((len(draws), len(self.members), len(self.recording.time), len(one.components)))
            for one in self.recording.series
        }
        for i, member in enumerate(self.members):
            values, names = member.space.values(draws), member.recording.names
            batch = member.rollout.batch(member.space.paths, values, outputs=names, threads=threads)
            if batch.cancelled:
                raise KeyboardInterrupt
            tables.append(member.campaign_metrics.table(batch.measures))
            times.append(batch.diverged_at_s)
            gaps.append(np.column_stack([np.empty((len(draws), 0)), *batch.gaps.values()]))
            for name in names:
                series[name][:, i] = batch.outputs[name]
        metrics, diverged, gap = (np.stack(parts, axis=1) for parts in (tables, times, gaps))
        return SampleTable(draws, metrics, diverged, gap, series)


def build_evaluator(scene: Scene, gains: Gains | None = None, *, compiled: bool = True) -> CampaignEvaluator:
    """Campaign of a scene, built and compiled.

    Args:
        scene: A scene whose scenario has a ``campaign`` section.
        gains: Sets of gains by name, each of changes by dotted path; the section's if None.
        compiled: Whether rollouts are compiled; False suffices to read a store.

    Raises:
        ScenarioError: If the section does not fit the scene: a path does not exist, the closed loop does not
            depend on it, there is no such signal, or its series would not end.
    """
    campaign = campaign_of(scene)
    chosen: Gains = dict(campaign.gains if gains is None else gains) or {NOMINAL: {}}
    gain_sets: list[GainSet] = []
    for name, changes in chosen.items():
        try:
            gain_sets.append(_member(gain_set(scene, changes), campaign, len(chosen), compiled))
        except ScenarioError as fault:
            where = f"gains {name}: {fault.where or ''}".rstrip(": ")
            raise ScenarioError(fault.message, source=fault.source or scene.source, where=where) from None
    if any(
        member.campaign_metrics.columns != gain_sets[0].campaign_metrics.columns
        or member.recording.series != gain_sets[0].recording.series
        or member.rollout.kernel.closure.largest != gain_sets[0].rollout.kernel.closure.largest
        for member in gain_sets
    ):
        raise scene.error("sets of gains differ in robots, tips or grasps")
    campaign = campaign.model_copy(update={"gains": {n: dict(c) for n, c in chosen.items()}})
    scenario = scene.scenario.model_copy(update={"campaign": campaign})
    return CampaignEvaluator(
        dataclasses.replace(scene, scenario=scenario), campaign, chosen, tuple(gain_sets)
    )


def all_draws(evaluator: CampaignEvaluator) -> Array:
    """Draws (N, k) of all samples of a campaign, checked against the allowed ranges of the scenario.

    Raises:
        ScenarioError: If a draw has a value that a scenario may not have.
    """
    draws = draw(evaluator.campaign)
    for member in evaluator.members:
        check_range(member.scene, member.space, draws)
    return draws


def _member(scene: Scene, campaign: Campaign, sets: int, compiled: bool) -> GainSet:
    space = resolve_space(scene, campaign)
    updated = UpdatedScene.of(scene, space.paths)
    loop = cached_closed_loop(scene if updated is None else updated.scene, vary=space.paths)
    metric_quantities = [find_quantity(name) for name in campaign.metrics]
    rolled = with_added_states(loop, scene, metric_quantities, campaign.jitter_frequency)
    campaign_metrics = build_campaign_metrics(loop, scene, campaign.metrics, rolled)
    kinds = {column.metric for column in campaign_metrics.columns}
    # the default list has more than any scene; a stored scenario spells it out
    absent = [each for each in metric_quantities if each.name not in kinds]
    if absent and set(campaign.metrics) != set(default_metrics()):
        reasons = "; ".join(f"{each.name}: {each.absent}" for each in absent)
        remedy = "remove it from the list" if len(absent) == 1 else "remove them from the list"
        raise ScenarioError(f"{reasons}; {remedy}", where="campaign.metrics")
    if not campaign_metrics.columns:
        raise ScenarioError("none of the metrics fits this scene", where="campaign.metrics")
    for name in campaign.limits.given:
        if name not in kinds:
            quantity = find_quantity(name)
            raise ScenarioError(quantity.absent, where=f"campaign.limits.{quantity.limit}")
    duration = scene.scenario.simulation.duration if updated is None else updated.duration_s
    sample_s = series_step(campaign, duration)
    time = time_grid(duration, campaign.step, sample_s).time if sample_s else np.empty(0)
    recording = build_recording(loop, scene, campaign.series, time)
    check_size(recording, campaign.count, sets)
    options: Options = {
        "step_s": campaign.step,
        "output_step_s": sample_s,
        "method": scene.scenario.simulation.method,
        "backend": "auto" if compiled else "interpreted",
        "many": True,
    }
    rollout: Rollout | UpdatedRollout
    if updated is None:
        rollout = build_rollout(rolled, duration_s=duration, measures=campaign_metrics.measures, **options)
    else:
        rollout = UpdatedRollout(
            updated, loop, rolled, campaign_metrics.measures, duration_s=duration, **options
        )
        statistics = (MetricColumn(name, "total", unit) for name, unit in updated.measures.items())
        campaign_metrics = dataclasses.replace(
            campaign_metrics, columns=(*campaign_metrics.columns, *statistics)
        )
    return GainSet(scene, space, campaign_metrics, recording, rollout, updated)
