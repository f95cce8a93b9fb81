"""The ledger: momentum and energy, and how well they are kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from spacerobot.common.arrays import Array
from spacerobot.result import Result
from spacerobot.result.ledger import SMALLEST, conserved_momentum, work_text, works_of
from viz.figures.kind import figure
from viz.figures.style import Drawing, legend_over, line, panels, styled, until

_ALWAYS = ("work_actuator", "work_joint")
_NONE_J = 1e-12  # below, a work is rounding: grips without dampers, or rigid ones


@figure("The ledger: momentum and energy", place=15)
@styled
def ledger(result: Result) -> Drawing:
    """Momentum of each body and of all, energy, and the errors of both balances."""
    figure, axes = panels(2, 2, height_in=2.4, sharex=True)
    _momentum(axes[0, 0], result, "linear")
    _momentum(axes[0, 1], result, "angular")
    data, panel = result.data, axes[1, 0]
    for k, work in enumerate(works_of(data)):
        if work.name in _ALWAYS or np.any(np.abs(work.values) > _NONE_J):
            panel.plot(data.time.values, work.values, **line(k), label=work_text(work))
    panel.plot(data.time.values, stored_change(result), color="black", linewidth=2, label="stored")
    panel.set(title="energy since the start", ylabel="energy [J]")
    legend_over(panel, columns=2)
    # drift of the momenta and residual of the energy, each relative to the largest of its kind
    panel, conserved = axes[1, 1], result.summary["ledger"]["momentum"]["conserved"]
    drifts = {kind: relative_drift(result, kind) for kind in (("linear", "angular") if conserved else ())}
    stored = data.energy_kinetic + data.energy_spring + data.energy_potential
    sizes = [stored_change(result), stored.values, *(work.values for work in works_of(data))]
    largest = max(float(np.abs(size).max()) for size in sizes)
    drifts["energy"] = np.abs(energy_astray(result)) / (largest or 1.0)
    for k, (name, values) in enumerate(drifts.items()):
        # the residual is zero at the start except for rounding; zeros cannot be drawn on a logarithmic axis
        panel.plot(data.time.values, np.where(values > 0, values, np.nan), **line(k), label=name)
    if not any(np.any(values > 0) for values in drifts.values()):
        panel.text(0.5, 0.5, "nothing: exactly zero", transform=panel.transAxes, ha="center")
    panel.set_yscale("log")
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0e}"))
    panel.yaxis.set_minor_formatter(NullFormatter())
    panel.set(title="momentum drift, open energy", ylabel="relative to the largest")
    legend_over(panel, columns=2)
    for panel in axes.flat:
        panel.set_xlabel("time [s]")
        panel.tick_params(labelbottom=True)
        until(panel, result)
    return figure


def _momentum(panel: Axes, result: Result, kind: str) -> None:
    data = result.data
    bodies, total = data[f"body_momentum_{kind}"], data[f"momentum_{kind}"]
    # the axis with the largest momentum of a body
    axis = int(np.abs(bodies.values).max(axis=(0, 1)).argmax())
    for k, body in enumerate(data.body.values):
        values = bodies.sel(body=body).values[:, axis]
        panel.plot(data.time.values, values, **line(k), label=result.scenario.body_label(str(body)))
    panel.plot(data.time.values, total.values[:, axis], color="black", linewidth=2, label="all together")
    if f"impulse_{kind}" in data:
        impulse = data[f"impulse_{kind}"].values[:, axis]
        panel.plot(data.time.values, impulse, **line(data.sizes["body"]), label="given from outside")
    name = str(data.axis.values[axis])
    label = f"{kind} momentum {name} [{total.attrs['units']}]"
    panel.set(title=f"{kind} momentum, {name}", ylabel=label)
    legend_over(panel, columns=2)


def stored_change(result: Result) -> Array:
    """Kinetic, spring and potential energy since the start, J."""
    data = result.data
    stored = data.energy_kinetic + data.energy_spring + data.energy_potential
    return np.asarray((stored - stored[0]).values, dtype=np.float64)


def energy_astray(result: Result) -> Array:
    """Residual of the energy balance [J]."""
    flow = sum(work.attrs["sign"] * work.values for work in works_of(result.data))
    return np.asarray(stored_change(result) - flow, dtype=np.float64)


def relative_drift(result: Result, kind: str) -> Array:
    """Drift (nt,) of the ``linear`` or ``angular`` momentum, relative to the largest partial momentum."""
    total, ledger = conserved_momentum(result.data, kind).values, result.summary["ledger"]["momentum"]
    momentum: Mapping[str, Any] = ledger["linear"] if kind == "linear" else ledger["angular"]
    (largest,) = (value for key, value in momentum.items() if key.startswith("largest_partial_"))
    drift = np.linalg.norm(total - total[0], axis=-1)
    return np.asarray(drift / max(largest, SMALLEST), dtype=np.float64)
