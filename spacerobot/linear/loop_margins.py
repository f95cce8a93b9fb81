"""Stability margins of every loop, broken at one point while the others stay closed.

Of the loop transfer function L for negative feedback, at the frequencies at which it crosses the unit circle
and the negative real axis: by how much its gain may grow or fall, its phase lag or its delay grow, until the
closed loop becomes unstable. The disk margin (P. Seiler, A. Packard, P. Gahinet: An introduction to disk
margins, IEEE Control Systems 40(5), 2020) allows gain and phase to change at once:
``alpha = 1 / max |S - 1/2|``, S = 1 / (1 + L). Frequency responses follow from the state space; crossings,
margins and disks are those of python-control.

The delay margin of a sampled loop is phase over frequency: exact for whole periods.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr

from spacerobot.arrays import Array
from spacerobot.errors import SpaceRobotError
from spacerobot.linear.instants import events_of, instants, samples
from spacerobot.linear.linearisation import RIGID, Lineariser, LinearSystem, python_control
from spacerobot.notebook import html_table
from spacerobot.scene import Scene
from spacerobot.simulation import Backend, Progress

PER_DECADE = 150
"""Frequencies in a decade; more lie around poles with little damping."""

BEYOND = 30.0
"""How far the frequencies reach beyond the slowest and the fastest pole."""

MAX_GAIN = 1e6
"""Crossings that need a larger change of the gain than by this factor are rounding."""

MAX_CONDITION = 1e10
"""Greatest condition of a pole's distance from frequency zero, beyond which there is a pole."""

UNITS = {"gain_up": "dB", "gain_down": "dB", "phase": "deg", "delay": "s", "disk": "1", "crossover": "Hz"}
"""Margins of a loop, and their units."""


@dataclass(frozen=True)
class LoopMargins:
    """Margins of a loop broken at one point; infinite where nothing is crossed, NaN where it varies in time.

    Attributes
    ----------
    name
        Break point: ``torque/one/joint_1``.
    gain_up, gain_down
        By how much its gain may grow, and fall (negative) [dB].
    phase
        By how much its phase may change [deg].
    delay
        Delay that it may have in addition [s].
    disk
        Disk margin alpha: L may change by any factor ``(1 + alpha/2 d) / (1 - alpha/2 d)``, |d| < 1.
    crossover
        Highest frequency at which its gain is one [Hz].
    """

    name: str
    gain_up: float
    gain_down: float
    phase: float
    delay: float
    disk: float
    crossover: float


@dataclass(frozen=True)
class MarginAnalysis:
    """Margins of all loops at instants of a simulation.

    Attributes
    ----------
    linearisations
        Closed loops at the instants.
    loops
        Margins at each instant, of each break point.
    events
        Times [s] and kinds of the captures and releases of the simulation.
    """

    linearisations: tuple[LinearSystem, ...]
    loops: tuple[tuple[LoopMargins, ...], ...]
    events: tuple[tuple[float, str], ...] = ()

    def to_xarray(self) -> xr.Dataset:
        """Margins by instant and loop, with units; ``stable`` and the number of poles at zero by instant."""
        dims, rows = ("instant", "loop"), self.loops
        data = {
            name: xr.DataArray(
                [[getattr(one, name) for one in row] for row in rows], dims=dims, attrs={"units": unit}
            )
            for name, unit in UNITS.items()
        }
        linear = self.linearisations
        return xr.Dataset(
            data
            | {
                "stable": ("instant", [one.is_stable for one in linear]),
                "zero_poles": ("instant", [one.zero_poles for one in linear]),
            },
            coords={
                "instant": [one.label for one in linear],
                "time": ("instant", [one.time_s for one in linear], {"units": "s"}),
                "loop": [one.name for one in rows[0]] if rows else [],
            },
        )

    def __repr__(self) -> str:
        """Numbers of instants and loops, in one line."""
        return (
            f"<MarginAnalysis: {len(self.loops)} instants, {len(self.loops[0]) if self.loops else 0} loops>"
        )

    def _repr_html_(self) -> str:
        """Disk margins at the first instant, for notebooks."""
        rows = [(one.name, f"{one.disk:.3g}") for one in self.loops[0]] if self.loops else []
        return html_table("Disk margins", rows)


def margins(
    scene: Scene,
    at: Iterable[float | str] = (0.0,),
    *,
    along: int = 0,
    backend: Backend = "auto",
    progress: Progress | None = None,
) -> MarginAnalysis:
    """Margins of every loop of a scene, broken at torques, measurements and wheels.

    Parameters
    ----------
    scene
        The scene.
    at
        Times [s], and kinds or names of events, as of :func:`spacerobot.linearise`.
    along
        If positive, ``at`` is replaced by so many equidistant times from the start to the end, at least two.
    backend, progress
        As of :func:`spacerobot.simulate`.

    Raises
    ------
    DivergedError
        If the simulation does not reach an instant.
    ScenarioError
        As :func:`spacerobot.linearise`.
    SpaceRobotError
        If python-control is not installed, or ``along`` is one.
    """
    if along == 1 or along < 0:
        raise SpaceRobotError(f"along: found {along}, allowed: 0, or at least 2")
    python_control()
    tell = progress or (lambda _: None)
    tell("building the closed loop")
    lineariser = Lineariser.of(scene)
    rollout = lineariser.rollout(backend, tell)
    tell("simulating and linearising")
    loop = lineariser.loop
    found = samples(rollout, loop, along) if along else instants(rollout, loop, at)
    linear, loops = [], []
    for instant in found:
        tell(f"margins at {instant.label}")
        linear.append(lineariser.at(instant))
        loops.append(tuple(loop_margins(linear[-1])))
    return MarginAnalysis(tuple(linear), tuple(loops), events_of(rollout, loop, ("captured", "released")))


