"""Many rollouts at once on a page: quantiles of tip errors over time, and where the tips of some go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spacerobot.arrays import Array
from viz.page.meshcat_scene import packed

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
MOST_TIMES = 201
MOST_PATHS = 100
BANDED = "tip error"
"""Quantity of the page whose quantiles are drawn."""


def spread_data(time: Array, outputs: Mapping[str, Array], tips: Sequence[str]) -> dict[str, Any]:
    """Bands and paths of n rollouts.

    Parameters
    ----------
    time
        Of the samples (nt,) [s].
    outputs
        ``tip_error`` and ``tip_position``, each (n, nt, 3 tips) [m]; NaN after a divergence.
    tips
        What the tips are called.

    Returns
    -------
    dict
        ``time`` (nt,), ``bands`` (tips, quantiles, nt) of the sizes of tip errors [mm], ``paths``
        (shown, nt, tips, 3) [m] with its shape, ``quantiles``, ``quantity`` and ``signals``, their names.
    """
    every = max(1, len(time) // (MOST_TIMES - 1))
    error, place = (
        outputs[name][:, ::every].reshape(len(outputs[name]), -1, len(tips), 3)
        for name in ("tip_error", "tip_position")
    )
    paths = place[:MOST_PATHS]
    return {
        "time": packed(time[::every]),
        "quantiles": list(QUANTILES),
        "quantity": BANDED,
        "signals": list(tips),
        "bands": packed(_bands(1e3 * np.linalg.norm(error, axis=-1))),
        "paths": packed(paths),
        "shape": list(paths.shape),
    }


def _bands(sizes: Array) -> Array:
    """Quantiles (tips, quantiles, nt) of sizes (n, nt, tips) of those that did not diverge."""
    good = sizes[np.isfinite(sizes).all(axis=(1, 2))]
    if not len(good):
        return np.full((sizes.shape[2], len(QUANTILES), sizes.shape[1]), np.nan)
    return np.asarray(np.quantile(good, QUANTILES, axis=0).transpose(2, 0, 1))
