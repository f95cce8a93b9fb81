"""Measurements at instants, with the errors of real sensors.

Sample k of a signal s, with the sensor's scale b and offset a, is

    m_k = Q(clip(b s + a + beta_k + sigma_d / sqrt(T) n_k)),    beta_k = beta_k-1 + kappa sqrt(T) w_k,

with the period T, the densities sigma_d of white noise and kappa of the bias' random walk, standard normal
numbers n and w, the range by which it is clipped and the quantisation Q. White noise of density sigma_d
(square root of the two-sided power spectral density) has the variance sigma_d^2 / T where it is averaged
over T; the integral of a rate then walks at random by sigma_d sqrt(t), whatever T (IEEE Std 952). beta_0 is
drawn with the standard deviation of the initial bias. A sample that drops out leaves the last one; each
acts after the latency, and is held until the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import casadi as ca
from pydantic import model_validator

from spacerobot.elements.clock import MAX_DELAY, Clock, DelayLine
from spacerobot.elements.contribution import State, memory
from spacerobot.elements.event import Event
from spacerobot.elements.section_context import SectionContext
from spacerobot.section import SIGNALS_UNIT, Section, quantity


class SensorErrors(Section):
    """Sampling of a sensor, and its errors beside offset and scale."""

    period: float = quantity("s", "time between two samples, the first at the start", gt=0)
    delay: float = quantity(
        "s", f"latency, from a sample to its being known, at most {MAX_DELAY} periods", default=0.0, ge=0
    )
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
    resolution: float = quantity(SIGNALS_UNIT, "quantisation; 0: none", default=0.0, ge=0)
    dropout: float = quantity("1", "probability that a sample is lost", default=0.0, ge=0, lt=1)
    range: float | None = quantity(SIGNALS_UNIT, "largest magnitude it shows", default=None, gt=0)

    @model_validator(mode="after")
    def _check(self) -> SensorErrors:
        if self.delay > MAX_DELAY * self.period:
            raise ValueError(
                f"delay: found {self.delay:g} s, allowed: at most {MAX_DELAY} periods, "
                f"{MAX_DELAY * self.period:g} s"
            )
        return self

    @property
    def is_random(self) -> bool:
        """Whether it has noise."""
        return any((self.noise, self.bias, self.bias_walk, self.dropout))


@dataclass(frozen=True)
class Measurement:
    """A signal as it was measured last.

    Attributes
    ----------
    shown
        What the sensor sees now (n x 1).
    value
        What is known of it.
    states, events
        What it remembers, and its instants.
    """

    shown: ca.SX
    value: State
    states: tuple[State, ...]
    events: tuple[Event, ...]

    @classmethod
    def held(cls, name: str, context: SectionContext, shown: ca.SX) -> Measurement:
        """Without errors, at the start and then once in each ``period`` of the section."""
        period = context.steady("period")
        value, clock = memory(f"{name}.measured", shown), Clock.of(name, context.time, period, begin=period)
        due = clock.event(f"{name}.measured", "measured", name, {value.name: shown}, routine=True)
        return cls(shown, value, (value, clock.count), (due,))

    @classmethod
    def of(
        cls,
        name: str,
        context: SectionContext,
        errors: SensorErrors,
        shown: ca.SX,
        distance: ca.SX | None = None,
    ) -> Measurement:
        """With errors.

        Parameters
        ----------
        name
            Unique in the closed loop; it also tells the sensor's random numbers from those of others.
        context
            Of the section ``errors``.
        errors
            That section.
        shown
            What the sensor sees now, offset and scale in it (n x 1).
        distance
            To the target (1x1) [m], for what sees it.
        """
        period = context.steady("period")
        clock = Clock.of(f"{name}.samples", context.time, period)
        value = memory(f"{name}.measured", shown)
        sample, kept = _sample(name, context, errors, clock, (shown, distance))
        states, updates = [*(state for state, _ in kept), value], {state.name: new for state, new in kept}
        later: list[Event] = []
        if context.is_zero("delay"):
            updates[value.name] = sample
        else:
            line = DelayLine.of(name, context, clock, value, errors.delay / errors.period)
            states += line.states
            updates |= line.shifted(sample)
            later.append(line.event("measured"))
        steps = not context.is_zero("resolution")
        due = clock.event(f"{name}.sampled", "measured", name, updates, silent=True, quantised=steps)
        return cls(shown, value, (*states, clock.count), (due, *later))


def _sample(
    name: str,
    context: SectionContext,
    errors: SensorErrors,
    clock: Clock,
    seen: tuple[ca.SX, ca.SX | None],
) -> tuple[ca.SX, list[tuple[State, ca.SX]]]:
    """A sample (n x 1), and what is remembered for the next one, with its new values."""
    (shown, distance), kept = seen, list[tuple[State, ca.SX]]()
    size, root = shown.size1(), ca.sqrt(context.steady("period"))
    found = shown
    if errors.is_random:
        rows = math.ceil(context.parameters.value("simulation.duration") / errors.period) + 2
        numbers = context.random(name, rows, 2 * size + 1, clock.count.symbol)
        white, walk, lost = numbers[:size], numbers[size : 2 * size], numbers[2 * size]
        drift = memory(f"{name}.bias", ca.SX.zeros(size))
        first = clock.count.symbol < 0.5
        bias = ca.if_else(
            first, context.number("bias") * walk, drift.symbol + context.number("bias_walk") * root * walk
        )
        density = context.number("noise")
        if distance is not None and not context.is_zero("noise_growth"):
            density = density * (1 + context.number("noise_growth") * distance)
        found = found + bias + density / root * white
        kept.append((drift, bias))
    if errors.range is not None:
        limit = context.number("range")
        found = ca.fmin(ca.fmax(found, -limit), limit)
    if not context.is_zero("resolution"):
        step = context.number("resolution")
        found = step * ca.floor(found / step + 0.5)
    if errors.dropout:
        last = memory(f"{name}.last", shown)
        threshold = NormalDist().inv_cdf(errors.dropout)
        found = ca.if_else(lost < threshold, last.symbol, found)
        kept.append((last, found))
    return found, kept


def places_of(value: ca.SX) -> list[tuple[int, int]]:
    """Places in a matrix of what is no constant."""
    rows, columns = value.sparsity().row(), value.sparsity().get_col()
    return [place for place in zip(rows, columns, strict=True) if not value[place].is_constant()]


def changing(value: ca.SX) -> ca.SX:
    """Entries of a matrix that are not constant (n x 1)."""
    return ca.vertcat(ca.SX(0, 1), *(value[place] for place in places_of(value)))


def filled(value: ca.SX, other: ca.SX) -> ca.SX:
    """A matrix with other values (n x 1) of what is no constant."""
    found = ca.SX(value)
    for place, part in zip(places_of(value), ca.vertsplit(other), strict=True):
        found[place] = part
    return found
