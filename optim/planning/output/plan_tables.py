"""Tables of a plan, from the data of ``plan.json``, for terminal, pages and notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spacerobot.common.tables import Table, unit_scale

Summary = Mapping[str, Any]


def plan_tables(summary: Summary) -> list[Table]:
    """Tables of a plan: overview, cost sensitivities if there are any, runs of the solver."""
    slopes = sensitivity_table(summary)
    return [overview(summary), *([] if slopes is None else [slopes]), solver_table(summary)]


def overview(summary: Summary) -> Table:
    """Duration, mesh, choices, cost and verification of a plan."""
    verification, tolerance = summary["verification"], summary["verification"]["tolerance_m"]
    replay, followed = (
        max(verification[f"{how}_error_m"].values(), default=0.0) for how in ("replay", "followed")
    )
    allowed, open_loop = f" (allowed {tolerance:g} m)", verification.get("open_loop", True)
    violation = "none"
    if verification["violations"]:
        worst = verification["violations"][0]
        violation = f"{worst['amount']:.1e} {worst['unit']}, {worst['name']} (allowed {worst['allowed']:.1e})"
    avoidance = {"pairs": 0, "kept_apart": ()} | dict(summary["collision_avoidance"])
    apart = ", ".join(" and ".join(names) for names in avoidance["kept_apart"])
    pairs = f"{avoidance['pairs']} pairs of links apart" + (f"; with a constraint: {apart}" if apart else "")
    rows = [
        ("duration", f"{summary['duration_s']:.6g} s"),
        *((f"  {one['name']}", f"{one['duration_s']:.6g} s") for one in summary["phases"]),
        ("mesh", mesh_text(summary)),
        *(
            (
                "candidate " + ", ".join(f"{name} {value}" for name, value in one["chosen"].items()),
                one["failure"] if one["cost"] is None else f"cost {one['cost']:.6g}",
            )
            for one in summary["choices"]
        ),
        *(
            (f"base of {name}", f"within the limits of {actuators}")
            for name, actuators in summary.get("base_limits", {}).items()
        ),
        *((("collision avoidance", pairs),) if avoidance["pairs"] else ()),
        ("cost", f"{summary['cost']:.6g}"),
        *((f"  {name.replace('_', ' ')}", f"{value:.6g}") for name, value in summary["terms"].items()),
        ("first-order residual", f"{verification['residual']:.1e}"),
        ("second-order conditions", verification["second_order"]),
        ("replay error, open loop", f"{replay:.1e} m" + (allowed if open_loop else "")),
        ("  with feedback", f"{followed:.1e} m" + ("" if open_loop else allowed)),
        ("maximum violation", violation),
    ]
    return Table.of_pairs(f"plan of {summary['scenario']}", rows)


def mesh_text(summary: Summary) -> str:
    """Description of the mesh size."""
    return f"{summary['intervals']} intervals of order {summary['order']}, {summary['unknowns']} unknowns"


def cost_table(summary: Summary) -> Table:
    """Table of the cost terms and their shares."""
    cost = summary["cost"]
    rows = [
        [name.replace("_", " "), f"{value:.4g}", f"{100 * value / cost:.3g} %" if cost else ""]
        for name, value in summary["terms"].items()
    ]
    return Table(None, ("term", "cost", "share"), rows)


def sensitivity_table(summary: Summary) -> Table | None:
    """Table of the optimal cost's sensitivities; None if they were not computed."""
    slopes = summary.get("cost_sensitivities")
    if not slopes:
        return None
    rows = [[path, f"{slope:+.6g}"] for path, slope in slopes.items()]
    return Table("sensitivities of the optimal cost", ("parameter", "per unit"), rows)


def replay_table(summary: Summary) -> Table | None:
    """Table of replay errors by tip; None without tips."""
    verification = summary["verification"]
    rows = [
        [tip, f"{1e3 * error:.2g}", f"{1e3 * verification['followed_error_m'][tip]:.2g}"]
        for tip, error in verification["replay_error_m"].items()
    ]
    heads = ("tip", "error of the replay, open loop [mm]", "with feedback [mm]")
    return Table(None, heads, rows) if rows else None


def violation_table(summary: Summary) -> Table | None:
    """Table of limit violations between mesh points; None if there are none."""
    rows = []
    for one in summary["verification"]["violations"]:
        factor, unit = unit_scale(one["unit"])
        rows.append([one["name"], *(f"{factor * one[key]:.2g} {unit}" for key in ("amount", "allowed"))])
    heads = ("limit", "largest violation", "allowed")
    return Table("limits between the points of the mesh", heads, rows) if rows else None


def solver_table(summary: Summary) -> Table:
    """Table of the solver's runs."""
    rows = [
        [
            f"{run['start'] + 1}",
            f"{run['intervals']}",
            f"{run['cost']:.6g}",
            f"{run['iterations']}",
            f"{run['seconds']:.3g}",
            run["status"].replace("_", " ").lower(),
        ]
        for run in summary["solver_runs"]
    ]
    heads = ("start", "intervals", "cost", "iterations", "time [s]", "status")
    return Table("runs of IPOPT", heads, rows)
