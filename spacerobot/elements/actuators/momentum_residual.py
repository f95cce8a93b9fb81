r"""Residual of momenta: the part of their rate that commanded torques do not explain, and its test.

A momentum $m$ ($n \times 1$) has the rate $\dot m = \tau_\text{commanded} + b + (\text{missing})$. Its
residual

$$ \dot r = K\,(\dot m - \tau_\text{commanded} - b - r) $$

is the missing torque behind a first-order lag (De Luca and Mattone 2003). At instants a period $T$ apart,
from samples of the velocities and with $a = e^{-K T}$,

$$ r_k = a\,r_{k-1} + (1 - a) \Bigl( \frac{m_k - m_{k-1}}{T}
   - \text{mean}(\tau_\text{commanded} + b) \Bigr). $$

The variance of $r_k$ follows from the variances $s_k^2$ of $m_k$, which are white noise times the rows of
the momentum. Since $r_{k-1}$ and $m_{k-1}$ have the covariance $(1 - a)\,s_{k-1}^2 / T$ for $k > 1$,

$$ V_k = a^2 V_{k-1} + \Bigl( \frac{1 - a}{T} \Bigr)^2 \bigl( s_k^2 + (1 - 2 a)\,s_{k-1}^2 \bigr). $$

A failure is detected if $|r_k|$ exceeds $z \sqrt{V_k}$ plus the allowance for errors of the model. With a
rate $F$ of false alarms in all $n$ residuals, a sample may exceed the threshold with the probability $p = F
T / n$, so that $z = \Phi^{-1}(1 - p / 2)$. By Boole's inequality $F$ is an upper bound: successive samples
are correlated, and several that exceed the threshold are one alarm.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist
from typing import Protocol

import casadi as ca

from spacerobot.elements.core.clock import Clock
from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.contribution import State, memory
from spacerobot.elements.core.event import Event
from spacerobot.elements.core.section_context import SectionContext

TINY = 1e-30
"""Offset that keeps the square root of a zero variance differentiable, before the first measurement."""

Momenta = tuple[ca.SX, ca.SX, ca.SX]
"""Momenta and the known part b of their rates (n x 1 each), and the standard normal numbers of their
noise."""


class ResidualSection(Protocol):
    """Section with the numbers of a residual's test: these, `bandwidth` and `allowance`."""

    @property
    def period(self) -> float | None:
        """Time between two samples [s]; continuous if None."""

    @property
    def false_alarms(self) -> float:
        """Maximum rate of false alarms [1/h]."""


@dataclass(frozen=True)
class Residual:
    """Residuals and their thresholds (n x 1 each), with their states and sample instants."""

    values: ca.SX
    threshold: ca.SX
    states: tuple[State, ...]
    events: tuple[Event, ...] = ()

    @property
    def excess(self) -> ca.SX:
        """Parts by which the residuals exceed their thresholds (n x 1)."""
        return ca.fabs(self.values[: self.threshold.size1()]) / self.threshold - 1


def continuous_residual(context: SectionContext, name: str, commanded: ca.SX, momenta: Momenta) -> Residual:
    """Continuous residuals, without noise.

    Args:
        context: Context of the section with `bandwidth` and `allowance`.
        name: Name of the observer, unique in the closed loop.
        commanded: Commanded torques (n x 1) [N m or N].
        momenta: Momenta and their known rates.
    """
    momentum, rate, _ = momenta
    size = momentum.size1()
    explained = ca.SX.sym(f"{name}.explained", size)
    residual = context.number("bandwidth") * (momentum - explained)
    state = State(f"{name}.explained", explained, momentum, commanded + rate + residual)
    return Residual(residual, ca.repmat(context.number("allowance"), size, 1), (state,))


