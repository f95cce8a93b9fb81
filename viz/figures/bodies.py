"""Bodies: rotation and translation of the object (the paper's Fig. 6) and of the bases."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from spacerobot.common.arrays import Array
from spacerobot.result import Result
from viz.figures.kind import figure
from viz.figures.labels import labels_of
from viz.figures.phases import mark_phases
from viz.figures.style import (
    COLOURS,
    DASHES,
    Drawing,
    below_last,
    legend_above,
    legend_over,
    line,
    panels,
    shown_axes,
    styled,
    until,
)

_CLOSED_M = 1e-8  # a rigid grasp's gap is rounding


def rotation_deg(result: Result, body: str) -> tuple[list[str], Array]:
    """Names and values (nt, k) of a body's rotation since the start, deg: about z, or a rotation vector."""
    if "body_angle" in result.data:
        angle = result.array("body_angle")[:, _place(result, body)]
        return ["z"], np.degrees(angle - angle[0])[:, None]
    return ["x", "y", "z"], np.degrees(result.array("body_rotation")[:, _place(result, body)])


def translation_mm(result: Result, body: str) -> tuple[list[str], Array]:
    """Names and values (nt, k) of a body's displacement since the start, mm."""
    axes = shown_axes(result)
    position = result.array("body_position")[:, _place(result, body), : len(axes)]
    return axes, (position - position[0]) * 1e3


def _place(result: Result, body: str) -> int:
    """Index of a body in a result."""
    return [str(name) for name in result.array("body")].index(body)


@figure(
    "Object rotation and translation",
    compares=True,
    applies=lambda result: result.scenario.target is not None,
    printed="Fig. 6",
    place=2,
)
@styled
def object_motion(*results: Result) -> Drawing:
    """Rotation and translation of the object since the start (Fig. 6), with a dash style for each result."""
    figure, axes = panels(1, 2, height_in=2.5)
    _overlay(axes[0], results, "target")
    names = {result.scenario.body_label("target") for result in results}
    name = names.pop() if len(names) == 1 else "object"
    axes[0, 0].set_title(f"(a) rotation of {name}")
    axes[0, 1].set_title(f"(b) translation of {name}")
    for panel in axes.flat:
        # what stands in one column is one result's
        legend_over(panel, columns=3 if len(results) == 1 else min(len(results), 2))
    return figure


@figure("Motion of the bases", place=7)
@styled
def base_motion(result: Result) -> Drawing:
    """Rotation and translation of each base since the start: a row for each robot, one scale for all."""
    robots = list(result.scenario.robots)
    figure, axes = panels(len(robots), 2, sharex=True, sharey="col", height_in=1.9)
    for row, robot in zip(axes, robots, strict=True):
        _overlay(row, (result,), robot)
        row[0].set_title(f"base of {robot}, rotation")
        row[1].set_title(f"base of {robot}, translation")
        for panel in row:
            mark_phases(panel, result, named=panel is axes[0, 0])
    legend_above(figure, *axes.flat, columns=8)
    below_last(axes)
    return figure


def _overlay(row: Sequence[Axes], results: Sequence[Result], body: str) -> None:
    several, labels = len(results) > 1, labels_of(results)
    for panel, values_of, quantity in (
        (row[0], rotation_deg, "rotation [deg]"),
        (row[1], translation_mm, "translation [mm]"),
    ):
        for index, (result, label) in enumerate(zip(results, labels, strict=True)):
            names, values = values_of(result, body)
            for k, name in enumerate(names):
                axis = f"about {name}" if values_of is rotation_deg else name
                look = {"color": COLOURS[k], "linestyle": DASHES[index % len(DASHES)]} if several else line(k)
                text = f"{label}, {axis}" if several else axis
                panel.plot(result.data.time.values, values[:, k], **look, label=text)
            until(panel, result)
        panel.set(xlabel="time [s]", ylabel=quantity)


@figure("Grip forces", applies=lambda result: bool(result.data.sizes["grasp"]), place=9)
@styled
def grip_forces(result: Result) -> Drawing:
    """Force, torque and gap of each grasp, a row for each; torques and gaps that are zero are left out."""
    data, names = result.data, shown_axes(result)
    quantities = [("grasp_force", "force", "N", 1.0, names)]
    if float(np.abs(data.grasp_torque.values).max(initial=0.0)) > 0:
        about = ["z"] if names == ["x", "y"] else names
        quantities.append(("grasp_torque", "torque", "N m", 1.0, about))
    if float(np.abs(data.grasp_gap.values).max(initial=0.0)) > _CLOSED_M:
        quantities.append(("grasp_gap", "gap", "mm", 1e3, names))
    grasps = [str(grasp) for grasp in data.grasp.values]
    figure, axes = panels(len(grasps), len(quantities), sharex=True, sharey="col")
    for row, grasp in zip(axes, grasps, strict=True):
        for panel, (variable, text, unit, scale, unit_label) in zip(row, quantities, strict=True):
            for name in unit_label:
                look = line("xyz".index(name))
                values = data[variable].sel(grasp=grasp, axis=name).values * scale
                panel.plot(data.time.values, values, **look, label=name)
            until(panel, result)
            mark_phases(panel, result, named=panel is axes[0, 0])
            panel.set(title=f"grasp {grasp}, {text}", ylabel=f"{text} [{unit}]", xlabel="time [s]")
    below_last(axes)
    legend_above(figure, axes[0, 0])
    return figure
