"""A campaign in a report: how the metrics spread, how often it fails, what matters, the worst sample."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from spacerobot.errors import ResultError
from spacerobot.result import Result
from viz.figures import robustness, sensitivities, to_bytes
from viz.figures.style import unit_scale
from viz.report import SECTIONS, Section, report
from viz.report_sections import escape, table

DRAWN = ("tip_error_peak", "joint_torque_peak", "grip_force_peak", "target_rotation_peak")
LIMITS = {
    "tip_error_peak": "tip_error",
    "joint_torque_peak": "joint_torque",
    "grip_force_peak": "grip_force",
    "target_rotation_peak": "target_rotation_deg",
}


def campaign_section(folder: Path) -> Section:
    """Section of a report about the campaign in a folder.

    Parameters
    ----------
    folder
        What ``spacerobot campaign`` wrote.

    Raises
    ------
    ResultError
        If it holds no campaign with a summary.
    """
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        data = xr.load_dataset(folder / "campaign.nc", engine="netcdf4")
        text = "".join([_head(summary), _failures(summary), _drawings(summary, data), _worst(summary)])
    except (OSError, ValueError, KeyError) as fault:
        raise ResultError(f"holds no campaign that can be shown: {fault}", source=folder) from None
    return Section("campaign", "Campaign", lambda _: text)


def campaign_report(folder: Path, worst: Result) -> str:
    """HTML of a report about a campaign, with its worst sample as the result that is shown and animated.

    Raises
    ------
    ResultError
        If the folder holds no campaign with a summary.
    """
    title = f"Campaign of {worst.scenario.name}; shown: its worst sample"
    return report(worst, title=title, sections=(campaign_section(folder), *SECTIONS))


def _head(summary: Mapping[str, Any]) -> str:
    return (
        f"<p>{summary['samples']} of {summary['of']} samples of {escape(', '.join(summary['parameters']))}; "
        f"design {escape(summary['design'])}, seed {summary['seed']}.</p>"
    )


def _failures(summary: Mapping[str, Any]) -> str:
    causes = list(next(iter(summary["gains"].values()))["failure"])
    rows = [
        [name, *(_share(told["failure"][cause]) for cause in causes)]
        for name, told in summary["gains"].items()
    ]
    level = f"{100 * summary['confidence']:g} %"
    note = f"<p>Share of samples that fail, with its {level} interval where samples are random.</p>"
    return note + table(["gains", *causes], rows)


def _share(told: Mapping[str, Any]) -> str:
    text = f"{100 * told['value']:.3g} %"
    if told["low"] is None:
        return text
    return f"{text} ({100 * told['low']:.3g} to {100 * told['high']:.3g})"


def _drawings(summary: Mapping[str, Any], data: xr.Dataset) -> str:
    parts = []
    for metric in (name for name in DRAWN if name in data):
        factor, unit = unit_scale(str(data[metric].attrs["units"]))
        largest = factor * data[metric].max(f"{metric}_of", skipna=False)
        samples = {str(name): largest.sel(gains=name).values for name in data.gains.values}
        limit = summary["limits"].get(LIMITS[metric])
        quantity = metric.replace("_peak", "").replace("_", " ")
        figure = robustness(
            samples,
            quantity=f"largest {quantity}",
            unit=unit,
            limit=None if limit is None else factor * limit,
        )
        parts.append(_figure(figure, f"How the largest {quantity} spreads"))
    for name, told in summary["gains"].items():
        parts.append(_matters(name, told["matters"], summary["parameters"]))
    return "".join(parts)


def _matters(gains: str, matters: Mapping[str, Any], parameters: list[str]) -> str:
    """Strength of each parameter on each metric, as bars where there is one, else nothing."""
    rows, kinds = [], set()
    for metric, entry in matters.items():
        found = entry["total"] if entry["kind"] == "sobol" else entry["value"]
        kinds.add("Sobol' indices, total" if entry["kind"] == "sobol" else "rank correlations")
        values = [found[name] for name in parameters]
        rows.append([metric, *("-" if v is None else f"{v:+.2f}" for v in values)])
    heading = f"<h3>What matters with the gains {escape(gains)}</h3><p>{escape('; '.join(sorted(kinds)))}</p>"
    first = next(iter(matters.values()))
    values = first["total"] if first["kind"] == "sobol" else first["value"]
    bars = np.array([values[name] or 0.0 for name in parameters])
    text = heading + table(["metric", *parameters], rows)
    if bars.any() and len(parameters) > 1:
        metric = next(iter(matters)).replace("_", " ")
        figure = sensitivities(parameters, {gains: bars}, quantity=metric)
        figure.axes[0].set_xlabel(f"{'; '.join(sorted(kinds))} with {metric} [1]")
        text += _figure(figure, f"What {metric} depends on, gains {gains}")
    return text


def _worst(summary: Mapping[str, Any]) -> str:
    parts = []
    for name, told in summary["gains"].items():
        worst = told["worst"][0]
        rows = [[key, f"{value:.6g}"] for key, value in worst["draw"].items()]
        parts.append(f"<h3>Worst sample with the gains {escape(name)}: {worst['sample']}</h3>")
        parts.append(table(["", ""], rows))
        command = escape(worst["command"])
        parts.append(f"<details><summary>run it again</summary><pre>{command}</pre></details>")
    return "".join(parts)


def _figure(drawing: Any, title: str) -> str:
    svg = base64.b64encode(to_bytes(drawing, "svg")).decode("ascii")
    image = f'<img alt="{escape(title)}" src="data:image/svg+xml;base64,{svg}">'
    return f"<figure>{image}<figcaption>{escape(title)}</figcaption></figure>"
