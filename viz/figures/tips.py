"""Tips: paths with their references (the paper's Fig. 5) and errors (Fig. 7 and 10)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from matplotlib.ticker import NullFormatter

from spacerobot.common.arrays import Array
from spacerobot.result import Result
from spacerobot.simulation.paper import AXES, FIGURE_7_MM, FIGURE_10_MM, is_of_the_paper
from viz.figures.kind import figure
from viz.figures.labels import labels_of
from viz.figures.phases import mark_phases
from viz.figures.style import (
    DASHES,
    PAPER_FILL,
    PAPER_LINE,
    Drawing,
    below_last,
    is_narrow,
    legend_above,
    line,
    panels,
    shown_axes,
    styled,
    until,
)

_FLAT = 1e-3  # of the longest reach: what references leave a plane by without being seen
_FIGURE_5_PANELS = "abcdefghijklmnopqrstuvwxyz"


def _leads_tips(result: Result) -> bool:
    return bool(result.led_tips)


def _controls_orientation(result: Result) -> bool:
    tips = (tip for robot in result.scenario.robots.values() for tip in robot.tips.values())
    return any(tip.orientation_pid is not None for tip in tips)


@figure("Reference and actual tip paths", compares=True, applies=_leads_tips, printed="Fig. 5", place=1)
@styled
def tip_paths(*results: Result) -> Drawing:
    """Reference and actual tip paths (Fig. 5): a row for each result and plane, a column for each tip.

    All panels of a row show the same plane of the world, and all panels have one scale. A spatial scene is
    shown in the plane of the largest extent of the references and, if they leave it, in a second plane with
    the third axis. Errors too small to be visible are also drawn enlarged.
    """
    tips = _shown(results[0])
    drawings = list(product(zip(results, labels_of(results), strict=True), planes(results)))
    figure, axes = panels(len(drawings), len(tips), height_in=3.0)
    letters = iter(_FIGURE_5_PANELS * 4)
    for row, ((result, label), plane) in zip(axes, drawings, strict=True):
        for panel, tip in zip(row, tips, strict=True):
            reference = result.data.tip_reference.sel(tip=tip).values
            actual = result.data.tip_position.sel(tip=tip).values
            across, up = plane
            names = [str(result.data.axis.values[k]) for k in plane]
            panel.plot(
                reference[:, across], reference[:, up], **line(1), label="reference", linewidth=1.0, zorder=4
            )
            panel.plot(actual[:, across], actual[:, up], **line(0), label="actual", linewidth=2.2, alpha=0.75)
            greatest = float(np.linalg.norm(result.data.tip_error.sel(tip=tip).values, axis=-1).max())
            times = enlargement(greatest, float(np.ptp(reference, axis=0).max()))
            if times > 1:
                drawings = reference + times * (actual - reference)
                look = {"linestyle": DASHES[2], "linewidth": 1.0, "color": "#444444"}
                panel.plot(
                    drawings[:, across], drawings[:, up], **look, label="actual, error enlarged", zorder=3
                )
            panel.plot(
                actual[0, across], actual[0, up], "o", color="black", markersize=4, label="start", zorder=5
            )
            panel.set(xlabel=f"{names[0]} [m]", ylabel=f"{names[1]} [m]")
            panel.set_aspect("equal", adjustable="datalim")
            panel.locator_params(nbins=5)
            ended = "" if result.completed else f"; diverged after {result.data.time.values[-1]:.3g} s"
            larger = f",{chr(10) if is_narrow() else ' '}enlarged {times:g} times" if times > 1 else ""
            words = f"greatest error {greatest * 1e3:.3g} mm{larger}{ended}"
            size = 7.0 if is_narrow() else 7.5
            panel.text(0.0, 1.02, words, transform=panel.transAxes, fontsize=size).set_in_layout(
                not is_narrow()
            )
            title = f"({next(letters)}) {tip}"
            panel.set_title(
                title if len(results) == 1 else f"{title}, {label}", pad=24 if is_narrow() else 16
            )
    # Let a metre be as long in all panels, each around its own middle.
    panels_axes = list(axes.flat)
    wide, high = np.max([panel.dataLim.size for panel in panels_axes], axis=0)
    for panel in panels_axes:
        (left, bottom), (right, top) = panel.dataLim.min, panel.dataLim.max
        across, up = (left + right) / 2, (bottom + top) / 2
        panel.update_datalim([(across + k * wide / 2, up + k * high / 2) for k in (-1, 1)])
        panel.autoscale_view()
    legend_above(figure, *axes.flat)
    return figure


def _shown(result: Result) -> list[str]:
    """Tips with a reference; all tips if none has one."""
    return result.led_tips or [str(tip) for tip in result.data.tip.values]


def planes(results: Sequence[Result]) -> list[tuple[int, int]]:
    """Pairs of world axes in which references are seen: the largest, and a second if needed."""
    every = [result.data.tip_reference.sel(tip=_shown(result)).values for result in results]
    reach = np.max([np.ptp(paths, axis=0).max(axis=0) for paths in every], axis=0)
    first, second, third = (int(k) for k in np.argsort(-reach, kind="stable"))
    plane_pairs = [(first, second)]
    if reach[third] > _FLAT * reach[first]:
        plane_pairs.append((first, third))
    return [(min(pair), max(pair)) for pair in plane_pairs]


def enlargement(error: float, reach: float) -> float:
    """Round factor that makes an error [m] visible next to a path of extent ``reach`` [m]; at least 1."""
    if error <= 0 or error > 0.04 * reach:
        return 1.0
    factor = 0.12 * reach / error
    power = 10.0 ** np.floor(np.log10(factor))
    return float(max(k * power for k in (1, 2, 5) if k * power <= factor))


@figure("Tip errors", compares=True, applies=_leads_tips, printed="Fig. 7 and 10", place=3)
@styled
def tip_errors(*results: Result) -> Drawing:
    """Tip errors, reference minus position (Fig. 7 and 10): a row for each tip, a column for each axis.

    All panels have one scale. The panels of the paper's robots also show its error bands. Several results,
    such as before and after tuning, are drawn over each other; a further column then shows the magnitude of
    their errors on a logarithmic scale.
    """
    return _draw(results, _POSITION, shown_axes(results[0]))


@figure("Orientation errors of tips", compares=True, applies=_controls_orientation, place=4)
@styled
def orientation_errors(*results: Result) -> Drawing:
    """Orientation errors, rotation vectors from tips to their references, laid out as :func:`tip_errors`."""
    return _draw(results, _ORIENTATION, ["z"] if "body_angle" in results[0].data else ["x", "y", "z"])


class _Error(NamedTuple):
    """Kind of tip error: variable, factor to ``unit``, and label."""

    variable: str
    factor: float
    text: str
    unit: str
    about: str

    def of(self, result: Result, tip: str) -> Array:
        """Errors (nt, 3) of a tip."""
        return np.asarray(result.data[self.variable].sel(tip=tip).values * self.factor)


_POSITION = _Error("tip_error", 1e3, "tip error", "mm", "")
_ORIENTATION = _Error("tip_orientation_error", 180 / np.pi, "orientation error", "deg", "about ")


def _draw(results: Sequence[Result], error: _Error, names: Sequence[str]) -> Drawing:
    """Errors along (or about) axes: a row for each tip."""
    tips, several = _shown(results[0]), len(results) > 1
    figure, axes = panels(len(tips), len(names) + several, sharex=True)
    signed = axes[:, : len(names)]
    for panel in signed.flat[1:]:
        panel.sharey(signed[0, 0])
    for row, tip in zip(axes, tips, strict=True):
        for panel, name in zip(row, names, strict=False):
            # Errors of a tip along an axis, over the paper's bands.
            published = is_of_the_paper(results[0]) and error is _POSITION
            if published and (tip, name) in AXES:
                place = AXES.index((tip, name))
                fill: dict[str, Any] = {"color": PAPER_FILL, "linewidth": 0, "zorder": 0}
                panel.axhspan(*FIGURE_7_MM[place], **fill, label="published, Fig. 7 (PID + amnesia)")
                look: dict[str, Any] = {"color": PAPER_LINE, "linewidth": 0.8, "linestyle": (0, (3, 2))}
                for value, caption in zip(
                    FIGURE_10_MM[place], ("published, Fig. 10 (GA-tuned)", None), strict=True
                ):
                    panel.axhline(value, **look, zorder=1, label=caption)
            for index, (result, label) in enumerate(zip(results, labels_of(results), strict=True)):
                values = error.of(result, tip)[:, "xyz".index(name)]
                text = f"simulated: {label}" if published else label
                panel.plot(result.data.time.values, values, **line(index), label=text)
                until(panel, result)
            panel.axhline(0, color="0.5", linewidth=0.6, zorder=1)
            named = f"{error.text} [{error.unit}]"
            panel.set(title=f"{tip}, {error.about}{name}", ylabel=named, xlabel="time [s]")
            panel.label_outer()
        if several:
            # sizes of the tip's errors, whatever their direction
            panel = row[-1]
            for index, result in enumerate(results):
                size = np.linalg.norm(error.of(result, tip), axis=-1)
                # a tip begins on its reference: zeros do not show on a logarithmic axis
                panel.plot(result.data.time.values, np.where(size > 0, size, np.nan), **line(index))
                until(panel, result)
            greatest = panel.dataLim.y1
            if np.isfinite(greatest) and greatest > 0:
                panel.set_ylim(max(panel.dataLim.minposy, 1e-6 * greatest), 2 * greatest)
            panel.set_yscale("log")
            panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
            panel.yaxis.set_minor_formatter(NullFormatter())
            name = f"size of {error.text} [{error.unit}]"
            panel.set(title=f"{tip}, size", ylabel=name, xlabel="time [s]")
    if not several:
        for panel in axes.flat:
            mark_phases(panel, results[0], named=panel is axes[0, 0])
    below_last(axes)
    if not all(result.completed for result in results):
        # keep what happened before a divergence readable: its last instants leave the panel
        errors = [result.data[error.variable].values * error.factor for result in results]
        calm = max(
            float(np.abs(v if r.completed else v[: max(2, int(0.8 * len(v)))]).max())
            for v, r in zip(errors, results, strict=True)
        )
        signed[0, 0].set_ylim(-2 * max(calm, 1.0), 2 * max(calm, 1.0))
    legend_above(figure, axes[0, 0], columns=3)
    return figure