def sampled_residual(
    config: ResidualSection,
    context: SectionContext,
    name: str,
    asked: ca.SX,
    momenta: Callable[[Clock], Momenta],
    allowance: ca.SX | None = None,
) -> Residual:
    """Residuals held from sample to sample; see :func:`continuous_residual`.

    Args:
        config, context: The section, and its context.
        name, asked: See :func:`continuous_residual`.
        momenta: Function from the clock of the samples to momenta with their noise.
        allowance: Allowance for model errors of the first m residuals (m x 1), on top of noise; only these
            are tested. The section's allowance for all residuals if None.
    """
    size, period = asked.size1(), context.steady("period")
    clock = Clock.of(f"{name}.samples", context.time, period)
    momentum, rate, numbers = momenta(clock)
    effort, zeros = ca.SX.sym(f"{name}.effort", size), ca.SX.zeros(size)
    last, before, residual = (memory(f"{name}.{key}", zeros) for key in ("momentum", "rate", "residual"))
    a = ca.exp(-context.number("bandwidth") * period)
    a = context.once("decay", context.constants.expanded(a))
    missed = (momentum - last.symbol - effort) / period - (rate + before.symbol) / 2
    first = clock.count.symbol < 0.5
    after = ca.if_else(first, 0, a * residual.symbol + (1 - a) * missed)
    states = [clock.count, State(f"{name}.effort", effort, zeros, asked), last, before, residual]
    updates = {f"{name}.effort": zeros, last.name: momentum, before.name: rate, residual.name: after}
    threshold = ca.repmat(context.number("allowance"), size, 1) if allowance is None else allowance
    tests = threshold.size1()
    if numbers.numel():
        rows = ca.jacobian(momentum, numbers)
        noise_variance = ca.densify(ca.sum2(rows * rows))
        white, variance = (memory(f"{name}.{key}", zeros) for key in ("white", "variance"))
        scale = ((1 - a) / period) ** 2
        correlated = 2 * a * (clock.count.symbol > 1.5)  # the first residual is zero
        grown = a**2 * variance.symbol + scale * (noise_variance + (1 - correlated) * white.symbol)
        states += [white, variance]
        updates |= {white.name: noise_variance, variance.name: ca.if_else(first, 0, grown)}
        assert config.period is not None
        passes = config.false_alarms * config.period / 3600 / tests
        exceeded = NormalDist().inv_cdf(1 - min(passes, 1.0) / 2)
        threshold = threshold + exceeded * ca.sqrt(variance.symbol[:tests] + TINY)
    event = clock.event(f"{name}.sampled", "measured", name, updates, silent=True, onboard=True)
    return Residual(residual.symbol, threshold, tuple(states), (event,))


def sample_noise(
    context: SectionContext, name: str, period_s: float, clock: Clock, deviations: list[ca.SX]
) -> tuple[ca.SX, ca.SX]:
    """Errors of one sample (n x 1), and the standard normal numbers from which they follow.

    Args:
        context, name: Context and name of the observer.
        period_s: Time between two samples, by the scenario's numbers.
        clock: Clock of the samples.
        deviations: Standard deviations (n of 1x1); structural zeros have no number.
    """
    noisy = [i for i, deviation in enumerate(deviations) if deviation.nnz()]
    errors = ca.SX(len(deviations), 1)
    if not noisy:
        return errors, ca.SX(0, 1)
    rows = math.ceil(context.parameters.value("simulation.duration") / period_s) + 2
    numbers = context.random(name, rows, len(noisy), clock.count.symbol)
    for number, i in zip(ca.vertsplit(numbers), noisy, strict=True):
        errors[i] = deviations[i] * number
    return errors, numbers


def measured_velocity(
    actuator: ActuatorContext, context: SectionContext, name: str, period_s: float, clock: Clock
) -> tuple[ca.SX, ca.SX]:
    """Velocities of a robot's base and joints in one sample (nv x 1), and the normal numbers of their noise.

    Args:
        actuator: Context of the robot.
        context: Context of the section with `velocity_noise`, `spin_noise` and `joint_noise`.
        name, period_s, clock: See :func:`sample_noise`.
    """
    base = actuator.base_columns
    rotation_columns = base[2:] if len(base) == 3 else base[3:]
    sources = {"velocity_noise": base[: len(base) - len(rotation_columns)], "spin_noise": rotation_columns}
    sources["joint_noise"] = tuple(actuator.columns.values())
    places = [
        (column, key)
        for key, source_columns in sources.items()
        for column in source_columns
        if not context.is_zero(key)
    ]
    deviations = [context.number(key) for _, key in places]
    errors, numbers = sample_noise(context, name, period_s, clock, deviations)
    noise = ca.SX(actuator.plant.v.size1(), 1)
    noise[[column for column, _ in places]] = errors
    return actuator.plant.v + noise, numbers
