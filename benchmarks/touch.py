"""Figures of docs/validation/touch.md: spin over time, peak force over the impedance, P(caged).

python -m benchmarks.touch              # simulate all parts, write data and figures
python -m benchmarks.touch peak caged   # simulate these parts, and draw the data of the others

The data is docs/data/touch.json.
"""

import json
import runpy
import sys
from pathlib import Path

import numpy as np
from scipy.stats import binomtest, qmc

import spacerobot as sr
from viz.figures.style import COLOURS, DASHES, legend_above, panels, styled, write_drawings

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
COMPARE = runpy.run_path(str(ROOT / "examples" / "touch" / "compare.py"))
"""Hands and draws of the example."""
DATA = DOCS / "data" / "touch.json"
SHOWN = {"contacts as the cube gives them": "wait for 40 s, close in 8 s"} | {
    name: name for name in ("close at once in 8 s", "contacts chosen by prediction")
}
DRAWS = (0, 7)
"""Draws of compare.py that are shown."""
STIFFNESSES, DAMPINGS = (5, 20, 60, 180, 600, 2000), (5, 10, 40, 120, 360)
"""Stiffness [N/m] and damping [N s/m] of both hands."""
SPINS = (15, 60)
FASTEST, SAMPLES, BINS = 240.0, 256, (6, 4)
"""Campaign over spin [deg/s] and friction: range, samples, and bins of each."""
INERTIA = 0.533333
"""Of the cube about its centre [kg m^2]."""


def spin(data):
    """Spin of the cube [deg/s], by its angular momentum about its centre (times,)."""
    cube = data.sel(body="target")
    place, momentum = cube.body_position.values, cube.body_momentum_linear.values
    orbital = place[:, 0] * momentum[:, 1] - place[:, 1] * momentum[:, 0]
    return np.degrees((cube.body_momentum_angular.values[:, 2] - orbital) / INERTIA)


def spins():
    """Spin over the first 30 s of some draws, for each kind of hands."""
    draws, _ = COMPARE["draws_without_overlap"](max(DRAWS) + 1)
    rows = []
    for k in DRAWS:
        paths = {path: values.item() for path, values in COMPARE["numbers"](draws[[k]]).items()}
        row = {"draw": k + 1, "spin": draws[k, 0], "friction": draws[k, 2], "lines": {}}
        for label, name in SHOWN.items():
            changes = COMPARE["HANDS"][name] | paths | {"simulation.duration": COMPARE["CLOSING"]}
            data = sr.simulate(sr.load_scene("touch", changes), backend="compiled").data
            time = np.arange(0, data.time.values[-1], 0.1)
            values = np.interp(time, data.time.values, spin(data))
            row["lines"][label] = {"time": time.round(2).tolist(), "spin": values.round(3).tolist()}
        rows.append(row)
    return rows


def peaks():
    """Peak contact force [N] of waiting hands within 40 s (spins, stiffnesses, dampings)."""
    spin_deg, stiffness, damping = (
        grid.ravel() for grid in np.meshgrid(SPINS, STIFFNESSES, DAMPINGS, indexing="ij")
    )
    values = {"target.base.spin_deg.2": spin_deg}
    for tip in ("left_tip", "right_tip"):
        for k in range(3):
            soft = f"robots.chaser.tips.{tip}.controllers.soft"
            values |= {f"{soft}.stiffness.{k}": stiffness, f"{soft}.damping.{k}": damping}
    scene = sr.load_scene("touch", {"simulation.duration": 40})
    data = sr.batch(scene, "contact_force_peak", values).data
    largest = np.array(data.contact_force_peak).reshape(len(spin_deg), -1).max(axis=1)
    return largest.reshape(len(SPINS), len(STIFFNESSES), len(DAMPINGS)).round(3).tolist()


def caged():
    """Spin, friction and time until caged of each sample, negative if it is not caged, and its peak force."""
    lower, upper = [10, -45, 0, 0.95, 0], [FASTEST, 45, 1, 0.95, 0]
    draws = lower + (np.array(upper) - lower) * qmc.Sobol(5, seed=3).random(SAMPLES)
    data = sr.batch(
        sr.load_scene("touch"), ["capture_time", "contact_force_peak"], COMPARE["numbers"](draws)
    ).data
    times, forces = (
        np.array(data[name]).reshape(SAMPLES, -1).max(axis=1)
        for name in ("capture_time", "contact_force_peak")
    )
    return {
        "spin": draws[:, 0].round(2).tolist(),
        "friction": draws[:, 2].round(4).tolist(),
        "time": np.nan_to_num(times, nan=-1).round(2).tolist(),
        "peak": np.nan_to_num(forces, nan=-1).round(2).tolist(),
    }


