"""Base actuation: attitude errors and actuator outputs; motion relative to an orbit."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from spacerobot.common.arrays import Array
from spacerobot.result import Result
from viz.drawing.motion import BodyMotion
from viz.drawing.view import View
from viz.figures.kind import figure
from viz.figures.style import Drawing, legend_over, line, panels, shown_axes, styled, until


@figure(
    "Attitude errors of bases, and what their actuators do",
    applies=lambda result: bool(acting_bases(result)),
    place=11,
)
@styled
def base_control(result: Result) -> Drawing:
    """Attitude error and actuators (thrusters or wheels) of bases, one row for each base that acts.

    Without attitude control the rotation since the start is drawn instead of the error.
    """
    bodies = acting_bases(result)
    figure, axes = panels(len(bodies), 2, sharex=True)
    for row, body in zip(axes, bodies, strict=True):
        # Attitude error by axis; where nothing is held (a controller of rates), rotation since the start.
        panel = row[0]
        data, about = result.data, ["z"] if "body_angle" in result.data else ["x", "y", "z"]
        held = _is_held(result, body)
        text = "attitude error" if held else "rotation since the start"
        panel.set(title=f"{result.scenario.body_label(body)}, {text}", ylabel=f"{text} [deg]")
        angle = data["base_attitude_error" if held else "body_rotation"].sel(body=body)
        for k, axis in enumerate(about):
            values = np.degrees(angle.sel(axis=axis).values)
            panel.plot(data.time.values, values, **line(k), label=f"about {axis}")
        legend_over(panel, columns=3)
        # Thrusters as bands over time, as high as their part of the greatest force; else torques of wheels.
        panel, time = row[1], data.time.values
        jets, wheels = (_labels(result, kind, body) for kind in ("thruster", "wheel"))
        if jets:
            force = np.sqrt((data.thruster_force.sel(thruster=jets) ** 2).sum("axis")).values
            most = force.max(initial=0.0) or 1.0
            for k, _ in enumerate(jets):
                look = {"linewidth": 0, "step": "post", "color": line(k)["color"]}
                panel.fill_between(time, k, k + 0.8 * force[:, k] / most, **look)
            names = [name.partition(".")[2] for name in jets]
            panel.set_yticks(np.arange(len(jets)) + 0.4, names, fontsize=7)
            spent = float(data.propellant.sel(body=body)[-1]) * 1e3
            panel.set_title(
                f"{result.scenario.body_label(body)}, thrusters up to {most:.3g} N, {spent:.3g} g in all"
            )
        else:
            panel.set(title=f"{result.scenario.body_label(body)}, torques of wheels", ylabel="torque [N m]")
            for k, wheel in enumerate(wheels):
                torque = data.wheel_torque.sel(wheel=wheel).values
                panel.plot(time, torque, **line(k), label=wheel.partition("/")[2])
            if wheels:
                legend_over(panel, columns=2)
        for panel in row:
            panel.set_xlabel("time [s]")
            until(panel, result)
    return figure


def acting_bases(result: Result) -> list[str]:
    """Bodies with attitude control or thrusters."""
    bodies = map(str, result.data.body.values)
    return [body for body in bodies if _is_held(result, body) or _labels(result, "thruster", body)]


def _is_held(result: Result, body: str) -> bool:
    errors = result.data.get("base_attitude_error")
    return errors is not None and bool(errors.sel(body=body).notnull().any())


def _labels(result: Result, kind: str, body: str) -> list[str]:
    """Thrusters or wheels of a body."""
    names = result.data[kind].values if kind in result.data.dims else ()
    return [str(label) for label in names if str(label).startswith(f"{body}/")]


@figure(
    "Motion relative to the reference orbit",
    applies=lambda result: "hill_position" in result.data,
    place=12,
)
@styled
def relative_orbit(result: Result) -> Drawing:
    """Motion of the bodies in Hill axes: radial and, in space, cross-track over along-track position."""
    data, flat = result.data, len(shown_axes(result)) == 2
    figure, axes = panels(1, 1 if flat else 2)
    sides = [(0, "radial")] if flat else [(0, "radial"), (2, "cross-track")]
    for panel, (axis, name) in zip(axes.flat, sides, strict=True):
        for k, body in enumerate(map(str, data.body.values)):
            place = data.hill_position.sel(body=body).values
            panel.plot(place[:, 1], place[:, axis], **line(k), label=result.scenario.body_label(body))
            panel.plot(*place[0, [1, axis]], "o", color=line(k)["color"], markersize=4)
        panel.set(xlabel="along-track [m]", ylabel=f"{name} [m]", title=f"{name}, from the dot on")
        legend_over(panel)
    return figure


def draw_plumes(
    panel: Axes, result: Result, motion: BodyMotion, frame: int, view: View, longest: float
) -> None:
    """Plumes of the firing thrusters in a frame, opposite to their forces; the longest has ``longest`` m."""
    if "thruster" not in result.data.dims:
        return
    force, row = result.data.thruster_force.values, int(motion.rows[frame])
    scale = longest / (np.linalg.norm(force, axis=-1).max(initial=0.0) or 1.0)
    nozzles, ends = (result.data.thruster_position.values[row], -scale * force[row])
    for nozzle, end in zip(view.flat(nozzles), view.flat(ends), strict=True):
        across = 0.22 * np.array([-end[1], end[0]])
        corners: Array = nozzle + np.array([0 * end, end + across, end - across])
        if end.any():
            panel.fill(*corners.T, color="#E8A33D", alpha=0.6, linewidth=0, zorder=7)
