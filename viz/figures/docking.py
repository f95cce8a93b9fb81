"""The docking as a strip of frames (the paper's Fig. 8)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from spacerobot.common.arrays import Array
from spacerobot.result import Result
from viz.drawing.motion import BodyMotion, Rows, bounds, extremes, pick_rows, sample_motion
from viz.drawing.projection import draw_ghosts, draw_nodes, fit
from viz.drawing.view import View, view_of
from viz.figures.kind import figure
from viz.figures.style import COLOURS, TALLEST_IN, Drawing, is_narrow, styled, width_in

_NAME_PT = 13.0
"""Distance of the object's name from its middle."""


@figure("The motion, frame by frame", printed="Fig. 8", place=5)
@styled
def docking(result: Result, *, frames: int = 6) -> Drawing:
    """The scene at evenly spaced times, with paths; pale and dashed where bodies began.

    Planar scenes are seen from above, spatial ones by parallel projection from outside and above.
    """
    return strip(result, pick_rows(result.data.time.values, rate_hz=1e6, most=frames))


def strip(result: Result, rows: Rows, words: Sequence[str] = ()) -> Drawing:
    """The scene at rows of a result's data, in reading order, each with its time and caption.

    Args:
        result: Result to be drawn.
        rows: Indices of its times, ascending.
        words: Caption of each frame; may be empty.
    """
    scene = result.scene()
    view = view_of(result, scene)
    motion = sample_motion(result, scene, rows)
    points = seen_points(result, motion)
    size = np.ptp(view.flat(points), axis=0)
    ratio = float(np.clip(size[1] / (size[0] or 1.0), 0.3, 1.6))
    for columns in (2, 3) if is_narrow() else (3,):
        lines = -(-len(rows) // min(columns, len(rows)))
        height = lines * (0.88 * width_in() / columns * ratio + 0.15) + 0.5
        if height <= TALLEST_IN:
            break
    columns = min(columns, len(rows))
    figure = Drawing(figsize=(width_in(), height), layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True)
    for k, panel in enumerate(axes.flat):
        if k >= len(rows):
            panel.remove()
            continue
        fit(panel, points, view, margin=0.02)
        draw_frame(panel, result, motion, k, view)
        panel.set_title(f"t = {motion.time[k]:.3g} s" + (f": {words[k]}" if words and words[k] else ""))
        if k == 0:
            draw_names(panel, motion, k, view)
        # world axes where the picture's are such, else a scale
        last, first = k + columns >= len(rows), k % columns == 0
        panel.grid(visible=False)
        if view.labels[0]:
            panel.set(xlabel=view.labels[0] if last else "", ylabel=view.labels[1] if first else "")
            continue
        panel.set_axis_off()
        if first and last:
            scale = 10 ** np.floor(np.log10((float(size.max()) or 1.0) / 2))
            left, bottom = panel.get_xlim()[0], panel.get_ylim()[0]
            bar: dict[str, Any] = {"color": "black", "linewidth": 2, "solid_capstyle": "butt", "zorder": 9}
            panel.plot([left, left + scale], [bottom, bottom], **bar)
            beside: dict[str, Any] = {"xytext": (4, 0), "textcoords": "offset points", "va": "center"}
            panel.annotate(f"{scale:g} m", (left + scale, bottom), **beside)
    return figure


def draw_frame(
    panel: Axes, result: Result, motion: BodyMotion, frame: int, view: View, dpi: float = 300
) -> None:
    """Draw one frame: bodies, initial poses of bases and object, references, and tip paths up to this frame.

    Args:
        panel: Axes with their limits set.
        result, motion: Result, and its sampled motion.
        frame: Index of the frame in the motion.
        view: Direction of view.
        dpi: Resolution of images in the drawing [pixels/in].
    """
    draw_nodes(panel, motion, frame, view, dpi=dpi)
    draw_ghosts(panel, motion, view, dpi=dpi)
    data, now = result.data, int(motion.rows[frame]) + 1
    for k, tip in enumerate(data.tip.values):
        reference = view.flat(data.tip_reference.sel(tip=tip).values)
        panel.plot(*reference.T, color="black", linewidth=0.5, linestyle=(0, (4, 2)), zorder=5)
        trace = view.flat(data.tip_position.sel(tip=tip).values[:now])
        panel.plot(*trace.T, color=COLOURS[k % 2], linewidth=1.2, zorder=6)
    if "target" in data.body.values:
        trace = view.flat(data.body_position.sel(body="target").values[:now])
        panel.plot(*trace.T, color=COLOURS[2], linewidth=1.2, zorder=6)


def draw_names(panel: Axes, motion: BodyMotion, frame: int, view: View) -> None:
    """Names of robots on their bases, and of the object above it, or below it at the top of the panel."""
    bottom, top = panel.get_ylim()
    drawing = panel.get_figure(root=True)
    height_pt = 72 * panel.get_position().height * (drawing.get_figheight() if drawing else 1.0)
    for k, node in enumerate(motion.nodes):
        if not node.is_base:
            continue
        across, up = view.flat(motion.position[frame, k])
        room_pt = (top - up) / (top - bottom) * height_pt
        offset_pt = 0 if node.body != "target" else _NAME_PT if room_pt > 1.7 * _NAME_PT else -_NAME_PT
        panel.annotate(
            node.label,
            (across, up),
            xytext=(0, offset_pt),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=7,
            bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "boxstyle": "round,pad=0.15"},
            zorder=9,
        )


def draw_forces(
    panel: Axes, result: Result, motion: BodyMotion, frame: int, view: View, scale: float
) -> None:
    """Forces of grasps and contacts, arrows at mating and contact points; ``scale`` is in m/N."""
    data, row = result.data, int(motion.rows[frame])
    acting = [("#C2185B", motion.mates[frame], data.grasp_force.values[row])]
    if "contact_force" in data:
        acting.append(("#7B3FB5", data.contact_point.values[row], data.contact_force.values[row]))
    for colour, points, forces in acting:
        arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
        for start, force in zip(view.flat(points), view.flat(forces) * scale, strict=True):
            if np.linalg.norm(force) > 0:
                panel.annotate("", tuple(start + force), tuple(start), arrowprops=arrow, zorder=8)


def seen_points(result: Result, motion: BodyMotion) -> Array:
    """Points (k, 3) [m] that a picture of the whole motion must contain."""
    low, high = bounds(motion, diverged=not result.completed)
    references = np.clip(result.data.tip_reference.values[motion.rows].reshape(-1, 3), low, high)
    return np.concatenate([extremes(motion, low, high), references])
