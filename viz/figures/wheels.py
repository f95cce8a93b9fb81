"""Figures of reaction wheels, and of the momentum budget of robots, wheels, object and external impulse."""

from __future__ import annotations

from collections.abc import Iterator

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
    panels,
    shown_axes,
    styled,
    until,
)


def _has_wheels(result: Result) -> bool:
    return "wheel" in result.data.dims


@figure("Reaction wheels: speeds and torques", applies=_has_wheels, place=13)
@styled
def wheels(result: Result) -> Drawing:
    """Speed and motor torque of each reaction wheel."""
    data, time = result.data, result.data.time.values
    figure, axes = panels(1, 2, sharex=True)
    for panel, name, text in zip(
        axes.flat, ("wheel_speed", "wheel_torque"), ("wheel speeds", "wheel torques"), strict=True
    ):
        factor, unit = unit_scale(str(data[name].attrs["units"]), name)
        for k, wheel in enumerate(data.wheel.values):
            panel.plot(time, factor * data[name].sel(wheel=wheel).values, **line(k), label=str(wheel))
        panel.set(title=text, ylabel=f"{text} [{unit}]", xlabel="time [s]")
        until(panel, result)
    legend_above(figure, axes[0, 0])
    below_last(axes)
    return figure


@figure(
    "Where the momentum is: robots, wheels, object, outside",
    applies=lambda result: _has_wheels(result) or "impulse_angular" in result.data,
    place=14,
)
@styled
def momentum_budget(result: Result) -> Drawing:
    """Changes of momentum of robots, wheels and object, and the external impulse, which equals their sum."""
    components = [("angular", axis) for axis in (["z"] if "body_angle" in result.data else ["x", "y", "z"])]
    if "impulse_linear" in result.data:
        components = [*(("linear", axis) for axis in shown_axes(result)), *components]
    figure, axes = panel_grid(len(components), 3, sharex=True)
    for panel, (kind, axis) in zip(axes.flat, components, strict=False):
        for k, (name, values) in enumerate(shares(result, kind, axis)):
            panel.plot(result.data.time.values, values, **line(k), label=name)
        total = result.data[f"momentum_{kind}"]
        along = total.sel(axis=axis).values
        panel.plot(
            result.data.time.values, along - along[0], color="black", linewidth=2, label="all together"
        )
        panel.set(
            title=f"{kind} momentum {axis}",
            ylabel=f"change {axis} [{total.attrs['units']}]",
            xlabel="time [s]",
        )
        until(panel, result)
    legend_above(figure, axes[0, 0])
    below_last(axes)
    return figure


def shares(result: Result, kind: str, axis: str) -> Iterator[tuple[str, Array]]:
    """Change since the start of the ``linear`` or ``angular`` momentum (nt,) of each part, along an axis.

    Robots without their wheels, wheels, the object, and what came from outside; what there is of them.
    """
    data = result.data.sel(axis=axis)
    bodies, robots = data[f"body_momentum_{kind}"], list(result.scenario.robots)
    held: Array = np.zeros(len(data.time))
    if kind == "angular" and "wheel_momentum" in data:
        held = data.wheel_momentum.fillna(0.0).sum("body").values
    parts = {
        "robots without wheels" if held.any() else "robots": bodies.sel(body=robots).sum("body").values - held
    }
    if held.any():
        parts["wheels"] = held
    if "target" in data.body.values:
        parts[result.scenario.body_label("target")] = bodies.sel(body="target").values
    if f"impulse_{kind}" in data:
        parts["impulse from outside"] = data[f"impulse_{kind}"].values
    for name, values in parts.items():
        yield name, values - values[0]
