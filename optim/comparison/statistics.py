"""Statistics of several runs."""

from __future__ import annotations

import numpy as np

from spacerobot.common.arrays import Array


def statistics(values: Array) -> dict[str, float | int | None]:
    """Best, median, quartiles and worst of objectives; NaN counts as infinite."""
    if not len(values):
        return {"best": None, "median": None, "lower": None, "upper": None, "worst": None}
    ranked = np.where(np.isfinite(values), values, np.inf)
    lower, median, upper = np.quantile(ranked, (0.25, 0.5, 0.75), method="nearest")
    return {
        "best": float(ranked.min()),
        "median": float(median),
        "lower": float(lower),
        "upper": float(upper),
        "worst": float(ranked.max()),
    }