@styled
def spin_figure(rows):
    """Spin over time, one panel for each draw."""
    figure, axes = panels(1, len(rows), height_in=2.4, sharey=True)
    for panel, row in zip(axes.flat, rows, strict=True):
        for k, (label, one) in enumerate(row["lines"].items()):
            panel.plot(one["time"], one["spin"], color=COLOURS[k], linestyle=DASHES[k], label=label)
        title = f"draw {row['draw']}: {row['spin']:.0f} deg/s, friction {row['friction']:.2f}"
        panel.set(title=title, ylim=(-30, 200))
        panel.set_yscale("symlog", linthresh=1)
        panel.set_yticks([-10, -1, 0, 1, 10, 100], ["-10", "-1", "0", "1", "10", "100"])
    for panel in axes.flat:
        panel.set_xlabel("time [s]")
    for panel in axes[:, 0]:
        panel.set_ylabel("spin of the cube [deg/s]")
    legend_above(figure, axes[0, 0])
    return figure


@styled
def peak_figure(values):
    """Peak force over stiffness and damping, one panel for each spin."""
    figure, axes = panels(1, len(SPINS), height_in=2.6)
    for panel, spin_deg, grid in zip(axes.flat, SPINS, np.array(values), strict=True):
        panel.imshow(grid, cmap="Blues", aspect="auto", vmin=0.7 * grid.min(), vmax=1.2 * grid.max())
        panel.set_xticks(range(len(DAMPINGS)), DAMPINGS)
        panel.set_yticks(range(len(STIFFNESSES)), STIFFNESSES)
        panel.set(xlabel="damping [N s/m]", ylabel="stiffness [N/m]")
        panel.set_title(f"Peak contact force [N], {spin_deg} deg/s")
        panel.grid(visible=False)
        for (i, j), value in np.ndenumerate(grid):
            panel.text(
                j, i, f"{value:.1f}" if spin_deg > SPINS[0] else f"{value:.2f}", ha="center", va="center"
            )
    return figure


@styled
def caged_figure(samples):
    """Samples over spin and friction with the time until caged, and P(caged) in bins."""
    figure, axes = panels(1, 2, height_in=2.6)
    spin_deg, friction, time = (np.array(samples[name]) for name in ("spin", "friction", "time"))
    is_caged = time > 0
    points, table = axes.flat
    markers = points.scatter(
        spin_deg[is_caged], friction[is_caged], c=time[is_caged], s=12, cmap="viridis", label="caged"
    )
    points.plot(spin_deg[~is_caged], friction[~is_caged], "x", color=COLOURS[1], label="diverged")
    figure.colorbar(markers, ax=points, label="caged after [s]")
    points.legend(loc="lower right", fontsize=7, frameon=True)
    edges = (np.linspace(10, FASTEST, BINS[0] + 1), np.linspace(0, 1, BINS[1] + 1))
    count = np.histogram2d(spin_deg, friction, edges)[0]
    good = np.histogram2d(spin_deg[is_caged], friction[is_caged], edges)[0]
    table.pcolormesh(*edges, (good / count).T, cmap="Blues", vmin=0, vmax=1.4)
    for i, j in np.ndindex(*BINS):
        low, high = binomtest(int(good[i, j]), int(count[i, j])).proportion_ci(0.95, "wilson")
        words = f"{100 * good[i, j] / count[i, j]:.0f}\n{100 * low:.0f}..{100 * high:.0f}"
        table.text(
            *(edge[k : k + 2].mean() for edge, k in zip(edges, (i, j), strict=True)),
            words,
            ha="center",
            va="center",
            fontsize=7,
        )
    table.grid(visible=False)
    points.set_title("Samples")
    table.set_title("P(caged) with 95 % interval [%]")
    for panel in axes.flat:
        panel.set(xlabel="spin [deg/s]", ylabel="friction", xlim=(10, FASTEST), ylim=(0, 1))
    return figure


PARTS = {"spin": (spins, spin_figure), "peak": (peaks, peak_figure), "caged": (caged, caged_figure)}


def main() -> None:
    """Simulate the named parts, or all, and draw all parts of the data."""
    data = json.loads(DATA.read_text(encoding="utf-8")) if DATA.exists() else {}
    for name in sys.argv[1:] or PARTS:
        data[name] = PARTS[name][0]()
        DATA.write_text(json.dumps(data) + "\n", encoding="utf-8")
    drawings = {f"touch_{name}": PARTS[name][1](values) for name, values in data.items()}
    write_drawings(drawings.items(), DOCS / "images", ["svg"])


if __name__ == "__main__":
    main()
