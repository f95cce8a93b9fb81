"""Metrics of each rollout of the studio: the columns of campaigns, and totals of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from optim.campaign.rollouts.metrics import build_campaign_metrics
from optim.problem.objectives import ReducedObjective
from spacerobot.closedloop import ClosedLoop
from spacerobot.common.errors import SpaceRobotError, near_names
from spacerobot.quantities import default_metrics, find_quantity
from spacerobot.rollout import Measure, Measures, Signals
from spacerobot.scene import Scene

MILLIMETRES = 1e3


@dataclass(frozen=True)
class Metric:
    """Scalar metric of each rollout, to be minimised.

    Attributes:
        key: Name of the quantity for its total, else with the component.
        label, text: Label and description.
        unit: Unit of the displayed value.
        factor: Displayed units per unit of the rollout: 1000 for mm.
        kind: Name of the quantity.
        places: Indices of its components in the quantity's measure.
        duration_s: Duration of a rollout [s].
    """

    key: str
    label: str
    text: str
    unit: str
    factor: float
    kind: str
    places: tuple[int, ...]
    duration_s: float

    def plain(self) -> dict[str, str]:
        """Plain data for the page."""
        return {"key": self.key, "label": self.label, "unit": self.unit, "text": self.text}

    def expression(self, measured: ca.SX) -> ca.SX:
        """Value of the metric, in the rollout's unit, from the quantity's measure."""
        quantity = find_quantity(self.kind)
        return quantity.combined(quantity.reduced(measured[list(self.places)], self.duration_s))


@dataclass(frozen=True)
class Metrics:
    """All metrics of a scene, each a cost of the rollout, and their measures.

    Attributes:
        metrics: Metrics in the order of display.
        measures: Measures of the rollout.
    """

    metrics: tuple[Metric, ...]
    measures: Measures

    def __getitem__(self, key: str) -> Metric:
        """Metric with a given key.

        Raises:
            SpaceRobotError: If there is no such metric.
        """
        named = {metric.key: metric for metric in self.metrics}
        if key not in named:
            raise SpaceRobotError(f"no metric {key!r}; {near_names(key, named)}")
        return named[key]

    def values(self, costs: Mapping[str, float]) -> list[float | None]:
        """Metric values of a rollout's costs for the page; None where a value is not finite."""
        values = [metric.factor * float(costs[metric.key]) for metric in self.metrics]
        return [value if np.isfinite(value) else None for value in values]

    def reduced(self, metric: Metric) -> Callable[[Signals], ReducedObjective]:
        """Objective function of a metric, for a search."""
        measure, signals_of_loop = self.measures.named[metric.kind], self.measures.signals
        arguments = ca.vertcat(signals_of_loop.t, signals_of_loop.x, *signals_of_loop.outputs.values())

        def objective(signals: Signals) -> ReducedObjective:
            """Objective over the signals of another closed loop."""
            replacements = ca.vertcat(signals.t, signals.x, *signals.outputs.values())
            parts = ca.densify(ca.substitute(measure.expression, arguments, replacements))
            return ReducedObjective(Measure(measure.kind, parts), metric.expression)

        return objective


def build_metrics(loop: ClosedLoop, scene: Scene) -> Metrics:
    """Metrics of a scene's closed loop: totals first, then their components."""
    campaign_metrics = build_campaign_metrics(loop, scene, default_metrics())
    totals, singles = list[Metric](), list[Metric]()
    for name, labels in campaign_metrics.labels.items():
        quantity, parts = find_quantity(name), list(dict.fromkeys(labels))
        unit = next(column.unit for column in campaign_metrics.columns if column.metric == name)
        unit, factor = {"m": ("mm", MILLIMETRES), "kg": ("g", 1e3)}.get(unit, (unit, 1.0))
        common, every = (unit, factor, name), tuple(range(len(labels)))
        text, lasts = quantity.description, campaign_metrics.duration_s
        totals.append(Metric(name, quantity.label, text, *common, every, lasts))
        for part in parts if len(parts) > 1 else ():
            places = tuple(i for i in every if labels[i] == part)
            title = f"{quantity.label}, {part}"
            singles.append(Metric(f"{name} {part}", title, text, *common, places, lasts))
    metrics = (*totals, *singles)

    def costs(r: Mapping[str, ca.SX], _: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        return {m.key: m.expression(r[m.kind]) for m in metrics}

    named = {
        name: measure
        for name, measure in campaign_metrics.measures.named.items()
        if name in campaign_metrics.labels
    }
    return Metrics(metrics, replace(campaign_metrics.measures, named=named, costs=costs))
