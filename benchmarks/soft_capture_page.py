"""Data and figure of docs/validation/soft_capture.md from results of both formulations.

``python -m benchmarks.soft_capture_page OURS THEIRS`` reads the files that ``benchmarks.soft_capture`` and
``benchmarks.soft_capture_convex`` wrote, writes docs/data/soft_capture.json and
docs/images/soft_capture.png, and prints the numbers of the page. With ``--arm FILE`` it reads the results of
``benchmarks.soft_capture --arm`` instead, and writes docs/data/soft_capture_arm.json and
docs/images/soft_capture_arm.png.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from scipy.stats import binomtest

from viz.figures.style import COLOURS, panels, styled, write_drawings

DOCS = Path(__file__).parents[1] / "docs"
Results = Mapping[int, dict[str, Any]]
"""Results by draw."""
LABELS = {
    "cpu_s": ("processor time", "s"),
    "duration_s": ("duration", "s"),
    "impulse_Ns": ("impulse", "N s"),
}


def read(path: Path) -> Results:
    """Results of a file, by draw."""
    lines = (json.loads(line) for line in path.read_text().splitlines())
    return {one.pop("draw"): rounded(one) for one in lines}


def rounded(value: Any) -> Any:
    """Value with its numbers rounded for the file."""
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    return round(value, 5) if isinstance(value, float) else value


@styled
def beside(ours: Results, theirs: Results) -> Figure:
    """Ratios, theirs to ours, of processor time, duration and impulse of the draws that both solve."""
    both = [k for k in ours if ours[k]["status"] == "verified" and theirs.get(k, {}).get("status") == "safe"]
    figure, axes = panels(1, len(LABELS), height_in=2.4)
    for panel, (key, (label, unit)) in zip(axes.flat, LABELS.items(), strict=True):
        x, y = ([results[k][key] for k in both] for results in (ours, theirs))
        ends = [min(*x, *y), max(*x, *y)]
        panel.plot(ends, ends, color="#7F7F7F", linewidth=0.8)
        panel.plot(x, y, "o", color=COLOURS[0], markersize=2.5)
        panel.set(xlabel=f"{label} here ({unit})", ylabel=f"convex program ({unit})")
        if key == "cpu_s":
            panel.set(xscale="log", yscale="log")
            for axis in (panel.xaxis, panel.yaxis):
                axis.set_major_formatter("{x:g}")
                axis.set_minor_formatter(NullFormatter())
    return figure


@styled
def grasps(arm: Results) -> Figure:
    """Cumulative shares of the draws over processor time, error of the tip and distances of the arm."""
    verified = [one for one in arm.values() if one["status"] == "verified"]
    distances = {
        f"from the {body}": [-one["excess"][f"arm to {body}"] for one in verified]
        for body in ("chaser", "target")
    }
    curves: dict[str, dict[str, list[float]]] = {
        "processor time (s), all draws": {"": [one["cpu_s"] for one in arm.values()]},
        "error of the tip at the grasp (mm)": {"": [1e3 * one["tip_error_m"] for one in verified]},
        "smallest distance of the arm (m)": distances,
    }
    figure, axes = panels(1, len(curves), height_in=2.4, sharey=True)
    for panel, (label, lines) in zip(axes.flat, curves.items(), strict=True):
        for colour, (name, values) in zip(COLOURS, lines.items(), strict=False):
            panel.ecdf(values, color=colour, label=name)
        panel.set(xlabel=label)
    panel.legend(fontsize=7, loc="center", bbox_to_anchor=(0.68, 0.5))
    axes.flat[0].set(ylabel="share of the draws", xscale="log")
    axes.flat[0].xaxis.set_major_formatter("{x:g}")
    return figure


def print_numbers(results: Results, solved: str) -> None:
    """Print the share of solved draws with its intervals, and quantiles of times.

    Args:
        results: Results by draw.
        solved: Status of a solved draw.
    """
    count, hits = len(results), sum(one["status"] == solved for one in results.values())
    print(f"{hits} of {count} {solved}")
    for method in ("exact", "wilson"):
        interval = binomtest(hits, count).proportion_ci(0.95, method)
        print(f"  {method}: {100 * interval.low:.2f} to {100 * interval.high:.2f} %")
    for key in ("cpu_s", "last_cpu_s", "duration_s", "impulse_Ns", "iterations"):
        values = [one[key] for one in results.values() if one.get(key) is not None]
        if values:
            middle, late = np.quantile(values, [0.5, 0.95])
            print(f"  {key}: median {middle:.4g}, 95 % {late:.4g}, max {max(values):.4g}")
    failures = {k: one for k, one in results.items() if one["status"] != solved}
    for k, one in failures.items():
        print(f"  draw {k}: {one['status']}, {one.get('why', '')[:300]}")


def main() -> None:
    """Write the data and the figure, and print the numbers."""
    if sys.argv[1] == "--arm":
        arm = read(Path(sys.argv[2]))
        lines = [json.dumps({"draw": k, "here": arm[k]}) for k in sorted(arm)]
        (DOCS / "data" / "soft_capture_arm.json").write_text("[\n" + ",\n".join(lines) + "\n]\n")
        write_drawings([("soft_capture_arm", grasps(arm))], DOCS / "images", ["png"])
        print_numbers(arm, "verified")
        verified = [one for one in arm.values() if one["status"] == "verified"]
        for key in ("tip_error_m", "tip_speed_m_s", "tip_angle_deg", "base_slip_m_s", "joint_torque_Nm"):
            print(f"largest {key} of verified draws: {max(one[key] for one in verified):.5f}")
        for key in ("joint_motion_deg", "arm_rotation_deg"):
            values = [one[key] for one in verified]
            print(f"{key}: median {np.median(values):.2f}, largest {max(values):.2f}")
        for key in verified[0]["excess"]:
            print(f"largest {key}: {max(one['excess'][key] for one in verified):.5f}")
        return
    ours, theirs = (read(Path(word)) for word in sys.argv[1:3])
    lines = [json.dumps({"draw": k, "here": ours[k], "convex": theirs.get(k)}) for k in sorted(ours)]
    (DOCS / "data" / "soft_capture.json").write_text("[\n" + ",\n".join(lines) + "\n]\n")
    write_drawings([("soft_capture", beside(ours, theirs))], DOCS / "images", ["png"])
    print_numbers(ours, "verified")
    print_numbers({k: one for k, one in theirs.items() if k in ours}, "safe")
    both = [k for k in ours if ours[k]["status"] == "verified" and theirs.get(k, {}).get("status") == "safe"]
    for key in ("impulse_Ns", "duration_s"):
        ratios = [ours[k][key] / theirs[k][key] for k in both]
        words = ", ".join(f"{value:.2f}" for value in np.quantile(ratios, [0, 0.25, 0.5, 0.75, 1]))
        print(f"{key} here over theirs, {len(both)} draws, extremes and quartiles: {words}")
    for key in ours[both[0]]["excess"]:
        print(f"largest {key}: {max(ours[k]['excess'][key] for k in both):.5f}")


if __name__ == "__main__":
    main()
