"""Derivatives of a metric by differences, used until exact derivatives are compiled, or if none exist."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence

from viz.studio.metrics import Metric
from viz.studio.prepared_design import PreparedDesign

SHARE = 1e-4
"""Half-width of a difference, relative to the value, or to half the slider's range if the value is zero."""

PART_S = 0.3
"""Minimum interval between partial results [s]."""


def differences(
    plant: PreparedDesign,
    numbers: Mapping[str, float],
    metric: Metric,
    paths: Sequence[str],
    halted: Callable[[], bool] = lambda: False,
) -> Iterator[dict[str, float | None]]:
    """Derivatives of a metric by numbers, by central differences, one-sided at the limit of a number.

    Args:
        plant, numbers: The design.
        metric: Metric to be differentiated.
        paths: Paths of the numbers; those that need another compilation are left out.
        halted: Function called before each rollout; if it returns True, the computation ends.

    Yields:
        dict: Derivatives since the last part, by path, in the metric's unit per unit of the number; None
            where a rollout diverged.
    """
    nominal, told_at = plant.nominal | dict(numbers), time.monotonic()
    slopes: dict[str, float | None] = {}
    for path in paths:
        if path not in plant.free:
            continue
        leaf, value = plant.leaves[path], nominal[path]
        step = SHARE * (abs(value) or 0.5 * (leaf.slider[1] - leaf.slider[0]))
        ends = [value if leaf.fault(end) else end for end in (value - step, value + step)]
        costs = []
        for end in ends:
            if halted():
                return
            costs.append(plant.cost({**numbers, path: end}, metric))
        low, high = costs
        is_finite = low is not None and high is not None and ends[0] < ends[1]
        slopes[path] = (high - low) / (ends[1] - ends[0]) if is_finite else None  # type: ignore[operator]
        if time.monotonic() - told_at > PART_S:
            yield slopes
            slopes, told_at = {}, time.monotonic()
    if slopes:
        yield slopes
