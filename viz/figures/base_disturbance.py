"""Base disturbance by the motion of the arm, for several controllers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from spacerobot.result import Result
from viz.figures.bodies import rotation_deg, translation_mm
from viz.figures.style import Drawing, below_last, legend_above, line, panels, styled, until


@styled
def disturbance(results: Mapping[str, Result]) -> Drawing:
    """Rotation and translation of the first robot's base, and the torques, over time.

    Args:
        results: Results of the same task, by name.
    """
    figure, axes = panels(1, 3, height_in=2.3, sharex=True)
    for k, (name, result) in enumerate(results.items()):
        robot, time = next(iter(result.scenario.robots)), result.data.time.values
        is_own = [str(label).startswith(f"{robot}/") for label in result.data.joint.values]
        torque = np.sqrt((result.data.joint_torque.values[:, is_own] ** 2).mean(axis=1))
        sizes = (
            np.linalg.norm(rotation_deg(result, robot)[1], axis=1),
            np.linalg.norm(translation_mm(result, robot)[1], axis=1),
            torque,
        )
        for panel, size in zip(axes.flat, sizes, strict=True):
            panel.plot(time, size, **line(k), label=name)
            until(panel, result)
    titles = ("(a) base rotation", "deg"), ("(b) base translation", "mm"), ("(c) joint torque, rms", "N m")
    for panel, (title, unit) in zip(axes.flat, titles, strict=True):
        panel.set(title=title, xlabel="time [s]", ylabel=unit)
        panel.set_ylim(bottom=0)
    below_last(axes)
    legend_above(figure, axes[0, 0], columns=3)
    return figure
