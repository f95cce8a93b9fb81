"""Failed wheels and thrusters with and without reallocation: ``python -m benchmarks.reallocation``.

Prints the table of docs/validation/failures.md. Wheel 0 of the servicer's pyramid fails at 5 s of
`servicer-wheels`; a thruster of `detumble` fails at 1 s.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spacerobot as sr
from benchmarks.table_row import markdown_head

WHEELS = "robots.servicer.actuators.wheels"
JET = "robots.rpr1.actuators.jets.nozzles.{}.failure"
DETECTION = {"period": 0.1, "bandwidth": 2, "speed_noise": 0.05, "spin_noise": 1e-6, "allowance": 2e-3}
"""Detection at 10 Hz with tachometers and gyros whose standard deviations are 0.05 rad/s and 1 urad/s."""


def wheels(changes: dict[str, Any]) -> str:
    """Largest attitude error after 5 s, final one [deg], largest motor torque after 5 s [N m], delay [s]."""
    result = sr.simulate(sr.load_scene("servicer-wheels", changes))
    if not result.completed:
        return f"lost at {result.summary['status']['reached_s']:.1f} s"
    data = result.data
    error = np.degrees(np.linalg.norm(data.base_attitude_error.sel(body="servicer").values, axis=-1))
    torque = float(np.abs(data.wheel_torque.values[data.time.values > 5]).max())
    delays = [e.get("delay_s", np.nan) for e in result.summary["events"] if e["kind"] == "detected"]
    text = f"{error[data.time.values > 5].max():.3f} / {error[-1]:.4f} / {torque:.2f}"
    return " / ".join([text, *(f"{delay:.1f}" for delay in delays)])


def jets(changes: dict[str, Any]) -> str:
    """Final speed [mm/s] and spin [deg/s] of the target, and propellant of both robots [g]."""
    result = sr.simulate(sr.load_scene("detumble", changes))
    if not result.completed:
        return f"lost at {result.summary['status']['reached_s']:.1f} s"
    data = result.data
    target = [name for name in data.velocity.values if name.startswith("v.target/")][:3]
    v = data.v.sel(velocity=target).values[-1]
    propellant_g = 1e3 * float(np.nansum(data.propellant.values[-1]))
    return f"{1e3 * np.linalg.norm(v[:2]):.1f} / {np.degrees(abs(v[2])):.3f} / {propellant_g:.1f}"


def main() -> None:
    """Print both tables as Markdown."""
    print(*markdown_head(["wheel", "unknown", "known", "detected"]), sep="\n")
    print(f"| none | {wheels({})} | | {wheels({f'{WHEELS}.detection': DETECTION})} |", flush=True)
    for mode in ("seized", "off"):
        cells = []
        for is_known in (False, True):
            failure = {"wheel": 0, "at": 5, "mode": mode, "known": is_known}
            cells.append(wheels({f"{WHEELS}.failures": [failure]}))
        failing = {f"{WHEELS}.failures": [{"wheel": 0, "at": 5, "mode": mode}]}
        cells.append(wheels(failing | {f"{WHEELS}.detection": DETECTION}))
        print(f"| {mode} | " + " | ".join(cells) + " |", flush=True)
    print()
    print(*markdown_head(["thruster", "unknown", "known"]), sep="\n")
    print(f"| none | {jets({})} | |", flush=True)
    for nozzle, opening in (("front_left", 1.0), ("left_back", 1.0), ("front_left", 0.0), ("left_back", 0.0)):
        failures = [{"at": 1, "opening": opening, "known": is_known} for is_known in (False, True)]
        cells = [jets({JET.format(nozzle): failure}) for failure in failures]
        print(f"| {nozzle}, {'open' if opening else 'shut'} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
