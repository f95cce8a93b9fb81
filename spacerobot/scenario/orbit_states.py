"""Initial states of a rendezvous from two-line elements or CCSDS orbit ephemeris messages (OEM).

SGP4 propagates two-line elements to positions and velocities in TEME (true equator, mean equinox) at times in
UTC. An ephemeris message states its frame and time system. The files of both objects must have the same time
system and the same inertial frame. The origin of the scenario's world is the chaser at the epoch; its axes
are x radial, y along-track and z cross-track at the epoch, and do not rotate. The reference orbit is the
chaser's osculating Keplerian orbit at the epoch.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.common.files import StrPath
from spacerobot.common.optional import optional_module

MU = 3.986004418e14
"""Gravitational parameter of the Earth [m^3/s^2], the orbit environment's default."""
INERTIAL = ("TEME", "EME2000", "ICRF", "GCRF", "J2000", "TOD", "MOD")
"""Inertial frames of ephemeris messages."""
NEIGHBOURS = 8
"""Number of nearest states from which an ephemeris is interpolated."""


@dataclass(frozen=True, eq=False)
class OrbitEphemeris:
    """Orbit of one object as a function of time.

    Attributes:
        name: Name of the object.
        source: File of the orbit.
        frame, time_system: Frame of the states, and time scale.
        first, last: First and last time of an ephemeris; both are the epoch of two-line elements.
        state: Function of a time for position and velocity (6,) [m, m/s].
    """

    name: str
    source: Path
    frame: str
    time_system: str
    first: datetime.datetime
    last: datetime.datetime
    state: Any


@dataclass(frozen=True, eq=False)
class RendezvousStart:
    """Reference orbit and relative state at an epoch.

    Attributes:
        epoch: Time of the states, in the time scale ``time_system``.
        frame, time_system: Frame and time scale of the files.
        semi_major_axis, eccentricity, true_anomaly_deg: Elements of the chaser's osculating orbit [m, 1,
            deg].
        position, velocity: Position and velocity of the target relative to the chaser (3,) [m, m/s]; axes
            radial, along-track, cross-track at the epoch, not rotating.
    """

    epoch: datetime.datetime
    frame: str
    time_system: str
    semi_major_axis: float
    eccentricity: float
    true_anomaly_deg: float
    position: Array
    velocity: Array

    def changes(self) -> Mapping[str, Any]:
        """Sections of a scenario by dotted path, for :func:`spacerobot.load_scene`."""
        orbit = {
            "kind": "orbit",
            "semi_major_axis": self.semi_major_axis,
            "eccentricity": self.eccentricity,
            "true_anomaly_deg": self.true_anomaly_deg,
        }
        return {
            "environment": {"orbit": orbit},
            "target.base.position": self.position.tolist(),
            "target.base.velocity": self.velocity.tolist(),
        }

    def to_yaml(self) -> str:
        """Sections of a scenario file as text, with epoch and frame in a comment."""
        sections = self.changes()
        base = {key: sections[f"target.base.{key}"] for key in ("position", "velocity")}
        document = {"environment": sections["environment"], "target": {"base": base}}
        text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None)
        return f"# {self.epoch.isoformat()} {self.time_system}, from states in {self.frame}\n{text}"


