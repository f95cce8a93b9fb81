"""Metrics of each rollout of a campaign: a row of named numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from optim.campaign.rollouts.trust import (
    DEPTH,
    DRIFT,
    KINDS,
    RESIDUAL,
    depth_measure,
    drift_measure,
    drift_of,
    residual_measure,
    residual_of,
)
from optim.problem.quantity_measures import context_of, measures_of, table_values
from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.quantities import quantities
from spacerobot.quantities.capture import captures
from spacerobot.rollout import ClosedLoopFunctions, Measure, Measures, final
from spacerobot.scene import Scene

CAPTURED = "captured"
"""Name of the columns that say whether each grasp that begins open was captured: 1 or 0."""

LEDGER: Mapping[str, Callable[[Array], Array]] = {
    CAPTURED: np.asarray,
    DRIFT: drift_of,
    RESIDUAL: residual_of,
    DEPTH: np.asarray,
}
"""Columns computed from the measures that show whether a rollout captured and can be trusted."""

PLANS = {"mpc_plans": "1", "mpc_missed": "1", "mpc_unfinished": "1", "mpc_iterations": "1"}
SOLVE_TIMES = {"mpc_median_solve_s": "s", "mpc_longest_solve_s": "s"}
"""Statistics of plans made in flight, and their units; times alone depend on the machine."""


@dataclass(frozen=True)
class MetricColumn:
    """Scalar result of each rollout, one column of the table.

    Attributes:
        metric: Name of the quantity in the scenario.
        where: Label of the component: a tip and an axis, a tip, a robot, a grasp, the target, or the total.
        unit: Unit of the column.
    """

    metric: str
    where: str
    unit: str

    @property
    def name(self) -> str:
        """Name of the column in tables: metric and component."""
        return f"{self.metric} {self.where}"


@dataclass(frozen=True)
class CampaignMetrics:
    """Measures of a closed loop, and the columns of the campaign's table that follow from them.

    Attributes:
        measures: Measures of the rollout.
        columns: The M columns.
        duration_s: Duration of a rollout [s].
        labels: Label of each component of a quantity's measure, by quantity. The column of a label is the
            maximum of its components.
    """

    measures: Measures
    columns: tuple[MetricColumn, ...]
    duration_s: float

    labels: Mapping[str, tuple[str, ...]]

    def table(self, measured: Mapping[str, Array]) -> Array:
        """Values (N, M) of a batch's measures; NaN where a rollout diverged or has no such value."""
        registry, parts = quantities(), []
        for name in dict.fromkeys(column.metric for column in self.columns):
            if name in LEDGER:
                parts.append(LEDGER[name](np.asarray(measured[name])))
                continue
            if name not in registry:  # a statistic of the updates
                parts.append(np.asarray(measured[name]))
                continue
            values = table_values(registry[name], measured, self.duration_s)
            labels = np.array(self.labels[name])
            label_maxima = [
                values[:, labels == label].max(axis=1) for label in dict.fromkeys(self.labels[name])
            ]
            parts.append(np.column_stack(label_maxima))
        return np.column_stack(parts)


def build_campaign_metrics(
    loop: ClosedLoop, scene: Scene, names: Sequence[str], extended: ClosedLoopFunctions | None = None
) -> CampaignMetrics:
    """Metrics of a closed loop's rollouts; a metric that does not apply to the scene is left out.

    Further columns tell which grasps were captured and how trustworthy a rollout is: the residual of the
    energy, the drift of the momenta where they are conserved, and the indentation of contacts.

    Args:
        loop: The closed loop.
        scene: Scene of the closed loop.
        names: Names of the metrics, as in the scenario's campaign section.
        extended: The closed loop that is rolled out, with further states for the measures; ``loop`` if None.
    """
    context = context_of(scene, extended or loop)
    named: dict[str, Measure] = {}
    columns: list[MetricColumn] = []
    labels: dict[str, tuple[str, ...]] = {}
    for name, quantity in quantities().items():
        if name not in names:
            continue
        components, measures_by_name = measures_of(quantity, context)
        if components.labels:
            named |= measures_by_name
            labels[name] = components.labels
            columns += [
                MetricColumn(name, label, quantity.unit_in(scene))
                for label in dict.fromkeys(components.labels)
            ]
    signals = context.signals
    if columns and (instants := captures(context)):
        named[CAPTURED] = final(ca.vertcat(*instants.values()) >= 0)
        columns += [MetricColumn(CAPTURED, label, "1") for label in instants]
    if columns:
        named[RESIDUAL] = residual_measure(loop, signals)
        columns.append(MetricColumn(RESIDUAL, "total", "1"))
    if columns and not loop.outside:
        named[DRIFT] = drift_measure(loop, signals)
        columns += [MetricColumn(DRIFT, kind, "1") for kind in KINDS]
    if columns and scene.contacts:
        named[DEPTH] = depth_measure(scene, signals)
        columns += [MetricColumn(DEPTH, contact.name, "1") for contact in scene.contacts]
    measures = Measures(signals, named, costs=lambda _r, _p: {})
    return CampaignMetrics(measures, tuple(columns), scene.scenario.simulation.duration, labels)
