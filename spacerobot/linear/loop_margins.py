"""Stability margins of every loop, broken at one point while the others stay closed.

The loop transfer function L, for negative feedback, crosses the unit circle and the negative real axis. At
these frequencies, the margins state how much its gain may grow or fall, and its phase lag or delay grow,
until the closed loop becomes unstable. The disk margin (P. Seiler, A. Packard, P. Gahinet: An introduction to
disk margins, IEEE Control Systems 40(5), 2020) allows gain and phase to change at once:
``alpha = 1 / max |S - 1/2|``, S = 1 / (1 + L). A frequency response locates crossings and peaks, which are
then refined on the transfer function itself.

The delay margin of a sampled loop is its phase margin divided by frequency: exact for whole periods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.datasets import read_dataset, write_dataset
from spacerobot.common.errors import ResultError, SpaceRobotError
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Content, Table
from spacerobot.common.tabular import Tabular
from spacerobot.linear.instants import InstantNames, as_instants, events_of, instants, samples
from spacerobot.linear.linearisation import RIGID, Lineariser, LinearSystem
from spacerobot.linear.loop_response import loop_responses, response_slopes, responses
from spacerobot.scene import Scene, to_scene
from spacerobot.simulation import Backend, Progress

if TYPE_CHECKING:
    import xarray as xr

FILE = "margins.nc"
"""File with the margins, in the folder that ``spacerobot margins --out`` writes."""

MAX_GAIN = 1e6
"""Largest factor by which a gain margin may change the gain; larger ones are attributed to rounding."""

MAX_CONDITION = 1e10
"""Condition number of ``s - A`` at an end of the frequency range, from which on a pole is assumed there."""

UNITS = {"gain_up": "dB", "gain_down": "dB", "phase": "deg", "delay": "s", "disk": "1", "crossover": "Hz"}
"""Units of a loop's margins, by name."""

HEADINGS = ("loop", "gain [dB]", "phase [deg]", "delay [s]", "disk", "crossover [Hz]")
"""Headings of the table of loops."""

MOST_LOOPS = 12
"""Number of loops in a table, those with the smallest disk margins."""

MOST_INSTANTS = 8
"""Number of instants up to which every instant has tables and diagrams; more are summarised over time."""

NO_DELAY = (
    "0*: the gain of the loop stays above one at all high frequencies, so any additional delay makes it "
    "unstable, however short. The phase margin is that at the crossovers. A sampled or band-limited "
    "controller gives the loop a delay margin."
)
"""Note below a table with loops without a delay margin."""

DRIFT = 3.0
"""Factor by which growing modes must be faster than those with all loops open to count as an instability, and
by which they must not be slower than the slowest crossover."""

MAX_INSTANTS = 100_000
"""Largest number of instants along a simulation."""


@dataclass(frozen=True)
class LoopMargins:
    """Margins of a loop broken at one point; infinite without a crossing, NaN if it is time-varying.

    Attributes:
        name: Break point: ``torque/one/joint_1``.
        gain_up, gain_down: Gain margins: allowed increase and decrease (negative) [dB].
        phase: Phase margin [deg].
        delay: Delay margin: allowed additional delay [s].
        disk: Disk margin alpha: L may change by any factor ``(1 + alpha/2 d) / (1 - alpha/2 d)``, |d| < 1.
        crossover: Highest gain crossover frequency [Hz].
        frequencies: Frequency of each margin [rad/s], by its name, NaN if the margin is infinite; and the
            lowest crossover frequency.
    """

    name: str
    gain_up: float
    gain_down: float
    phase: float
    delay: float
    disk: float
    crossover: float
    frequencies: Mapping[str, float] = field(default_factory=dict, repr=False)

    def row(self) -> list[str]:
        """Cells of a row under the headings :data:`HEADINGS`."""
        if math.isnan(self.disk):
            return [self.name, "varies in time", "", "", "", ""]
        gain = f"{self.gain_down:+.1f} to {self.gain_up:+.1f}"
        delay = f"{self.delay:.3g}" if self.delay > 0 else "0*"
        numbers = (f"{self.phase:.1f}", delay, f"{self.disk:.3f}", f"{self.crossover:.3g}")
        return [self.name, gain, *(text.replace("nan", "none") for text in numbers)]


