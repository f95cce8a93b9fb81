"""Stability margins: Bode and Nichols diagrams of broken loops, and margins over time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.linear import LinearSystem, LoopMargins, MarginAnalysis, loop_response
from spacerobot.linear.loop_margins import MOST_INSTANTS
from viz.figures.style import Drawing, legend_above, line, panels, styled

MOST_LOOPS = 8
"""Loops in a diagram, those of the least disk margins."""


def _chosen(loops: tuple[LoopMargins, ...]) -> list[LoopMargins]:
    """Loops with finite margins, by disk margin, the smallest first; at most ``MOST_LOOPS``."""
    return sorted((one for one in loops if one.disk < 2), key=lambda one: one.disk)[:MOST_LOOPS]


def _responses(
    linear: LinearSystem, loops: tuple[LoopMargins, ...]
) -> Iterator[tuple[str, Array, Array, Array]]:
    """Name, frequencies [Hz], gain [dB], phase [deg] of loops; at gain 0 dB between -360 and 0 deg."""
    for one in _chosen(loops):
        omega, response = loop_response(linear, one.name)
        phase = np.degrees(np.unwrap(np.angle(response)))
        phase -= 360 * np.ceil(phase[np.argmin(np.abs(np.abs(response) - 1))] / 360)
        yield one.name, omega / (2 * np.pi), 20 * np.log10(np.abs(response)), phase


@styled
def bode(linear: LinearSystem, loops: tuple[LoopMargins, ...], title: str) -> Drawing:
    """Gain and phase of broken loops over frequency.

    Args:
        linear, loops: The closed loop at an instant, and its margins.
        title: Above it.
    """
    figure, axes = panels(2, 1, height_in=2.2, sharex=True)
    for k, (name, frequency, gain, phase) in enumerate(_responses(linear, loops)):
        axes[0, 0].semilogx(frequency, gain, **line(k), label=name)
        axes[1, 0].semilogx(frequency, phase, **line(k))
    axes[0, 0].axhline(0, color="black", linewidth=0.6)
    axes[1, 0].axhline(-180, color="black", linewidth=0.6)
    axes[0, 0].set(ylabel="gain [dB]", title=title, ylim=(-80, 80))
    axes[1, 0].set(ylabel="phase [deg]", xlabel="frequency [Hz]")
    axes[1, 0].xaxis.set_major_formatter("{x:g}")
    legend_above(figure, axes[0, 0], columns=2)
    return figure


@styled
def nichols(linear: LinearSystem, loops: tuple[LoopMargins, ...], title: str) -> Drawing:
    """Nichols chart: gain over phase of broken loops, with the disk around -1 of the smallest disk margin.

    Args:
        linear, loops: See :func:`bode`.
        title: Title of the figure.
    """
    figure, axes = panels(1, 1, height_in=3.6)
    panel = axes[0, 0]
    for k, (name, _, gain, phase) in enumerate(_responses(linear, loops)):
        panel.plot(phase, gain, **line(k), label=name)
    panel.plot([-180], [0], marker="+", markersize=9, color="black")
    chosen = _chosen(loops)
    if chosen:
        # |S - 1/2| = 1 / alpha with S = 1 / (1 + L): L = -(1 - d alpha/2) / (1 + d alpha/2), |d| = 1
        turn = 0.5 * min(chosen[0].disk, 1.99) * np.exp(1j * np.linspace(0, 2 * np.pi, 361))
        edge = (1 - turn) / (1 + turn)
        panel.fill(np.degrees(np.angle(edge)) - 180, 20 * np.log10(np.abs(edge)), color="0.85", zorder=0)
    panel.set(xlabel="phase [deg]", ylabel="gain [dB]", title=title, xlim=(-405, 90), ylim=(-50, 50))
    panel.set_xticks(range(-360, 91, 90))
    legend_above(figure, panel, columns=2)
    return figure


@styled
def margins_along(analysis: MarginAnalysis) -> Drawing:
    """Disk and phase margins over time, of the loops with the smallest disk margins.

    Captures and releases are marked.

    Args:
        analysis: Margins at instants along a simulation.
    """
    data = analysis.to_xarray()
    least = data.disk.min("instant")
    names = [str(name) for name in least.sortby(least).loop.values if float(least.sel(loop=name)) < 2][
        :MOST_LOOPS
    ]
    figure, axes = panels(2, 1, height_in=2.2, sharex=True)
    for panel, name, text in zip(
        axes.flat, ("disk", "phase"), ("disk margin", "phase margin [deg]"), strict=True
    ):
        for k, loop in enumerate(names):
            panel.plot(data.time.values, data[name].sel(loop=loop).values, **line(k), label=loop)
        for time_s, kind in analysis.events:
            panel.axvline(
                time_s, color="#B00020" if kind == "captured" else "0.4", linewidth=0.9, linestyle=":"
            )
        panel.set(ylabel=text, ylim=(0, None))
    axes[0, 0].set_title(analysis.scenario)
    axes[1, 0].set_xlabel("time [s]; dotted: captured, released")
    legend_above(figure, axes[0, 0], columns=2)
    return figure


def margin_figures(analysis: MarginAnalysis) -> dict[str, Drawing]:
    """Figures by name: Bode diagram and Nichols chart at each of few instants, or margins over many.

    Args:
        analysis: Margins at instants.
    """
    if len(analysis.loops) > MOST_INSTANTS:
        return {"margins_along": margins_along(analysis)}
    return {
        f"{name}_{k + 1}": draw(linear, loops, f"{analysis.scenario}, {linear.label}")
        for k, (linear, loops) in enumerate(zip(analysis.linearisations, analysis.loops, strict=True))
        for name, draw in (("bode", bode), ("nichols", nichols))
    }