def rendezvous_start(
    chaser: StrPath, target: StrPath, epoch: datetime.datetime | str | None = None
) -> RendezvousStart:
    """Compute the reference orbit of a chaser and the relative state of a target from their orbit files.

    Args:
        chaser, target: Files of two-line elements, or of an orbit ephemeris message in key-value notation.
        epoch: Time of the states, in the files' time scale. If None, the later of the first times of both
            files (the epoch, for two-line elements).

    Raises:
        ScenarioError: If a file cannot be read, frames or time scales differ, a frame is not inertial, the
            epoch is outside an ephemeris, or the chaser's orbit is not an ellipse.
        SpaceRobotError: If the package sgp4 is missing.
    """
    first, second = read_orbit(chaser), read_orbit(target)
    for what in ("frame", "time_system"):
        mine, other = getattr(first, what), getattr(second, what)
        if mine != other:
            raise ScenarioError(
                f"has the {what.replace('_', ' ')} {other!r}, that of the chaser is {mine!r}; convert one",
                source=second.source,
            )
    if isinstance(epoch, str):
        epoch = _time(epoch, first.source)
    at = epoch if epoch is not None else max(first.first, second.first)
    r, v = np.split(first.state(at), 2)
    relative = second.state(at) - np.concatenate([r, v])
    momentum = np.cross(r, v)
    radial, normal = r / np.linalg.norm(r), momentum / np.linalg.norm(momentum)
    axes = np.stack([radial, np.cross(normal, radial), normal])
    energy = v @ v / 2 - MU / np.linalg.norm(r)
    if energy >= 0:
        raise ScenarioError("its orbit is no ellipse", source=first.source)
    # eccentricity vector e = v x h / mu - r / |r|; the true anomaly is the angle from e to r
    eccentric = np.cross(v, momentum) / MU - radial
    size = float(np.linalg.norm(eccentric))
    anomaly = np.arctan2(-(axes[1] @ eccentric), axes[0] @ eccentric) if size > 1e-12 else 0.0
    return RendezvousStart(
        at,
        first.frame,
        first.time_system,
        float(-MU / (2 * energy)),
        size,
        float(np.degrees(anomaly)),
        axes @ relative[:3],
        axes @ relative[3:],
    )


def read_orbit(path: StrPath) -> OrbitEphemeris:
    """Read two-line elements or an orbit ephemeris message.

    Raises:
        ScenarioError: If the file cannot be read.
        SpaceRobotError: If the package sgp4 is missing.
    """
    source = Path(path)
    try:
        text = source.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"cannot be read: {getattr(error, 'strerror', error)}", source=source) from None
    lines = [line.rstrip() for line in text.splitlines() if line.strip()]
    if lines and lines[0].startswith("CCSDS_OEM_VERS"):
        return _read_oem(lines, source)
    return _read_tle(lines, source)


def _read_tle(lines: list[str], source: Path) -> OrbitEphemeris:
    """Orbit of two-line elements, with or without a preceding line with the object's name."""
    first = next((k for k, line in enumerate(lines) if line.startswith("1 ")), None)
    if first is None or first + 1 >= len(lines) or not lines[first + 1].startswith("2 "):
        raise ScenarioError(
            "holds neither two-line elements (lines that begin with '1 ' and '2 ') nor CCSDS_OEM_VERS",
            source=source,
        )
    for line in lines[first : first + 2]:
        # checksum: the sum of all other digits modulo 10, where a minus sign counts as 1
        total = sum(int(c) if c.isdigit() else c == "-" for c in line[:68]) % 10
        if len(line) != 69 or line[68] != str(total):
            raise ScenarioError(f"checksum of line {line[:1]} of the elements is wrong", source=source)
    api = optional_module("sgp4.api", "orbits", "the propagation of two-line elements")
    satellite = api.Satrec.twoline2rv(lines[first], lines[first + 1])
    year = 2000 + satellite.epochyr if satellite.epochyr < 57 else 1900 + satellite.epochyr
    start = datetime.datetime(year, 1, 1, tzinfo=datetime.UTC)  # day 1.0 is the first of January
    epoch = start + datetime.timedelta(days=satellite.epochdays - 1)

    def state(time: datetime.datetime) -> Array:
        """Position and velocity (6,) [m, m/s] at a time, by SGP4."""
        minutes = (time - epoch) / datetime.timedelta(minutes=1)
        code, position, velocity = satellite.sgp4_tsince(minutes)
        if code:
            raise ScenarioError(f"SGP4 fails at {time.isoformat()}: {api.SGP4_ERRORS[code]}", source=source)
        return 1e3 * np.array([*position, *velocity])

    name = lines[first - 1].strip() if first else str(satellite.satnum)
    return OrbitEphemeris(name, source, "TEME", "UTC", epoch, epoch, state)


