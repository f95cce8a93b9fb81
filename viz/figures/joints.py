"""Joint angles and torques."""

from __future__ import annotations

import numpy as np

from spacerobot.common.tables import unit_scale
from spacerobot.result import Result
from viz.figures.kind import figure
from viz.figures.style import COLOURS, DASHES, Drawing, below_last, legend_beside, panels, styled, until

_NAME_IN = 0.17
"""Height of a joint's name in the legend."""


@figure("Joint angles and actuator torques", applies=lambda result: bool(result.data.sizes["joint"]), place=8)
@styled
def joints(result: Result) -> Drawing:
    """Joint angles and actuator torques: a row for each robot, colours and dashes for its joints."""
    labels = [str(joint) for joint in result.data.joint.values]
    robots = [name for name in result.scenario.robots if any(j.startswith(f"{name}/") for j in labels)]
    most = max(sum(j.startswith(f"{name}/") for j in labels) for name in robots)
    figure, axes = panels(len(robots), 2, sharex=True, height_in=max(2.6, _NAME_IN * most))
    for row, robot in zip(axes, robots, strict=True):
        mine = [joint for joint in labels if joint.startswith(f"{robot}/")]
        for panel, variable, text in (
            (row[0], "joint_position", "joint angles"),
            (row[1], "joint_torque", "actuator torques"),
        ):
            values = result.data[variable]
            scale, unit = unit_scale(values.attrs["units"])
            for k, joint in enumerate(mine):
                # the colours come round again with other dashes
                dashes = DASHES[(k + k // len(COLOURS)) % len(DASHES)]
                look = {"color": COLOURS[k % len(COLOURS)], "linestyle": dashes, "linewidth": 1.1}
                curve = values.sel(joint=joint).values * scale
                panel.plot(result.data.time.values, curve, label=joint.partition("/")[2], **look)
            turns = result.data.joint_position.attrs["units"] == "rad"
            quantity = {"deg": "angle", "N m": "torque"}.get(unit, values.attrs["long_name"])
            title = f"{robot}, {text if turns else values.attrs['long_name']}"
            panel.set(title=title, xlabel="time [s]", ylabel=f"{quantity} [{unit}]")
            until(panel, result)
            if not result.completed:
                calm = np.abs(values.values[: max(2, int(0.8 * len(values)))] * scale).max()
                panel.set_ylim(-2 * calm - 1e-9, 2 * calm + 1e-9)
    below_last(axes)
    legend_beside(figure, axes)
    return figure
