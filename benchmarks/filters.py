"""NEES and NIS of the filters of `examples/filters.yaml` over 10 000 noise draws, in one campaign."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

import spacerobot as sr
from benchmarks.table_row import Row

SCENARIO = Path(__file__).parents[1] / "examples" / "filters.yaml"
NEES_FREEDOMS = {"attitude_nees": 6, "target_nees": 14}
"""Number of errors that each filter estimates, the degrees of freedom of its NEES."""
STATISTICS = ("attitude_nees", "attitude_nis", "target_nees", "target_nis")
WIDE, DENSITY = 0.3, 1.0e-3
"""Initial error of inertia ratios at which the target filter is overconfident, and spin acceleration density
that corrects this [rad/s^1.5]."""


def rows() -> list[Row]:
    """Rows of each mean against the 95 % bounds of its chi-squared distribution."""
    section = "robots.chaser.estimators.object"
    wide = {f"{section}.inertia": WIDE}
    table = _rows({}, STATISTICS, "initial error of the inertia ratios 3 %", bound=True)
    table += _rows(wide, ("target_nees",), f"{100 * WIDE:g} %", bound=False)
    note = f"{100 * WIDE:g} %, spin_acceleration {DENSITY:g} rad/s^1.5"
    return table + _rows(
        wide | {f"{section}.spin_acceleration": DENSITY}, ("target_nees",), note, bound=False
    )


def _rows(changes: dict[str, Any], names: tuple[str, ...], note: str, *, bound: bool) -> list[Row]:
    """Rows of several metrics of one campaign."""
    with tempfile.TemporaryDirectory() as folder:
        data = sr.campaign(sr.load_scene(SCENARIO, changes), Path(folder) / "campaign").data
        values = {name: np.ravel(data[name].values) for name in names}
        # degrees of freedom of each draw: dropouts leave fewer
        freedoms_of = {
            name: np.full(len(each), NEES_FREEDOMS[name])
            if name in NEES_FREEDOMS
            else np.ravel(data[f"{name}_dof"].values)
            for name, each in values.items()
        }
    table = []
    for name, each in values.items():
        count, freedoms = len(each), freedoms_of[name].mean()
        low, high = chi2.ppf([0.025, 0.975], freedoms_of[name].sum()) / count
        inside = (each <= chi2.ppf(0.95, freedoms_of[name])).mean()
        mean = each.mean()
        table.append(
            Row(
                f"mean {name} of {count} draws, {note}",
                f"chi-squared, {freedoms:g} degrees of freedom",
                f"{mean:.3f}",
                f"{low:.3f} to {high:.3f}",
                mean / freedoms,
                "inside the 95 % bounds" if bound else "stated",
                bool(low < mean < high) if bound else None,
                f"{100 * inside:.1f} % of the draws below the 95 % quantile",
            )
        )
    return table
