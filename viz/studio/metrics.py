"""What each rollout of the studio is measured by: the columns of campaigns, and totals of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from optim.campaign.rollouts.metrics import Column, build_kept
from optim.campaign.rollouts.trust import DRIFT, RESIDUAL
from optim.problem.objectives import Reduced
from spacerobot.closedloop import ClosedLoop
from spacerobot.errors import SpaceRobotError, near_names
from spacerobot.rollout import Measure, Measures, Signals
from spacerobot.scene import Scene
from viz.page.panel import LABELS

MILLIMETRES = 1e3


def _together(parts: ca.SX) -> ca.SX:
    return ca.sqrt(ca.sumsqr(parts))


TOTALS: Mapping[str, Callable[[ca.SX], ca.SX]] = {
    "tip_error_rms": _together,
    "impulse": ca.sum1,
    "event_energy": ca.sum1,
    "propellant": ca.sum1,
}
"""How the places of a quantity become one, where that is not the largest."""


@dataclass(frozen=True)
class Metric:
    """A number of each rollout, the smaller the better.

    Attributes
    ----------
    key
        Its name: that of a quantity, or that and of what.
    label, text
        What people call it, and what it is.
    unit
        In which it is told.
    factor
        Of a unit told in the rollout's own: 1000 for mm.
    kind
        The quantity.
    places
        Places in the quantity's measure that it is made of.
    duration_s
        Of a rollout.
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
        """What the page is told."""
        return {"key": self.key, "label": self.label, "unit": self.unit, "text": self.text}

    def expression(self, measured: ca.SX) -> ca.SX:
        """Its value, in the rollout's own unit, of the quantity's measure."""
        parts = measured[list(self.places)]
        if self.kind == "tip_error_rms":
            parts = ca.sqrt(parts / self.duration_s)
        if self.kind == "miss_distance":
            parts = -parts
        return TOTALS.get(self.kind, ca.mmax)(parts) if len(self.places) > 1 else parts


@dataclass(frozen=True)
class Metrics:
    """All metrics of a scene, and the measures that they are made of, each metric being a cost.

    Attributes
    ----------
    metrics
        In the order in which they are told.
    measures
        For the rollout.
    """

    metrics: tuple[Metric, ...]
    measures: Measures

    def __getitem__(self, key: str) -> Metric:
        """The metric of a key.

        Raises
        ------
        SpaceRobotError
            If there is none.
        """
        named = {metric.key: metric for metric in self.metrics}
        if key not in named:
            raise SpaceRobotError(f"no metric {key!r}; {near_names(key, named)}")
        return named[key]

    def values(self, costs: Mapping[str, float]) -> list[float | None]:
        """What the page is told of a rollout's costs; None where there is no number."""
        found = [metric.factor * float(costs[metric.key]) for metric in self.metrics]
        return [value if np.isfinite(value) else None for value in found]

    def reduced(self, metric: Metric) -> Callable[[Signals], Reduced]:
        """A metric as what a search makes small."""
        measure, own = self.measures.named[metric.kind], self.measures.signals
        known = ca.vertcat(own.t, own.x, *own.outputs.values())

        def objective(signals: Signals) -> Reduced:
            """The same over other symbols."""
            given = ca.vertcat(signals.t, signals.x, *signals.outputs.values())
            parts = ca.densify(ca.substitute(measure.expression, known, given))
            return Reduced(Measure(measure.kind, parts), metric.expression)

        return objective


def build_metrics(loop: ClosedLoop, scene: Scene) -> Metrics:
    """Metrics of a scene's closed loop: totals first, then what they are made of."""
    kept = build_kept(loop, scene, list(LABELS))
    columns = [column for column in kept.columns if column.metric not in (DRIFT, RESIDUAL)]
    metrics = (*_totals(columns, kept.duration_s), *_singles(columns, kept.duration_s))

    def costs(r: Mapping[str, ca.SX], _: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        return {m.key: m.expression(r[m.kind]) for m in metrics}

    named = {name: measure for name, measure in kept.measures.named.items() if name in LABELS}
    return Metrics(metrics, replace(kept.measures, named=named, costs=costs))


def _totals(columns: Sequence[Column], duration_s: float) -> list[Metric]:
    found = []
    for kind, (label, text) in LABELS.items():
        own = [column for column in columns if column.metric == kind]
        if own:
            unit, factor = _told(own[0].unit)
            places = tuple(range(len(own)))
            found.append(Metric(kind, label, text, unit, factor, kind, places, duration_s))
    return found


def _singles(columns: Sequence[Column], duration_s: float) -> list[Metric]:
    """Parts of the totals that have several."""
    found = []
    for kind, (label, text) in LABELS.items():
        own = [column for column in columns if column.metric == kind]
        for place, column in enumerate(own if len(own) > 1 else ()):
            unit, factor = _told(column.unit)
            name = f"{label}, {column.where}"
            found.append(Metric(column.name, name, text, unit, factor, kind, (place,), duration_s))
    return found


def _told(unit: str) -> tuple[str, float]:
    return {"m": ("mm", MILLIMETRES), "kg": ("g", 1e3)}.get(unit, (unit, 1.0))