@dataclass(frozen=True)
class MarginAnalysis(Tabular):
    """Margins of all loops at instants of a simulation.

    Attributes:
        scenario: Name of the scenario.
        linearisations: Linearised closed loops at the instants.
        loops: Margins of each break point, at each instant.
        events: Times [s] and kinds of the captures and releases of the simulation.
    """

    scenario: str
    linearisations: tuple[LinearSystem, ...]
    loops: tuple[tuple[LoopMargins, ...], ...]
    events: tuple[tuple[float, str], ...] = ()

    @property
    def stable(self) -> list[bool]:
        """Whether the loops are stable at each instant; slow drifts of the motion do not count."""
        rows = zip(self.linearisations, self.loops, strict=True)
        return [not is_destabilised(linear, loops) for linear, loops in rows]

    @property
    def descriptions(self) -> list[str]:
        """Size of the closed loop and stability of its loops at each instant, in words."""
        return [
            f"{linear.size}, {stability_words(stable, linear.growth_rate)}"
            for linear, stable in zip(self.linearisations, self.stable, strict=True)
        ]

    def to_xarray(self) -> xr.Dataset:
        """Margins by instant and loop, with units.

        By instant: whether the loops are ``stable``, see :func:`is_destabilised`; ``growth_rate``, the real
        part of the fastest growing mode's pole, or zero; and ``zero_poles``, the number of poles at zero.
        """
        import xarray as xr

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
                "stable": ("instant", self.stable),
                "growth_rate": ("instant", [one.growth_rate for one in linear], {"units": "1/s"}),
                "zero_poles": ("instant", [one.zero_poles for one in linear]),
            },
            coords={
                "instant": [one.label for one in linear],
                "time": ("instant", [one.time_s for one in linear], {"units": "s"}),
                "description": ("instant", self.descriptions),
                "loop": [one.name for one in rows[0]] if rows else [],
            },
            attrs={"scenario": self.scenario},
        )

    def save(self, folder: StrPath) -> SavedMargins:
        """Write ``margins.nc``, which :func:`spacerobot.load` reads.

        Raises:
            ResultError: If it cannot be written.
        """
        data = self.to_xarray()
        write_dataset(data, Path(folder) / FILE)
        return SavedMargins(data, Path(folder))

    def __repr__(self) -> str:
        """Numbers of instants and loops, in one line."""
        return (
            f"<MarginAnalysis: {len(self.loops)} instants, {len(self.loops[0]) if self.loops else 0} loops>"
        )

    def content(self) -> list[Content]:
        """Loops with the smallest disk margins and the least damped modes, at each instant.

        Of more than :data:`MOST_INSTANTS` instants, only the smallest disk margins over time.
        """
        count = len(self.loops[0]) if self.loops else 0
        smallest = f"These are the {MOST_LOOPS} of {count} loops with the smallest disk margins"
        note = f"{smallest}; the saved file (--out) has all."
        omission = [note] if count > MOST_LOOPS else []
        if len(self.loops) > MOST_INSTANTS:
            return [*self.least_margins(), *omission]
        tables: list[Content] = []
        rows = zip(self.linearisations, self.descriptions, self.loops, strict=True)
        for linear, description, loops in rows:
            tables += [*_instant_tables(linear.label, description, loops), linear.mode_table()]
        return [*tables, *omission]

    def least_margins(self) -> list[Content]:
        """Table of the loops with the smallest disk margins, each at the instant of its minimum."""
        disks = np.array([[one.disk for one in loops] for loops in self.loops])
        disks = np.where(np.isnan(disks), math.inf, disks)
        rows = []
        for k in disks.min(axis=0).argsort()[:MOST_LOOPS]:
            worst = int(disks[:, k].argmin())
            rows.append([self.linearisations[worst].label, *self.loops[worst][k].row()])
        title = f"least disk margins of {len(self.loops)} instants"
        return _with_note(Table(title, ("at", *HEADINGS), rows, keys=2))


@dataclass(frozen=True)
class SavedMargins(Tabular):
    """Margins read from a folder.

    Attributes:
        data: Margins by instant and loop, as of :meth:`MarginAnalysis.to_xarray`.
        folder: Folder with ``margins.nc``, and the diagrams in ``figures``.
    """

    data: xr.Dataset
    folder: Path

    @classmethod
    def load(cls, folder: StrPath) -> SavedMargins:
        """Read what :meth:`MarginAnalysis.save` wrote.

        Raises:
            ResultError: If the file cannot be read.
        """
        path = Path(folder) / FILE
        data = read_dataset(path)
        missing = {*UNITS, "stable", "growth_rate", "time", "description"} - {*data.variables}
        if missing:
            raise ResultError(f"holds no {min(missing)}; run `spacerobot margins --out` again", source=path)
        return cls(data, Path(folder))

    def __repr__(self) -> str:
        """Numbers of instants and loops, in one line."""
        return f"<SavedMargins: {self.data.sizes['instant']} instants, {self.data.sizes['loop']} loops>"

    def content(self) -> list[Content]:
        """Loops with the smallest disk margins at each instant."""
        tables: list[Content] = []
        for k, label in enumerate(self.data.instant.values):
            instant = self.data.isel(instant=k)
            loops = []
            for j, name in enumerate(self.data.loop.values):
                up, down, phase, delay, disk, crossover = (float(instant[key].values[j]) for key in UNITS)
                loops.append(LoopMargins(str(name), up, down, phase, delay, disk, crossover))
            tables += _instant_tables(str(label), str(instant.description.values), loops)
        return tables