def loop_margins(found: LinearSystem) -> Iterator[LoopMargins]:
    """Margins of each loop of a linearised closed loop.

    Raises
    ------
    SpaceRobotError
        If python-control is not installed.
    """
    for name in found.inputs:
        if found.period_s and name not in found.starts:
            yield LoopMargins(name, *[np.nan] * 6)
            continue
        omega, response = loop_response(found, name)
        yield _margins(found, name, omega, response)


def loop_response(found: LinearSystem, name: str) -> tuple[Array, Array]:
    """Frequencies [rad/s] and loop transfer function (complex) there, of a loop broken at one point.

    Parameters
    ----------
    found
        The linearised closed loop.
    name
        The break point.

    Raises
    ------
    SpaceRobotError
        If there is no such point, or the broken loop varies in time.
    """
    A, b, c, d = found.broken(name)
    poles = [np.linalg.eigvals(A), np.linalg.eigvals(found.A)]
    both = np.concatenate(poles).astype(complex)
    if found.period_s:
        both = np.log(both[np.abs(both) > np.finfo(float).tiny]) / found.period_s
    omega = _frequencies(both, np.pi / found.period_s if found.period_s else np.inf)
    s = np.exp(1j * omega * found.period_s) if found.period_s else 1j * omega
    eye = np.eye(len(A))
    response = np.concatenate(  # in pieces, so that the memory does not grow with the number of frequencies
        [
            (c @ np.linalg.solve(part[:, None, None] * eye - A, b))[:, 0, 0] + d[0, 0]
            for part in np.array_split(s, -(-len(s) // 256))
        ]
    )
    return omega, response


def _frequencies(poles: Array, most: float) -> Array:
    """Frequencies [rad/s] from below the slowest to beyond the fastest pole, dense around resonances."""
    sizes = np.abs(poles)
    sizes = sizes[sizes > RIGID]
    low, high = (sizes.min(), sizes.max()) if sizes.size else (1.0, 1.0)
    # below, poles at zero that rounding has split would count as resonances
    low, high = max(min(low / BEYOND, most / 10), RIGID), min(high * BEYOND, most)
    found = [np.geomspace(low, high, int(PER_DECADE * np.log10(high / low)) + 2)]
    around = np.concatenate([-np.geomspace(8, 1e-2, 40), [0.0], np.geomspace(1e-2, 8, 40)])
    for pole in poles:
        if pole.imag > 0 and abs(pole.real) < 0.2 * abs(pole) and abs(pole) > RIGID:
            found.append(pole.imag + max(abs(pole.real), 1e-9 * abs(pole)) * around)
    omega = np.unique(np.concatenate(found))
    omega = omega[(omega >= low) & (omega <= high)]
    return np.asarray(omega[np.concatenate([[True], np.diff(omega) > 1e-12 * omega[1:]])])


def _margins(found: LinearSystem, name: str, omega: Array, response: Array) -> LoopMargins:
    """Margins from a frequency response."""
    ct = python_control()
    if not np.abs(response).max() > 0:
        return LoopMargins(name, np.inf, -np.inf, np.inf, np.inf, 2.0, np.nan)
    gains, phases, _, _, crossings, _ = ct.stability_margins(ct.frd(response, omega), returnall=True)
    d = found.broken(name)[3]
    gains = np.concatenate([gains, _real_ends(found, name)])
    up = gains[(gains > 1) & (gains < MAX_GAIN)]
    down = gains[(gains < 1) & (gains > 1 / MAX_GAIN)]
    late = np.radians(np.where(phases > 0, phases, phases + 360)) / crossings
    delay = late.min(initial=np.inf)
    if not found.period_s and abs(d[0, 0]) >= 1:
        delay = 0.0  # gain above one at all high frequencies
    sensitivity = 1 / (1 + response)
    worst = omega[np.argmax(np.abs(sensitivity - 0.5))]
    near = np.clip(worst * np.geomspace(0.97, 1 / 0.97, 61), omega[0], omega[-1])
    disk, _, _ = ct.disk_margins(found.loop_transfer(name), near)
    return LoopMargins(
        name,
        _decibels(up.min(initial=np.inf)),
        _decibels(down.max(initial=0.0)),
        float(np.abs(phases).min(initial=np.inf)),
        float(delay),
        float(disk),
        float(crossings.max(initial=-np.inf) / (2 * np.pi)) if crossings.size else float("nan"),
    )


def _real_ends(found: LinearSystem, name: str) -> Array:
    """Gain margins at frequency zero and the Nyquist frequency, where L is real, if it is negative."""
    A, b, c, d = found.broken(name)
    at = []
    for s in (1.0, -1.0) if found.period_s else (0.0,):
        shifted = s * np.eye(len(A)) - A
        if np.linalg.cond(shifted) < MAX_CONDITION:
            at.append(float((c @ np.linalg.solve(shifted, b) + d)[0, 0]))
    return np.array([-1 / value for value in at if value < 0])


def _decibels(gain: float) -> float:
    with np.errstate(divide="ignore"):
        return float(20 * np.log10(gain))
