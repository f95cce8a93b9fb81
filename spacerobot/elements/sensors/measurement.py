"""Measurements at sample instants, with the errors of real sensors.

Sample k of a signal s, with the sensor's scale b and offset a, is

    m_k = clip(Q(b s + a + beta_k + sigma_d / sqrt(T) n_k)),    beta_k = beta_k-1 + kappa sqrt(T) w_k,

with the period T, the density sigma_d of white noise and kappa of the bias' random walk, standard normal
numbers n and w, the quantisation Q, and a range to which each component is clipped. White noise of density
sigma_d (square root of the two-sided power spectral density) averaged over T has the variance sigma_d^2 / T;
the integral of a rate then performs a random walk sigma_d sqrt(t) for any T (IEEE Std 952). beta_0 is drawn
with the standard deviation of the initial bias. A dropped sample repeats the last one; each sample acts after
the latency and is held until the next. A sensor that measures a vector from a moving point, or a rotation
vector from a moving attitude, holds the resulting position or attitude in the world. A drifting sensor adds a
ramp to the signal, a frozen one repeats its last sample as if it were new, and a lost one gives no more
samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.section import SIGNALS_UNIT, Vector, quantity
from spacerobot.dynamics.rotations import (
    quaternion_from_rotation,
    rotation_exp,
    rotation_from_quaternion,
    rotation_log,
    turn,
)
from spacerobot.elements.core.clock import Clock, DelayLine, PeriodicSection
from spacerobot.elements.core.contribution import State, memory
from spacerobot.elements.core.event import Event
from spacerobot.elements.core.failure import Failure, failing
from spacerobot.elements.core.section_context import SectionContext


class SensorErrors(PeriodicSection):
    """Sampling of a sensor, and its errors in addition to offset and scale."""

    noise: float = quantity(
        f"{SIGNALS_UNIT} s^0.5", "density of white noise, of each component", default=0.0, ge=0
    )
    noise_growth: float = quantity(
        "1/m", "relative growth of the noise with the distance to the target", default=0.0, ge=0
    )
    bias: float = quantity(SIGNALS_UNIT, "standard deviation of the initial bias", default=0.0, ge=0)
    bias_walk: float = quantity(
        f"{SIGNALS_UNIT}/s^0.5", "density of the random walk of the bias", default=0.0, ge=0
    )
    resolution: float = quantity(SIGNALS_UNIT, "quantisation of each component; 0: none", default=0.0, ge=0)
    dropout: float = quantity("1", "probability that a sample is lost", default=0.0, ge=0, lt=1)
    range: float | None = quantity(
        SIGNALS_UNIT, "largest magnitude it shows, of each component", default=None, gt=0
    )
    misalignment_deg: Vector = quantity(
        "deg",
        "rotation vector of the sensor's axes about those of the base or the tip that carries it",
        default=(0.0, 0.0, 0.0),
    )

    def coarsening(self, context: SectionContext) -> Callable[[ca.SX], ca.SX] | None:
        """Return the map from a signal (n x 1) to its quantised and clipped value; None without both.

        Args:
            context: Context of this section.
        """
        step = None if context.is_zero("resolution") else context.number("resolution")
        limit = None if self.range is None else context.number("range")

        def coarsen(signal: ca.SX) -> ca.SX:
            if step is not None:
                signal = step * ca.floor(signal / step + 0.5)
            if limit is not None:  # last, so that rounding up does not exceed it
                signal = ca.fmin(ca.fmax(signal, -limit), limit)
            return signal

        return None if step is None and limit is None else coarsen


class SensorFailure(Failure):
    """Failure of a sensor, which controllers and filters are not informed of."""

    mode: Literal["frozen", "drifting", "lost"] = Field(
        default="frozen",
        description="frozen: it shows what it showed, as if it were new; drifting: an error grows at `rate`; "
        "lost: it gives no more samples, so that filters make no updates; controllers keep the last one",
    )
    rate: float = quantity(
        f"{SIGNALS_UNIT}/s", "growth of the error of each component, where `mode` is `drifting`", default=0.0
    )

    def build(self, context: SectionContext, name: str) -> FailingSensor:
        """Failure of the sensor of a measurement, from the context of this section."""
        failed, event = failing(context, name, switch=f"{name}.failed")
        drifts = self.mode == "drifting"
        ramp = failed * context.number("rate") * (context.time - context.number("at")) if drifts else 0
        return FailingSensor(self.mode, failed, event, ca.SX(ramp))


@dataclass(frozen=True)
class FailingSensor:
    """A sensor that fails: how, its switch (1x1), its event, and its error by drift (1x1)."""

    mode: str
    failed: ca.SX
    event: Event
    drift: ca.SX

    def shown(self, last: ca.SX, new: ca.SX, time: ca.SX | None = None) -> ca.SX:
        """Reading (m x 1) from the last sample and a new one.

        A frozen sensor repeats the value with the new time.
        """
        if self.mode == "drifting":
            return new
        if self.mode == "frozen" and time is not None:
            last = ca.vertcat(last[:-1], time)
        return ca.if_else(self.failed, last, new)


@dataclass(frozen=True)
class Observation:
    """Signal in the view of its sensor.

    Attributes:
        reading: Present value with offset and scale (n x 1); for an attitude, its error about the scene's
            rotation axes.
        distance: Distance to the target (1x1) [m], for a sensor that observes it.
        attitude: True attitude (3x3) of an attitude measurement; None for a vector.
        origin: Origin of the measurement: a part of ``reading`` (n x 1), or the attitude (3x3) from which the
            rotation vector of ``attitude`` is measured; None for zero.
        stamped: Whether a sample ends with its time, -1 for none; a dropped sample keeps the time of the last
            one.
    """

    reading: ca.SX
    distance: ca.SX | None = None
    attitude: ca.SX | None = None
    origin: ca.SX | None = None
    stamped: bool = False

    def sample(
        self, observation: ca.SX, time: ca.SX, coarsen: Callable[[ca.SX], ca.SX] | None = None
    ) -> ca.SX:
        """Sample (m x 1) of an observation.

        Args:
            observation: Observation (n x 1), as ``reading``.
            time: Time of the sample (1x1) [s].
            coarsen: Function from the measured signal (n x 1) to the output numbers, such as quantisation;
                None for the identity.
        """
        if self.attitude is not None:
            planar = observation.size1() == 1
            rotation = ca.mtimes(turned_by(observation), self.attitude)
            if coarsen is not None:
                origin = ca.SX.eye(3) if self.origin is None else self.origin
                measured = rotation_log(ca.mtimes(rotation, origin.T))
                measured = coarsen(ca.densify(measured[2] if planar else measured))
                rotation = ca.mtimes(turned_by(measured), origin)
            observation = attitude_numbers(rotation, planar=planar)
        elif coarsen is not None:
            origin = ca.SX(observation.size1(), 1) if self.origin is None else self.origin
            observation = origin + coarsen(observation - origin)
        return ca.vertcat(observation, time) if self.stamped else observation


def misalignment(context: SectionContext) -> ca.SX | None:
    """Rotation (3x3) of the section ``errors`` from a sensor's axes to its carrier's; None for none."""
    vector = context.parameters.sparse_vector(f"{context.path}.misalignment_deg")
    return context.once("misalignment", rotation_exp(vector * math.pi / 180)) if vector.nnz() else None


def turned_by(vector: ca.SX) -> ca.SX:
    """Rotation (3x3) of a rotation vector, or of its component along z alone (3x1 or 1x1)."""
    if vector.size1() == 3:
        return rotation_exp(vector)
    rotation_vector = ca.SX(3, 1)
    rotation_vector[2] = vector
    return rotation_exp(rotation_vector)


def attitude_numbers(rotation: ca.SX, *, planar: bool) -> ca.SX:
    """Rotation (3x3) as a unit quaternion (4x1), in a plane as cosine and sine (2x1): neither jumps."""
    if not planar:
        return quaternion_from_rotation(rotation)
    return ca.densify(rotation[:2, 0] / ca.norm_2(rotation[:2, 0]))


def attitude_of(numbers: ca.SX) -> ca.SX:
    """Rotation (3x3) of a unit quaternion (4x1), or about z of cosine and sine (2x1)."""
    if numbers.size1() == 4:
        return rotation_from_quaternion(numbers)
    axis = ca.SX(3, 1)
    axis[2] = 1
    return turn(axis, numbers[0], numbers[1])


@dataclass(frozen=True)
class Measurement:
    """Last measurement of a signal.

    Attributes:
        reading: Present reading of the sensor (n x 1).
        value: State that holds the last sample.
        states, events: States of the sensor, and events at its sample instants.
        samples: Number of samples taken.
        bias: Bias at the last sample (n x 1); empty without noise.
        continuous: Reading of a continuous sensor that may fail (n x 1).
    """

    reading: ca.SX
    value: State
    states: tuple[State, ...]
    events: tuple[Event, ...]
    samples: State
    bias: ca.SX | None = None
    continuous: ca.SX | None = None

    @property
    def known(self) -> ca.SX:
        """Known value of the signal (m x 1)."""
        return self.value.symbol if self.continuous is None else self.continuous

    @classmethod
    def failing(cls, name: str, signal: ca.SX, sensor: FailingSensor) -> Measurement:
        """Measurement of a continuous sensor, which stores its reading at the instant of failure."""
        value, none = memory(f"{name}.measured", signal), memory(f"{name}.count", ca.SX.zeros(1))
        event = replace(sensor.event, updates={value.name: ca.densify(signal)})
        reading = sensor.shown(value.symbol, signal + sensor.drift)
        return cls(signal, value, (value,), (event,), none, continuous=reading)

    @classmethod
    def held(
        cls, name: str, context: SectionContext, signal: ca.SX, sensor: FailingSensor | None = None
    ) -> Measurement:
        """Error-free measurement at the start and then once in each ``period`` of the section."""
        period = context.steady("period")
        value, clock = memory(f"{name}.measured", signal), Clock.of(name, context.time, period, begin=period)
        new = signal if sensor is None else sensor.shown(value.symbol, signal + sensor.drift)
        due = clock.event(f"{name}.measured", "measured", name, {value.name: new}, routine=True)
        later_events = () if sensor is None else (sensor.event,)
        return cls(signal, value, (value, clock.count), (due, *later_events), clock.count)

    @classmethod
    def of(
        cls,
        name: str,
        context: SectionContext,
        errors: SensorErrors,
        observed: Observation,
        sensor: FailingSensor | None = None,
    ) -> Measurement:
        """Sampled measurement with errors.

        Args:
            name: Name, unique in the closed loop; it also identifies the sensor's random numbers.
            context: Context of the section ``errors``.
            errors: Section ``errors``.
            observed: Present observation of the sensor.
            sensor: Failure of the sensor, if it fails.
        """
        period = context.steady("period")
        clock = Clock.of(f"{name}.samples", context.time, period)
        value = memory(f"{name}.measured", observed.sample(observed.reading, ca.SX(-1)))
        # a sample (m x 1), stored states with their new values, and the bias (n x 1)
        sample, updated_states = observed.reading, list[tuple[State, ca.SX]]()
        size, root, number = sample.size1(), ca.sqrt(context.steady("period")), clock.count.symbol
        rows = math.ceil(context.parameters.value("simulation.duration") / errors.period) + 2
        begins, walks = (not context.is_zero(key) for key in ("bias", "bias_walk"))
        bias = None
        if begins or walks:
            drift = memory(f"{name}.bias", ca.SX.zeros(size))
            first, walked = ca.SX.zeros(size), drift.symbol
            if begins:
                first = context.number("bias") * context.random(f"{name}.bias", 1, size, ca.SX(0))
            if walks:
                step = context.random(f"{name}.walk", rows, size, number)
                walked = walked + context.number("bias_walk") * root * step
            updated_states.append((drift, ca.if_else(number < 0.5, first, walked)))
            sample, bias = sample + updated_states[0][1], drift.symbol
        if not context.is_zero("noise"):
            density = context.number("noise")
            if observed.distance is not None and not context.is_zero("noise_growth"):
                density = density * (1 + context.number("noise_growth") * observed.distance)
            sample = sample + density / root * context.random(name, rows, size, number)
        if sensor is not None:
            sample = sample + sensor.drift
        sample = observed.sample(sample, clock.instant, errors.coarsening(context))
        if errors.dropout or sensor is not None:
            last = memory(f"{name}.last", observed.sample(observed.reading, ca.SX(-1)))
            if errors.dropout:
                far = NormalDist().inv_cdf(1 - errors.dropout / 2)  # both tails: a number of zero loses none
                lost = ca.fabs(context.random(f"{name}.dropout", rows, 1, number)) > far
                sample = ca.if_else(lost, last.symbol, sample)
            if sensor is not None:
                sample = sensor.shown(last.symbol, sample, clock.instant if observed.stamped else None)
            updated_states.append((last, sample))
        states = [*(state for state, _ in updated_states), value]
        updates = {state.name: new for state, new in updated_states}
        later_events = [] if sensor is None else [sensor.event]
        if context.is_zero("delay"):
            updates[value.name] = sample
        else:
            line = DelayLine.of(name, context, clock, value, errors.delay / errors.period)
            states += line.states
            updates |= line.shifted(sample)
            later_events.append(line.event("measured"))
        steps = not context.is_zero("resolution")
        due = clock.event(f"{name}.sampled", "measured", name, updates, silent=True, quantised=steps)
        return cls(observed.reading, value, (*states, clock.count), (due, *later_events), clock.count, bias)


def places_of(value: ca.SX) -> list[tuple[int, int]]:
    """Indices (row, column) of the non-constant entries of a matrix."""
    rows, columns = value.sparsity().row(), value.sparsity().get_col()
    return [place for place in zip(rows, columns, strict=True) if not value[place].is_constant()]


def changing(value: ca.SX, of: ca.SX | None = None) -> ca.SX:
    """Non-constant entries of a matrix (n x 1), or the entries of another matrix at the same indices."""
    matrix = value if of is None else of
    return ca.vertcat(ca.SX(0, 1), *(matrix[place] for place in places_of(value)))


def filled(value: ca.SX, entries: ca.SX) -> ca.SX:
    """Matrix with its non-constant entries replaced by other values (n x 1)."""
    matrix = ca.SX(value)
    for place, part in zip(places_of(value), ca.vertsplit(entries), strict=True):
        matrix[place] = part
    return matrix
