"""Contacts at the instants that the cube gives, against contacts that a predictive controller chooses.

python examples/touch/compare.py 32
"""

import sys
from pathlib import Path

import numpy as np
from scipy.stats import binomtest, qmc

import spacerobot as sr

sr.load_plugin(Path(__file__).with_name("contact_mpc.py"))

LOWER = [60, -45, 0.0, 0.90, -0.05]  # spin [deg/s], attitude [deg], friction, position x and y [m]
UPPER = [240, 45, 0.8, 1.0, 0.05]
CAGE = {"phases": {"cage": {"until": {"captured": ["left", "right"]}}}}


def closing(duration, section):
    """Changes with one phase, and references of both hands that close."""
    changes = CAGE | {"simulation.duration": duration}
    for tip, sign in (("left_tip", -1), ("right_tip", 1)):
        changes[f"robots.chaser.tips.{tip}.reference"] = section(sign)
    return changes


HANDS = {
    "wait for 40 s, close in 8 s": {},
    "close at once in 8 s": closing(
        50.0, lambda sign: {"kind": "line", "displacement": [0, 0.06 * sign, 0], "duration": 8}
    ),
    "close at once in 2 s": closing(
        50.0, lambda sign: {"kind": "line", "displacement": [0, 0.06 * sign, 0], "duration": 2}
    ),
    "contacts chosen by prediction": closing(
        20.0, lambda sign: {"kind": "approach", "direction": [0, sign, 0]}
    )
    | {"robots.chaser.controllers.contacts": {"kind": "contact_mpc"}},
}


def main(samples: int = 32) -> None:
    """P(caged) with its interval, peak force and time until the cage is closed, on the same draws."""
    draws = np.array(LOWER) + (np.array(UPPER) - LOWER) * qmc.Sobol(5, seed=1).random(samples)
    spin, attitude, friction, x, y = draws.T
    values = {
        "target.base.spin_deg.2": spin,
        "target.base.rotation_deg.2": attitude,
        "contacts.left.friction": friction,
        "contacts.right.friction": friction,
        "target.base.position.0": x,
        "target.base.position.1": y,
    }
    for name, changes in HANDS.items():
        data = sr.batch(sr.load_scene("touch", changes), ["contact_force_peak", "capture_time"], values).data
        peak = np.array(data.contact_force_peak).reshape(samples, -1).max(axis=1)
        time = np.array(data.capture_time).reshape(samples, -1).max(axis=1)
        caged = binomtest(int(np.isfinite(time).sum()), samples)
        low, high = caged.proportion_ci(0.95)
        lost = int(np.isnan(peak).sum())
        print(f"{name}: caged {caged.statistic:.0%} ({low:.1%} to {high:.1%}), {lost} diverged")
        print(f"  peak force: median {np.nanmedian(peak):.1f} N, largest {np.nanmax(peak):.1f} N")
        print(f"  caged after: median {np.nanmedian(time):.1f} s, longest {np.nanmax(time):.1f} s")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
