"""Contacts at the instants that the cube gives, against contacts that a predictive controller chooses.

python examples/touch/compare.py 64

The draws and the table are those of docs/validation/touch.md.
"""

import os
import sys
import time
from pathlib import Path

import numpy as np
from scipy.stats import binomtest, qmc

import spacerobot as sr

sr.load_plugin(Path(__file__).with_name("contact_mpc.py"))

LOWER = [30, -45, 0.0, 0.93, -0.02]  # spin [deg/s], attitude [deg], friction, position x and y [m]
UPPER = [150, 45, 0.8, 0.97, 0.02]
HALF_CUBE, SPHERE, CLEARANCE = 0.2, 0.03, 0.005  # [m]
SPHERES = np.array(  # centres of the palms' and fingers' spheres, of both hands [m]
    [(0.95 + x, y) for x, y in ((0.1, 0.285), (-0.1, 0.285), (0.3, 0.085), (-0.3, 0.085))]
)
SPHERES = np.vstack([SPHERES, SPHERES * [1, -1]])
CLOSING = 30.0
"""Time for caging, from the instant at which the hands may begin to close [s]."""
CAGE = {"phases": {"cage": {"until": {"captured": ["left", "right"]}}}}


def closing(section):
    """Changes with one phase, and references of both hands that close."""
    changes = CAGE | {"simulation.duration": CLOSING}
    for tip, sign in (("left_tip", -1), ("right_tip", 1)):
        changes[f"robots.chaser.tips.{tip}.reference"] = section(sign)
    return changes


def line(duration):
    """Changes with hands that close at once within a time [s]."""
    return closing(lambda sign: {"kind": "line", "displacement": [0, 0.06 * sign, 0], "duration": duration})


HANDS = {
    "wait for 40 s, close in 8 s": {"simulation.duration": 40 + CLOSING},
    "close at once in 8 s": line(8),
    "close at once in 2 s": line(2),
    "contacts chosen by prediction": closing(lambda sign: {"kind": "approach", "direction": [0, sign, 0]})
    | {"robots.chaser.controllers.contacts": {"kind": "contact_mpc"}},
}


def gap(draws):
    """Distance of the cube from the nearest sphere at the start, negative if they overlap (n,) [m]."""
    angle, place = np.deg2rad(draws[:, 1]), draws[:, 3:]
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = np.moveaxis(SPHERES - place[:, None], -1, 0)
    beyond = np.abs([cosine * x + sine * y, cosine * y - sine * x]) - HALF_CUBE
    outside = np.hypot(*np.maximum(beyond, 0)) + np.minimum(beyond.max(axis=0), 0)
    return outside.min(axis=1) - SPHERE


def draws_without_overlap(samples):
    """First Sobol' points that keep the clearance from the hands (samples, 5), and the number rejected."""
    points = qmc.Sobol(5, seed=1).random(8 * samples)
    draws = np.array(LOWER) + (np.array(UPPER) - LOWER) * points
    chosen = np.flatnonzero(gap(draws) >= CLEARANCE)[:samples]
    return draws[chosen], int(chosen[-1]) + 1 - samples


def numbers(draws):
    """Numbers of the scenario by their paths, of draws (n, 5)."""
    spin, attitude, friction, x, y = draws.T
    return {
        "target.base.spin_deg.2": spin,
        "target.base.rotation_deg.2": attitude,
        "contacts.left.friction": friction,
        "contacts.right.friction": friction,
        "target.base.position.0": x,
        "target.base.position.1": y,
    }


def main(samples: int = 64) -> None:
    """Table of P(caged) with its Wilson interval, peak force and time until the cage is closed."""
    draws, rejected = draws_without_overlap(samples)
    values = numbers(draws)
    print(
        f"{samples} draws; {rejected} others, within {1e3 * CLEARANCE:g} mm of a hand at first, are rejected"
    )
    peaks, times, seconds = {}, {}, {}
    for name, changes in HANDS.items():
        begun = time.process_time()
        data = sr.batch(sr.load_scene("touch", changes), ["contact_force_peak", "capture_time"], values).data
        seconds[name] = time.process_time() - begun
        peaks[name] = np.array(data.contact_force_peak).reshape(samples, -1).max(axis=1)
        times[name] = np.array(data.capture_time).reshape(samples, -1).max(axis=1)
    common = np.all([np.isfinite(value) for value in times.values()], axis=0)
    print(f"Medians over the {common.sum()} draws that all hands cage.\n")
    print(
        f"| hands | caged, of {samples} | P(caged), %, with 95 % interval | diverged "
        "| peak contact force, median, N | largest of all draws, N | caged after, median, s | longest, s "
        "| processor time, s |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, peak in peaks.items():
        caged = binomtest(int(np.isfinite(times[name]).sum()), samples)
        low, high = caged.proportion_ci(0.95, "wilson")
        cells = [
            name,
            caged.k,
            f"{100 * caged.statistic:.0f} ({100 * low:.0f}..{100 * high:.0f})",
            np.isnan(peak).sum(),
            f"{np.median(peak[common]):.1f}",
            f"{np.nanmax(peak):.1f}",
            f"{np.median(times[name][common]):.1f}",
            f"{np.nanmax(times[name]):.1f}",
            f"{seconds[name]:.0f}",
        ]
        print("| " + " | ".join(map(str, cells)) + " |")
    print(f"\nload over 15 min at the end: {os.getloadavg()[2]:.1f}")
    np.set_printoptions(precision=1, suppress=True, linewidth=200)
    print("draws:", *draws.round(3).tolist(), sep="\n")
    for name in peaks:
        print(name, peaks[name], times[name], sep="\n")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