def _read_oem(lines: list[str], source: Path) -> OrbitEphemeris:
    """Orbit of the first segment of an orbit ephemeris message (CCSDS 502.0-B), which is in km and km/s."""
    keys, rows, inside = dict[str, str](), list[tuple[datetime.datetime, list[float]]](), False
    for line in lines[1:]:
        if line.strip() == "META_START" and rows:
            break
        if line.strip() in ("META_START", "META_STOP"):
            inside = line.strip() == "META_START"
        elif "=" in line:
            key, _, value = line.partition("=")
            keys[key.strip()] = value.strip()
        elif line.startswith("COVARIANCE_START"):
            break
        elif not inside and not line.startswith("COMMENT"):
            words = line.split()
            try:
                numbers = [float(word) for word in words[1:7]]
            except ValueError:
                numbers = []
            if len(numbers) != 6 or not np.isfinite(numbers).all():
                raise ScenarioError(f"found {line[:60]!r}, allowed: epoch and six numbers", source=source)
            rows.append((_time(words[0], source), numbers))
    missing = [key for key in ("OBJECT_NAME", "CENTER_NAME", "REF_FRAME", "TIME_SYSTEM") if key not in keys]
    if missing or len(rows) < 2:
        raise ScenarioError(f"lacks {', '.join(missing) or 'states: two at least are needed'}", source=source)
    if keys["CENTER_NAME"] != "EARTH" or keys["REF_FRAME"] not in INERTIAL:
        frame = f"CENTER_NAME {keys['CENTER_NAME']}, REF_FRAME {keys['REF_FRAME']}"
        raise ScenarioError(f"found {frame}, allowed: EARTH, {', '.join(INERTIAL)}", source=source)
    first = rows[0][0]
    times = np.array([(time - first).total_seconds() for time, _ in rows])
    if (np.diff(times) <= 0).any():
        raise ScenarioError("the times of its states do not increase", source=source)
    states = 1e3 * np.array([numbers for _, numbers in rows])

    def state(time: datetime.datetime) -> Array:
        """Position and velocity (6,) [m, m/s] at a time, interpolated between the states of the file."""
        from scipy.interpolate import KroghInterpolator

        seconds = (time - first).total_seconds()
        if not 0 <= seconds <= times[-1]:
            raise ScenarioError(
                f"has states from {first.isoformat()} to {rows[-1][0].isoformat()}, none at "
                f"{time.isoformat()}",
                source=source,
            )
        # Hermite's polynomial through the positions and velocities of the nearest states
        begin = int(
            np.clip(np.searchsorted(times, seconds) - NEIGHBOURS // 2, 0, max(len(times) - NEIGHBOURS, 0))
        )
        near = slice(begin, begin + NEIGHBOURS)
        scale = times[near][-1] - times[near][0]
        knots = np.repeat((times[near] - times[near][0]) / scale, 2)
        values = np.empty((len(knots), 3))
        values[::2], values[1::2] = states[near, :3], states[near, 3:] * scale
        polynomial, place = KroghInterpolator(knots, values), (seconds - times[near][0]) / scale
        return np.concatenate([polynomial(place), polynomial.derivative(place) / scale])

    return OrbitEphemeris(
        keys["OBJECT_NAME"], source, keys["REF_FRAME"], keys["TIME_SYSTEM"], first, rows[-1][0], state
    )


def _time(text: str, source: Path) -> datetime.datetime:
    """Time of an ISO 8601 text or of year and day of the year.

    Python's time zone UTC stands for the file's time scale.
    """
    text = text.removesuffix("Z")
    try:
        date, _, clock = text.partition("T")
        if date.count("-") == 1:
            day = datetime.datetime.strptime(date, "%Y-%j")
            date = day.date().isoformat()
        return datetime.datetime.fromisoformat(f"{date}T{clock or '00:00'}").replace(tzinfo=datetime.UTC)
    except ValueError:
        raise ScenarioError(f"found the time {text!r}, allowed: 2026-11-23T12:00:00", source=source) from None
