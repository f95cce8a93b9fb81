"""Errors of estimates, with the bands that their filters state."""

from __future__ import annotations

import numpy as np

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
        title = name.removesuffix("_error").removesuffix("_estimate").replace("_", " ")
        panel.set(title=f"{label}, {title}", ylabel=f"error [{unit}]", xlabel="time [s]")
        until(panel, result)
    legend_above(figure, axes[0, 0])
    below_last(axes)
    return figure
