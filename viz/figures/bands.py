"""Campaigns: how signals spread over time. The input is plain data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from spacerobot.common.tables import unit_scale
from viz.figures.campaign import BAD
from viz.figures.style import COLOURS, Drawing, legend_above, panel_grid, styled

if TYPE_CHECKING:
    from optim.campaign import QuantileBands

MOST_PANELS = 24
ROOM = 4  # widths of the 5 to 95 % band that extremes may reach beyond it before they are cut


@styled
def bands(signal: QuantileBands) -> Drawing:
    """Percentile bands over time of every component that moves, each in its panel.

    Args:
        signal: A signal of many samples.
    """
    moving = moving_components(signal)[:MOST_PANELS]
    factor, unit = unit_scale(signal.unit, signal.name)
    columns = 1 if len(moving) <= 1 else 2 if len(moving) in (2, 4) else 3
    figure, axes = panel_grid(len(moving), columns, height_in=1.6 if columns > 1 else 2.4, sharex=True)
    for panel, i in zip(axes.flat, moving, strict=False):
        panel.set_title(signal.components[i])
        t, colour = signal.time, COLOURS[0]
        least, low, median, high, greatest, curve = (
            factor * part[:, i]
            for part in (
                signal.least,
                signal.low,
                signal.median,
                signal.high,
                signal.greatest,
                signal.sample_values,
            )
        )
        panel.fill_between(t, least, greatest, color=colour, alpha=0.14, linewidth=0, label="all samples")
        panel.fill_between(t, low, high, color=colour, alpha=0.38, linewidth=0, label="5 to 95 % of them")
        panel.plot(t, median, color=colour, linewidth=1.3, label="median")
        worst = f"worst sample, {signal.sample}"
        panel.plot(t, curve, color=COLOURS[1], linewidth=1.0, linestyle=(0, (4, 1.5)), label=worst)
        if not np.isfinite(median).any():
            continue
        bottom, top = float(np.nanmin(low)), float(np.nanmax(high))
        room = ROOM * (top - bottom) or 1.0
        lowest, highest = float(np.nanmin(least)), float(np.nanmax(greatest))
        ends = ((lowest, lowest < bottom - room), (highest, highest > top + room))
        cut = [f"{value:.3g}" for value, outside in ends if outside]
        if cut:
            panel.set_ylim(max(bottom - room, lowest) - 0.05 * room, min(top + room, highest) + 0.05 * room)
            text = f"cut; reaches {' and '.join(cut)}"
            panel.annotate(
                text, (0.98, 0.96), xycoords="axes fraction", fontsize=7, color=BAD, ha="right", va="top"
            )
    for panel in axes[:, 0]:
        panel.set_ylabel(f"[{unit}]")
    for column in range(columns):
        last = max(row for row in range(len(axes)) if row * columns + column < max(len(moving), 1))
        axes[last, column].set_xlabel("time [s]")
        axes[last, column].tick_params(labelbottom=True)
    legend_above(figure, axes[0, 0], columns=4)
    return figure


def moving_components(signal: QuantileBands) -> list[int]:
    """Indices of the components that vary over time or between samples."""
    span = np.nan_to_num(signal.greatest).max(axis=0) - np.nan_to_num(signal.least).min(axis=0)
    return [int(i) for i in np.flatnonzero(span > 1e-12 * max(float(span.max(initial=0.0)), 1e-300))]
