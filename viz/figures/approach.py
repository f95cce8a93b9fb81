"""Approach of tips to a capture: corridor, speeds and misalignment over the distance to go."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from matplotlib.patches import Ellipse, Rectangle

from spacerobot.common.arrays import Array
from spacerobot.elements.grasps.capture import Capture
from spacerobot.result import Result
from spacerobot.result.events import relative_velocity
from spacerobot.scene import Scene, SceneGrasp
from viz.figures.kind import figure
from viz.figures.style import Drawing, below_last, legend_above, line, panels, shown_axes, styled

ENVELOPE: dict[str, Any] = {"facecolor": "#DCE3EA", "edgecolor": "#8796A5", "linewidth": 0.7, "zorder": 0.5}
ENVELOPE |= {"label": "capture envelope"}
_CLOSE = 2.5  # greatest distances of the widest envelope that the close view reaches


class Approach(NamedTuple):
    """Approach of a tip to its mating frame, up to its first capture or to the end of the result.

    Attributes:
        to_go, lateral: Distance to the mating frame along the axis of the capture and across it (n,) [m].
        closing, sliding: Speed along the axis, towards the mating frame, and across it (n,) [m/s].
        misaligned, turning: Angle from the mated orientation (n,) [rad], NaN if the result lacks it; size of
            the relative angular velocity (n,) [rad/s].
        captured: Whether the last row is the capture.
    """

    to_go: Array
    lateral: Array
    closing: Array
    sliding: Array
    misaligned: Array
    turning: Array
    captured: bool


def approach_of(result: Result, scene: Scene, grasp: SceneGrasp, capture: Capture) -> Approach:
    """Approach of a grasp that begins open.

    All quantities are in the axes of the mating frame. The gap is ``grasp_gap``; its rate is the velocity of
    the tip relative to the target's coincident point, from configurations and velocities. The axis is
    ``capture.axis``, with the sign that makes the initial distance to go positive. After a capture the last
    row is at its time: the velocity is that of the event, before the impact, and the gap is integrated from
    the row before with the mean of both velocities.
    """
    data, time = result.data, result.data.time.values
    captured = (
        e for e in result.summary.get("events", ()) if (e["kind"], e["who"]) == ("captured", grasp.name)
    )
    event: Mapping[str, Any] | None = next(captured, None)
    rows = len(time) if event is None else max(1, int(np.searchsorted(time, event["time_s"])))
    q, v = data.q.values, data.v.values
    gap = data.grasp_gap.sel(grasp=grasp.name).values[:rows] * np.isin(data.axis.values, shown_axes(result))
    motion = [relative_velocity(scene, grasp, np.hstack(x)) for x in zip(q[:rows], v[:rows], strict=True)]
    velocity = np.array([linear for linear, _ in motion])
    turning = np.array([np.linalg.norm(spin) for _, spin in motion])
    misalignment = np.full(len(time), np.nan)
    if "grasp_misalignment" in data:
        misalignment = np.linalg.norm(data.grasp_misalignment.sel(grasp=grasp.name).values, axis=-1)
    misaligned = misalignment[:rows]
    turned = _mating_axes(scene, grasp, q[:rows])
    gap, velocity = (np.einsum("tji,tj->ti", turned, part) for part in (gap, velocity))
    if event is not None:
        after = min(rows, len(time) - 1)
        passed = event["time_s"] - time[rows - 1]
        share = passed / ((time[after] - time[rows - 1]) or 1.0)
        (then,) = _mating_axes(scene, grasp, [pin.interpolate(scene.model, q[rows - 1], q[after], share)])
        velocity = np.vstack([velocity, then.T @ event["relative_velocity_m_s"]])
        gap = np.vstack([gap, gap[-1] + passed * (velocity[-2] + velocity[-1]) / 2])
        turning = np.append(turning, np.linalg.norm(event["relative_spin_rad_s"]))
        misaligned = np.append(
            misaligned, misalignment[rows - 1] + share * (misalignment[after] - misalignment[rows - 1])
        )
    axis = np.array(capture.axis) / np.linalg.norm(capture.axis)
    axis *= 1.0 if gap[0] @ axis <= 0 else -1.0
    to_go, closing = -gap @ axis, velocity @ axis
    lateral, sliding = (
        np.linalg.norm(part - np.outer(size, axis), axis=1)
        for part, size in ((gap, -to_go), (velocity, closing))
    )
    return Approach(to_go, lateral, closing, sliding, misaligned, turning, event is not None)


def _mating_axes(scene: Scene, grasp: SceneGrasp, q: Iterable[Array]) -> Array:
    """Rotations (nt, 3, 3) of a mating frame to the world."""
    model, data = scene.model, scene.model.createData()
    rotations = []
    for configuration in q:
        pin.framesForwardKinematics(model, data, configuration)
        rotations.append(data.oMf[grasp.frame].rotation.copy())
    return np.array(rotations)


@figure(
    "The approach: lateral error and speeds over the distance to go",
    applies=lambda result: any(grasp.begins == "open" for grasp in result.scenario.grasps.values()),
    place=6,
)
@styled
def approach(result: Result) -> Drawing:
    """Lateral error, speeds and, where limited, angle and spin over the distance to go, of each open grasp.

    The curves run from the start to the capture (a dot) or to the end; the right column shows the
    neighbourhood of the mating frame. The capture envelope is shaded: a ball about the mating frame, and in
    it speeds up to their limits.
    """
    scene = result.scene()
    grasps = [(g, g.config.capture) for g in scene.grasps if g.config.begins == "open" and g.config.capture]
    captures = [capture for _, capture in grasps]
    curves = [approach_of(result, scene, grasp, capture) for grasp, capture in grasps]
    ends = [float(np.hypot(curve.to_go[-1], curve.lateral[-1])) for curve in curves]
    reach = max((c.distance for c in captures if c.distance), default=max(ends)) * _CLOSE * 1e3
    rows = {
        name: row_spec
        for name, row_spec in _ROWS.items()
        if row_spec[2] in _ALWAYS or any(getattr(c, row_spec[2]) for c in captures)
    }
    figure, axes = panels(len(rows), 2)
    for row, (name, (text, unit, key)) in zip(axes, rows.items(), strict=True):
        factors = _FACTORS[unit]
        limits = [limit * factors[0] for c in captures if (limit := getattr(c, key)) is not None]
        for panel in row:
            # the capture envelopes that limit this quantity
            for capture in captures:
                if (limit := getattr(capture, key)) is not None:
                    half, high = (capture.distance or 1e3) * 1e3, limit * factors[0]
                    if key == "distance":
                        panel.add_artist(Ellipse((0, 0), 2 * half, 2 * high, **ENVELOPE))
                    else:
                        panel.add_artist(Rectangle((-half, -high), 2 * half, 2 * high, **ENVELOPE))
            for k, ((grasp, _), curve) in enumerate(zip(grasps, curves, strict=True)):
                look, values = line(k), getattr(curve, name) * factors[1]
                panel.plot(curve.to_go * 1e3, values, **look, label=f"grasp {grasp.name}")
                if curve.captured:
                    dot: dict[str, Any] = {"markersize": 5, "linestyle": "", "zorder": 5}
                    dot |= {"color": look["color"], "label": "captured"}
                    panel.plot(curve.to_go[-1] * 1e3, values[-1], "o", **dot)
            panel.set(xlabel="distance to go [mm]", ylabel=f"{text} [{unit}]", title=text)
            panel.invert_xaxis()
        # least and greatest value of the close view: of what lies in it, and of the envelope
        limit = max(limits, default=np.inf)
        close = [getattr(c, name)[np.abs(c.to_go) * 1e3 <= reach] * factors[1] for c in curves]
        range_shown = np.clip(np.concatenate([*close, [0.0]]), -_CLOSE * limit, _CLOSE * limit)
        widest = limit if np.isfinite(limit) else 0.0
        low, high = min(float(range_shown.min()), -widest), max(float(range_shown.max()), widest)
        margin = 0.06 * (high - low) or 1.0
        least = low - margin if name == "closing" else 0.0
        row[1].set(title=f"{text}, close", xlim=(reach, -reach / 2), ylim=(least, high + margin))
    below_last(axes)
    legend_above(figure, axes[0, 0])
    return figure


_ROWS = {
    "lateral": ("lateral error", "mm", "distance"),
    "closing": ("closing speed", "mm/s", "closing_speed"),
    "sliding": ("lateral speed", "mm/s", "lateral_speed"),
    "misaligned": ("misalignment", "deg", "misalignment_deg"),
    "turning": ("relative spin", "deg/s", "spin_deg"),
}
"""Rows of the figure: name, unit, and limit of the envelope."""

_ALWAYS = ("distance", "closing_speed", "lateral_speed")
"""Limits whose row is drawn whether they are given or not."""

_FACTORS = {"mm": (1e3, 1e3), "mm/s": (1e3, 1e3), "deg": (1.0, np.degrees(1)), "deg/s": (1.0, np.degrees(1))}
"""From the scenario's unit of a limit, and from that of a value, to the unit that is drawn."""
