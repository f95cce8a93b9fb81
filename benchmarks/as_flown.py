"""Figures of docs/validation/as_flown.md from the folders of its campaigns.

``python -m benchmarks.as_flown out/docking out/captures`` writes docs/images/docking_as_flown.png and
docs/images/capture_as_flown.png. ``python -m benchmarks.as_flown engines`` simulates the scenarios and
``examples/capture-rendezvous.yaml`` by both engines (ten minutes), and prints differences of their states.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

import spacerobot as sr
from optim.campaign.analysis.statistics import sobol_indices
from spacerobot.quantities import quantities
from viz.figures.campaign import SampleSpread, distributions
from viz.figures.style import COLOURS, legend_above, panels, styled, write_drawings

FACTORS = {"m/s": ("mm/s", 1e3), "m": ("mm", 1e3)}
DOCKING = ("capture_time", "touchdown_speed", "lateral_miss", "grip_force_peak")
CAPTURE = ("touchdown_speed", "lateral_miss", "impulse")
CONFIDENCE = 0.95
IMAGES = Path(__file__).parents[1] / "docs" / "images"


def spreads(folder: Path, metrics: tuple[str, ...]) -> list[SampleSpread]:
    """Metrics of the captured samples of a campaign, separately for each grasp."""
    table = []
    with xr.open_dataset(folder / "campaign.nc") as data:
        captured = data["captured"].isel(gains=0).values > 0
        for metric in metrics:
            quantity = quantities()[metric]
            unit, factor = FACTORS.get(quantity.unit, (quantity.unit, 1.0))
            values = data[metric].isel(gains=0)
            samples = {
                str(label): factor * values.isel({f"{metric}_of": k}).values[captured[:, k]]
                for k, label in enumerate(data[f"{metric}_of"].values)
            }
            table.append(SampleSpread(samples, quantity.label, unit))
    return table


@styled
def shares(folder: Path, metrics: tuple[str, ...]) -> Figure:
    """Bars of the total Sobol' indices of metrics, grouped by parameter; missing values count as zero."""
    with xr.open_dataset(folder / "campaign.nc") as data:
        names = [str(name) for name in data.parameter.values]
        values = {
            metric: data[metric].isel(gains=0).max(f"{metric}_of").fillna(0).values for metric in metrics
        }
    figure, axes = panels(1, 1, height_in=2.6)
    panel, width = axes[0, 0], 0.8 / len(metrics)
    for k, metric in enumerate(metrics):
        indices = sobol_indices(values[metric], names, CONFIDENCE)
        assert indices is not None, f"{metric} does not vary"
        place = np.arange(len(names)) + (k - (len(metrics) - 1) / 2) * width
        bars = {"color": COLOURS[k], "yerr": indices.total_width, "error_kw": {"linewidth": 0.7}}
        panel.bar(place, indices.total, width=width, label=quantities()[metric].label, **bars)
    panel.set_xticks(np.arange(len(names)), [name.replace("_", "\n") for name in names])
    panel.set_ylabel("total Sobol' index")
    panel.set_ylim(bottom=0)
    legend_above(figure, panel, columns=len(metrics))
    return figure


def compare_engines(name: str) -> str:
    """Largest differences of states at the samples and of the times of events between the engines, in words.

    The difference of a state that exceeds 1 in its unit is divided by the largest value of that state.
    """
    settings = {"step": 0.005, "output_step": 0.25, "tolerance": 1e-11}
    changes = {f"simulation.{key}": value for key, value in settings.items()}
    ours, theirs = (
        sr.simulate(sr.load_scene(name, changes | {"simulation.engine": engine}))
        for engine in ("casadi", "pinocchio")
    )
    count = min(ours.data.sizes["time"], theirs.data.sizes["time"])
    difference = 0.0
    for key in "qvz":
        one, other = (each.data[key].values[:count] for each in (ours, theirs))
        difference = max(difference, float((abs(one - other) / np.maximum(1, abs(one).max(axis=0))).max()))
    times = [[event["time_s"] for event in each.summary["events"]] for each in (ours, theirs)]
    late = max(abs(one - other) for one, other in zip(*times, strict=True))
    states = f"{count} samples, states differ by at most {difference:.1e}"
    return f"{name}: {states}, {len(times[0])} events by {late:.1e} s"


def main() -> None:
    """Write both figures, or compare the engines."""
    if sys.argv[1:] == ["engines"]:
        for name in ("capture-as-flown", "examples/capture-rendezvous.yaml", "docking-as-flown"):
            print(compare_engines(name), flush=True)
        return
    docking, capture = (Path(word) for word in sys.argv[1:3])
    drawings = {
        "docking_as_flown": distributions(spreads(docking, DOCKING)),
        "capture_as_flown": shares(capture, CAPTURE),
    }
    write_drawings(drawings.items(), IMAGES, ["png"])


if __name__ == "__main__":
    main()
