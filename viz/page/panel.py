"""Side panel of a page without a server: metrics of results, and their differences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from spacerobot.quantities import metrics
from spacerobot.result import Result
from spacerobot.scenario.load import to_document
from viz.figures.labels import differences

MOST_DIFFERENCES = 60


def panel_data(results: Sequence[Result], names: Sequence[str]) -> dict[str, Any]:
    """Metrics of results, and the numbers that differ between their scenarios.

    Returns:
        dict: ``metrics``, each with ``key``, ``label``, ``unit`` and ``text``; ``designs``, one for each
            result, with its ``name``, ``values`` of the metrics (None if missing) and ``numbers`` (texts by
            dotted path).
    """
    # value and unit of each quantity of a result; empty for a diverged one
    tables: list[dict[str, tuple[float | None, str]]] = []
    for result in results:
        summary, is_completed = result.summary, result.completed
        rows: list[tuple[str, float, str]] = []
        errors = [summary["tip_error"][tip] for tip in result.led_tips]
        if errors:
            peaks = [
                max(-axis["min_m"], axis["max_m"]) for tip in errors for k, axis in tip.items() if k != "norm"
            ]
            rows.append(("tip_error_peak", 1e3 * max(peaks), "mm"))
            time = result.data.time.values
            squares = (result.data.tip_error.sel(tip=result.led_tips).values ** 2).sum(axis=(1, 2))
            rms = float(np.sqrt(np.trapezoid(squares, time) / (time[-1] - time[0]))) if len(time) > 1 else 0.0
            rows.append(("tip_error_rms", 1e3 * rms, "mm"))
        if summary["target"]:
            rows.append(("target_rotation_peak", summary["target"]["max_rotation_deg"], "deg"))
        if summary["bases"]:
            turned = max(base["max_rotation_deg"] for base in summary["bases"].values())
            rows.append(("base_rotation_peak", turned, "deg"))
        if summary["greatest_torque"]["joint"] is not None:
            torque = summary["greatest_torque"]
            rows.append(("joint_torque_peak", torque["torque_n_m"], torque["unit"]))
        if summary["greatest_grip"]["grasp"] is not None:
            rows.append(("grip_force_peak", summary["greatest_grip"]["force_n"], "N"))
        if "attitude_error" in summary:
            worst = max(error["max_deg"] for error in summary["attitude_error"].values())
            rows.append(("attitude_error_peak", worst, "deg"))
        if "wheel_momentum" in result.data:
            size = np.linalg.norm(result.data.wheel_momentum.dropna("body", how="all"), axis=-1)
            rows.append(("wheel_momentum_peak", size.max(), "N m s"))
        if "propellant_kg" in summary:
            rows.append(("propellant", 1e3 * sum(summary["propellant_kg"].values()), "g"))
        captured = [event["time_s"] for event in summary.get("events", ()) if event["kind"] == "captured"]
        if captured:
            rows.append(("capture_time", max(captured), "s"))
        tables.append(
            {key: (float(v) if is_completed and np.isfinite(v) else None, unit) for key, v, unit in rows}
        )
    registered = metrics()
    keys = [key for key in registered if any(key in one for one in tables)]
    units = {key: next(one[key][1] for one in tables if key in one) for key in keys}
    columns = [
        {"key": key, "label": registered[key].label, "unit": units[key], "text": registered[key].description}
        for key in keys
    ]
    differing = differences([to_document(result.scenario) for result in results])[:MOST_DIFFERENCES]
    designs = [
        {
            "name": name,
            "values": [one[key][0] if key in one else None for key in keys],
            "numbers": {path: texts[k] for path, texts in differing},
        }
        for k, (name, one) in enumerate(zip(names, tables, strict=True))
    ]
    return {"metrics": columns, "designs": designs}