def is_destabilised(system: LinearSystem, loops: Sequence[LoopMargins]) -> bool:
    """Whether a mode grows because of the loops.

    At the onset of instability, L = -1 at the pole: its frequency is a crossover of every loop involved. A
    mode that grows far more slowly, or also with all loops open, is a drift of the motion.

    Args:
        system: Closed loop at an instant.
        loops: Margins of its loops.
    """
    if not system.growing:
        return False
    count = len(system.inputs)
    opening = np.linalg.pinv(np.eye(count) + system.D[:count]) @ system.C[:count]  # w = -y, y = C x + D w
    opened = replace(system, A=system.A - system.B @ opening)
    drift = max((abs(mode.pole) for mode in opened.growing), default=RIGID)
    crossings = [one.frequencies["crossover"] for one in loops if "crossover" in one.frequencies]
    slow = np.nanmin([*crossings, np.inf])
    limit = max(DRIFT * drift, slow / DRIFT if math.isfinite(slow) else 0.0)
    return max(abs(mode.pole) for mode in system.growing) > limit


def stability_words(stable: bool, growth_rate: float) -> str:
    """Stability of the loops in words, with the fastest growing mode's rate [1/s] if there is one."""
    if not stable:
        return f"unstable: a mode grows at {growth_rate:.3g} 1/s"
    if growth_rate == 0:
        return "stable"
    return f"stable; the motion drifts at {growth_rate:.2g} 1/s, no instability of the control"


def _instant_tables(label: str, description: str, loops: Iterable[LoopMargins]) -> list[Content]:
    """Table of the loops with the smallest disk margins at an instant."""
    ranked = sorted(loops, key=lambda one: math.inf if math.isnan(one.disk) else one.disk)
    return _with_note(Table(f"{label}: {description}", HEADINGS, [one.row() for one in ranked[:MOST_LOOPS]]))


def _with_note(table: Table) -> list[Content]:
    """Table of loops, followed by an explanation if any delay margin is zero."""
    return [table, NO_DELAY] if any("0*" in row for row in table.rows) else [table]


def margins(
    scene: Scene | StrPath,
    at: InstantNames = 0.0,
    *,
    along: int = 0,
    backend: Backend = "auto",
    progress: Progress | None = None,
) -> MarginAnalysis:
    """Margins of every loop of a scene, broken at torques, measurements and wheels.

    Args:
        scene: The scene, or the name or file of its scenario.
        at: Times [s], and kinds or names of events, as in :func:`spacerobot.linearise`.
        along: If positive, ``at`` is replaced by this number of equidistant times from the start to the end,
            at least two.
        backend, progress: See :func:`spacerobot.simulate`.

    Raises:
        DivergedError: If the simulation does not reach an instant.
        ScenarioError: See :func:`spacerobot.linearise`.
        SpaceRobotError: If ``along`` is one, or larger than :data:`MAX_INSTANTS`.
    """
    if along != 0 and not 2 <= along <= MAX_INSTANTS:
        raise SpaceRobotError(f"found {along:g}, allowed: 0, or from 2 to {MAX_INSTANTS}", where="along")
    tell = progress or (lambda _: None)
    tell("building the closed loop")
    at = as_instants(at)
    scene = to_scene(scene)
    lineariser = Lineariser.of(scene, at=() if along else at)
    rollout = lineariser.rollout(backend, tell)
    tell("simulating and linearising")
    loop = lineariser.loop
    points = samples(rollout, loop, along) if along else instants(rollout, loop, at)
    linear, loops = [], []
    for instant in points:
        tell(f"linearising at {instant.label}")
        linear.append(lineariser.at(instant))
        rows, count = list[LoopMargins](), len(linear[-1].inputs)
        tell(f"margins at {instant.label}: {count} loops")
        for one in loop_margins(linear[-1]):
            rows.append(one)
            tell(f"margins at {instant.label}: {len(rows)} of {count} loops")
        loops.append(tuple(rows))
    events = events_of(rollout, loop, ("captured", "released"))
    return MarginAnalysis(scene.scenario.name, tuple(linear), tuple(loops), events)


def loop_margins(system: LinearSystem, names: Iterable[str] | None = None) -> Iterator[LoopMargins]:
    """Yield the margins of loops of a linearised closed loop.

    Args:
        system: The linearised closed loop.
        names: Break points; all of them if None.

    Raises:
        SpaceRobotError: If there is no such break point.
    """
    names = list(system.inputs if names is None else names)
    able = [name for name in names if system.is_invariant(name)]
    answers = zip(able, loop_responses(system, able), strict=True)
    for name in names:
        if name in able:
            yield _margins(system, name, *next(answers)[1])
        else:
            yield LoopMargins(name, *(np.nan,) * 6)


