"""What the animated page plots over time, as plain data."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from spacerobot.result import Result
from viz.figures.bodies import rotation_deg
from viz.figures.style import called
from viz.geometry import Array
from viz.meshcat_scene import packed

Rows = np.ndarray[tuple[int], np.dtype[np.int64]]

TITLES = (
    ("tip error", "mm"),
    ("grip force", "N"),
    ("rotation since the start", "deg"),
    ("linear momentum", "N s"),
)
"""Quantity and unit of every plot, in order."""


def curves(result: Result, rows: Rows) -> list[dict[str, Any]]:
    """Tip errors, grip forces, rotations and momenta at rows of a result's data.

    Returns
    -------
    list of dict
        ``title``, ``unit`` and ``curves``, each with its ``name``, ``colour`` and packed ``values``. A colour
        is ``[kind, k]``: that of the tip number k, of the body number k, or of all together.
    """
    drawn = (_errors(result, rows), _forces(result, rows), _rotations(result, rows), _momenta(result, rows))
    return [_plot(k, found) for k, found in enumerate(drawn)]


def no_curves() -> list[dict[str, Any]]:
    """The same for a scene that has not been simulated yet."""
    return [_plot(k, ()) for k in range(len(TITLES))]


Curve = tuple[str, tuple[str, int], Array]


def _plot(which: int, found: Iterable[Curve]) -> dict[str, Any]:
    title, unit = TITLES[which]
    drawn = [{"name": name, "colour": colour, "values": packed(values)} for name, colour, values in found]
    return {"title": title, "unit": unit, "curves": drawn}


def _errors(result: Result, rows: Rows) -> list[Curve]:
    size = np.linalg.norm(result.data.tip_error.values[rows], axis=-1) * 1e3
    return [(str(tip), ("tip", k), size[:, k]) for k, tip in enumerate(result.data.tip.values)]


def _forces(result: Result, rows: Rows) -> list[Curve]:
    tips = [str(tip) for tip in result.data.tip.values]
    size = np.linalg.norm(result.data.grasp_force.values[rows], axis=-1)
    grasps = result.scenario.grasps
    return [
        (str(name), ("tip", tips.index(grasps[str(name)].tip)), size[:, k])
        for k, name in enumerate(result.data.grasp.values)
    ]


def _rotations(result: Result, rows: Rows) -> list[Curve]:
    found = []
    for k, body in enumerate(map(str, result.data.body.values)):
        names, values = rotation_deg(result, body)
        turned = values[rows, 0] if len(names) == 1 else np.linalg.norm(values[rows], axis=-1)
        found.append((called(body), ("body", k), turned))
    return found


def _momenta(result: Result, rows: Rows) -> list[Curve]:
    data = result.data
    size = np.linalg.norm(data.body_momentum_linear.values[rows], axis=-1)
    found: list[Curve] = [
        (called(str(body)), ("body", k), size[:, k]) for k, body in enumerate(data.body.values)
    ]
    return [*found, ("all together", ("all", 0), np.linalg.norm(data.momentum_linear.values[rows], axis=-1))]
