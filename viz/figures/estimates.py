"""Errors of estimates, with the bands that their filters state."""

from __future__ import annotations

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.tables import unit_scale
from spacerobot.result import Result
from viz.figures.kind import figure
from viz.figures.style import (
    Drawing,
    below_last,
    legend_above,
    line,
    panel_grid,
    shown_axes,
    styled,
    until,
)

SIGMAS = 3.0
"""Half of a band's width in standard deviations: 99.7 % of a consistent filter's errors are within it."""


CONVERGED = 1.5
"""Ratio of a band's width to its median over time up to which a filter counts as converged."""
HIDDEN = 2.0
"""Ratio of the largest value to the range of the converged filter from which on the axis shows that range."""


def converged_range(values: Array, bound: Array) -> float | None:
    """Half of the range of an axis in which the converged filter can be read.

    The range holds every error and band at instants at which the filter has converged. Wider bands, such as
    those of the initial covariance, are cut off.

    Args:
        values, bound: Errors and half widths of their bands (nt, n).

    Returns:
        float: Half of the range; None if it is more than half of the largest value, so that nothing needs
            to be cut off.
    """
    width = np.nan_to_num(bound).max(axis=1)
    largest = np.maximum(width, np.abs(np.nan_to_num(values)).max(axis=1))
    is_converged = width <= CONVERGED * np.median(width)
    limit = 1.1 * float(largest[is_converged].max(initial=0.0))
    return limit if 0 < HIDDEN * limit < largest.max() else None


def stated_errors(result: Result) -> list[str]:
    """Names of the errors of estimates whose standard deviation a filter states."""
    names = map(str, result.data.data_vars)
    return [name for name in names if name.endswith("_error") and _deviation(name) in result.data]


def _deviation(error: str) -> str:
    return f"{error.removesuffix('_error')}_deviation"


@figure("Errors of estimates and their 3-sigma bands", applies=lambda r: bool(stated_errors(r)), place=15)
@styled
def estimate_errors(result: Result) -> Drawing:
    """Error of each estimate by axis, and three standard deviations to both sides: a panel for each."""
    bands_by_estimate = []
    for name in stated_errors(result):
        error = result.data[name]
        dim = str(error.dims[1])
        for label in error[dim].values:
            values, deviation = (
                result.data[key].sel({dim: label}).values for key in (name, _deviation(name))
            )
            if np.isfinite(values).any():  # others than this filter's bodies hold no number
                bands_by_estimate.append((name, str(label), values, SIGMAS * deviation))
    figure, axes = panel_grid(len(bands_by_estimate), 2, sharex=True)
    time = result.data.time.values
    for panel, (name, label, values, bound) in zip(axes.flat, bands_by_estimate, strict=False):
        factor, unit = unit_scale(str(result.data[name].attrs["units"]))
        vector = values.ndim == 2
        # of a planar scene only what lies in the plane, or turns in it, is estimated
        about = str(result.data[name].attrs["units"]).startswith("rad")
        axis_names = (
            (["z"] if "body_angle" in result.data else ["x", "y", "z"]) if about else shown_axes(result)
        )
        columns_of = ["xyz".index(axis) for axis in axis_names] if vector else [0]
        values, bound = (array.reshape(len(time), -1) for array in (values, bound))
        for k in columns_of:
            look = line(k)
            text = "xyz"[k] if vector else "error"
            panel.plot(time, factor * values[:, k], **look, label=text)
            band = factor * bound[:, k]
            panel.fill_between(time, -band, band, color=look["color"], alpha=0.12, linewidth=0)
        limit = converged_range(factor * values[:, columns_of], factor * bound[:, columns_of])
        if limit is not None:
            panel.set_ylim(-limit, limit)
            widest = factor * float(np.nanmax(bound[:, columns_of]))
            words = f"cut off: bands up to ±{widest:.3g} {unit}"
            panel.text(0.98, 0.96, words, transform=panel.transAxes, fontsize=7, ha="right", va="top")
        title = name.removesuffix("_error").removesuffix("_estimate").replace("_", " ")
        panel.set(title=f"{label}, {title}", ylabel=f"error [{unit}]", xlabel="time [s]")
        until(panel, result)
    legend_above(figure, axes[0, 0])
    below_last(axes)
    return figure