def _margins(system: LinearSystem, name: str, omega: Array, response: Array) -> LoopMargins:
    """Margins of a loop; each is refined from the frequency response to its exact frequency."""
    from scipy.optimize import brentq

    if not np.abs(response).max() > 0:
        return LoopMargins(name, np.inf, -np.inf, np.inf, np.inf, 2.0, np.nan)
    closed, place = system.closed(name), system.inputs.index(name)

    def at(frequency: float) -> complex:
        return complex(responses(closed, [place], system.points(np.array([frequency])))[0, 0])

    def roughness(frequency: float) -> float:
        """Slope of |S - 1/2|^2, with dS = -S^2 dL; its factor ds / d omega included."""
        (s,) = system.points(np.array([frequency]))
        value, slope = response_slopes(closed, place, s)
        turn = 1j * (s if system.period_s else 1.0)
        return float(-2 * (np.conj(1 / (1 + value) - 0.5) * slope * turn / (1 + value) ** 2).real)

    size = np.abs(response)
    crossings = list(_roots(lambda w: abs(at(w)) - 1, omega, size - 1))
    phases = {w: float(np.angle(-at(w), deg=True)) for w in crossings}
    delays = {w: np.radians(phase if phase > 0 else phase + 360) / w for w, phase in phases.items()}
    if not system.period_s and abs(closed[3][place, place]) >= abs(1 + closed[3][place, place]):
        delays[np.inf] = 0.0  # gain above one at all high frequencies
    # where L is real and negative: within the range by its sign change, at the ends always
    likely = (response.real < 0) & (size > 1 / MAX_GAIN) & (size < MAX_GAIN)
    real = [*_roots(lambda w: at(w).imag, omega, np.where(likely, response.imag, np.nan))]
    ends = []
    for end in (0.0, np.pi / system.period_s) if system.period_s else (0.0,):
        shifted = system.points(np.array([end]))[0] * np.eye(len(closed[0])) - closed[0]
        if np.linalg.cond(shifted) < MAX_CONDITION:
            ends.append(end)
    gains = {w: -1 / at(w).real for w in [*real, *ends] if at(w).real < 0}
    # the greatest |S - 1/2|: a peak, or at an end, the infinite one included, where S = 1 + D
    k = int(np.nanargmax(np.abs(1 / (1 + response) - 0.5)))
    near, worst = omega[[max(k - 1, 0), min(k + 1, len(omega) - 1)]], omega[k]
    if roughness(near[0]) > 0 > roughness(near[1]):
        worst = brentq(roughness, *near, xtol=1e-12 * worst)
    disks = {w: 1 / abs(1 / (1 + at(w)) - 0.5) for w in (worst, *ends)}
    if not system.period_s:
        disks[np.inf] = 1 / abs(closed[3][place, place] + 0.5)
    worst, disk = min(disks.items(), key=_second)
    up, gain_up = min(((w, g) for w, g in gains.items() if 1 < g < MAX_GAIN), key=_second, default=NO_GROWTH)
    down, gain_down = max(
        ((w, g) for w, g in gains.items() if 1 / MAX_GAIN < g < 1), key=_second, default=NO_FALL
    )
    turned, phase = min(((w, abs(angle)) for w, angle in phases.items()), key=_second, default=NO_GROWTH)
    late, delay = min(delays.items(), key=_second, default=NO_GROWTH)
    crossover = max(crossings, default=np.nan)
    return LoopMargins(
        name,
        _decibels(gain_up),
        _decibels(gain_down),
        float(phase),
        float(delay),
        float(disk),
        float(crossover / (2 * np.pi)),
        {"gain_up": up, "gain_down": down, "phase": turned, "delay": late, "disk": float(worst)}
        | {"crossover": min(crossings, default=np.nan)},
    )


NO_GROWTH, NO_FALL = (np.nan, np.inf), (np.nan, 0.0)


def _second(pair: tuple[float, float]) -> float:
    return pair[1]


def _roots(function: Callable[[float], float], omega: Array, values: Array) -> Iterator[float]:
    """Yield roots of a function between frequencies at which its values change sign."""
    from scipy.optimize import brentq

    for i in np.flatnonzero(values[:-1] * values[1:] < 0):
        yield brentq(function, omega[i], omega[i + 1], xtol=1e-14 * omega[i], rtol=1e-13)


def _decibels(gain: float) -> float:
    with np.errstate(divide="ignore"):
        return float(20 * np.log10(gain))
