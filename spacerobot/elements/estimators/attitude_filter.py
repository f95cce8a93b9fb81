r"""Multiplicative extended Kalman filter (MEKF) of a base's attitude and its gyro's bias.

The attitude is propagated by the gyro, $R^+ = R \exp(T (\omega_m - b))$, with the mean $\omega_m$ of two
samples in the base's axes; the bias $b$ is a random walk (Lefferts, Markley and Shuster 1982). The errors
are a small rotation $\delta$ about world axes, $R_\text{true} = \exp(\delta) R$, and $b_\text{true} - b$:

$$ \dot\delta = -R\,(b_\text{true} - b) - R\,n_v, \qquad \dot b_\text{true} = n_u $$

About world axes the transition of $\delta$ is the identity. With $A = R \exp(T \omega / 2)\,T$, the midpoint
rule for the integral of $R$, the error $n$ of the gyro's last sample, and the densities $\sigma_v$ of its
noise and $\sigma_u$ of its walk, over a period

$$ \delta^+ = \delta - A\,(b_\text{true} - b) - \tfrac12 A\,(n + n^+), \qquad
   \operatorname{var}(n) = \sigma_v^2 / T, $$

and by the walk

$$ \operatorname{cov}(\delta) = \tfrac13 \sigma_u^2 T^3, \qquad
   \operatorname{cov}(\delta, b) = -\tfrac12 \sigma_u^2 T A, \qquad \operatorname{cov}(b) = \sigma_u^2 T $$

(Farrenkopf 1978; Markley and Crassidis 2014, Eq. 6.93, there about the base's axes). Two turns share each
sample, so $n$ is a part of the state. White noise $\sigma_v^2 T$ of each turn, as if gyros returned means
over a period, would count $\sigma_v^2 T / 2$ too much where a star tracker is compared: with a slow, noisy
gyro the filter is then too cautious.

A star tracker measures $R_m = \exp(m) R_\text{true}$: its innovation is $\log(R_m R^\top) = \delta + m$.
The innovation of a late one belongs to its own instant, at which the attitude and its error are copied. The
error of the copy is a further part of the state, which stays constant and is correlated with the others
(stochastic cloning, Roumeliotis and Burdick 2002). After an update $\delta$ is moved into $R$, and reset to
zero.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, Literal

import casadi as ca

from spacerobot.common.section import quantity
from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.dynamics.rotations import rotation_exp, rotation_log
from spacerobot.elements.core.clock import Clock
from spacerobot.elements.core.contribution import Contribution, Innovation, Output, State, memory
from spacerobot.elements.core.event import both, negated
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties
from spacerobot.elements.estimators.estimator import Estimator, EstimatorContext
from spacerobot.elements.estimators.kalman import symmetric, triangle, updated
from spacerobot.elements.sensors.measurement import attitude_numbers, attitude_of, turned_by

GYRO, TRACKER = "base_spin", "base_orientation"
DEGREE = ca.pi / 180


@register
class AttitudeFilter(Estimator):
    """Attitude, spin and gyro bias of the base from a gyro and a star tracker (multiplicative Kalman filter).

    It runs at the gyro's samples. Noise densities and deviations default to those of the sensors.
    """

    kind: Literal["attitude_filter"] = "attitude_filter"
    needs: ClassVar[tuple[str, ...]] = (GYRO, TRACKER)
    makes: ClassVar[tuple[str, ...]] = (TRACKER, GYRO)

    attitude_deg: float = quantity(
        "deg",
        "standard deviation of the initial attitude's error, which is drawn",
        default=0.1,
        gt=0,
    )
    bias: float | None = quantity(
        "rad/s", "standard deviation of the initial bias; the gyro's if not given", default=None, gt=0
    )
    rate_noise: float | None = quantity(
        "rad/s^0.5", "density of the gyro's white noise; the gyro's if not given", default=None, ge=0
    )
    bias_walk: float | None = quantity(
        "rad/s^1.5", "density of the bias' random walk; the gyro's if not given", default=None, ge=0
    )
    attitude_noise: float | None = quantity(
        "rad",
        "standard deviation of a star tracker's sample; its own if not given",
        default=None,
        gt=0,
    )

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Errors: missing measurements, or sample times that the filter cannot use."""
        missing_measurements = [*super().faults(robot)]
        yield from missing_measurements
        gyro, tracker = (
            (robot.sensors[signal].errors for signal in self.needs)
            if not missing_measurements
            else (None, None)
        )
        if gyro is None or tracker is None:
            return
        if gyro.delay:
            yield "", f"found a gyro that is {gyro.delay:g} s late, allowed: {GYRO} without `delay`"
        for key in ("period", "delay"):
            ratio = getattr(tracker, key) / gyro.period
            if abs(ratio - round(ratio)) > 1e-9 * max(ratio, 1):
                yield (
                    "",
                    f"found {getattr(tracker, key):g} s as {key} of {TRACKER}, allowed: whole multiples of "
                    f"the gyro's period, {gyro.period:g} s",
                )
        if tracker.delay > tracker.period * (1 + 1e-9):
            yield (
                "",
                f"found {TRACKER} {tracker.delay:g} s late, allowed: at most its period, {tracker.period:g}",
            )
        if self.attitude_noise is None and not tracker.noise:
            yield "attitude_noise", f"missing, and {TRACKER} has no `noise`; give one of them"
        if self.bias is None and not gyro.bias:
            yield "bias", f"missing, and {GYRO} has no `bias`; give one of them"

    def build(self, robot: EstimatorContext) -> Contribution:
        """Estimates, and the event that makes them."""
        return _AttitudeFilterLaw(self, robot).contribution()

    def assumptions(self) -> list[str]:
        """Assumptions of its model, for the user."""
        return ["begins with an attitude whose error is drawn, and with the gyro's bias unknown"]

    def words(self) -> str:
        """Initial uncertainty."""
        return f"attitude_filter from {self.attitude_deg:g} deg"


class _AttitudeFilterLaw:
    """States, numbers and expressions of one filter; see above."""

    def __init__(self, config: AttitudeFilter, robot: EstimatorContext) -> None:
        self.robot, self.config, plant = robot, config, robot.plant
        self.axes = plant.rotation_axes
        self.size = size = len(self.axes)
        self.true = plant.placement(robot.base_frame)[0]
        spin = plant.velocity(robot.base_frame)[1]
        self.gyro = robot.sample(GYRO, ca.mtimes(self.true.T, spin), self.axes, ca.SX.eye(3))
        self.tracker = robot.sample(TRACKER, self.true, self.axes)
        self.late = not robot.errors(TRACKER).is_zero("delay")
        self.attitude = self._state("attitude", self._numbers(self.true))
        self.bias = self._state("bias", ca.SX.zeros(size))
        self.spin = self._state("spin", ca.densify(spin[list(self.axes)]))
        self.rate = self._state("rate", ca.SX.zeros(size))  # as measured last
        self.used = self._state("used", ca.SX(-0.5))  # time of the star tracker's last sample that was used
        self.nis = self._state("nis", ca.SX.zeros(1))
        self.covariance = self._state("covariance", triangle(self._initial()))
        self.copied = self._state("copied", ca.SX.zeros(1))  # samples of the star tracker, late ones alone
        self.copy = self._state("copy", self.attitude.initial)

    def _state(self, name: str, initial: ca.SX) -> State:
        return memory(f"{self.robot.label}.{name}", initial)

    def _numbers(self, rotation: ca.SX) -> ca.SX:
        return attitude_numbers(rotation, planar=self.robot.plant.planar)

    def _number(self, key: str, signal: str, default: str) -> ca.SX:
        """A number of the section, or that of a sensor (1x1)."""
        if getattr(self.config, key) is not None:
            return self.robot.context.number(key)
        return self.robot.errors(signal).number(default)

    def _initial(self) -> ca.SX:
        """Covariance at the start."""
        variance, n = ca.SX.zeros(self._count), self.size
        variance[:n] = (self.robot.context.number("attitude_deg") * DEGREE) ** 2
        variance[n : 2 * n] = self._number("bias", GYRO, "bias") ** 2
        variance[2 * n : 3 * n] = self._sample_variance
        return ca.diag(variance)

    @property
    def _sample_variance(self) -> ca.SX:
        """Variance of a component of a gyro's sample without its bias (1x1) [rad^2/s^2]."""
        return self._number("rate_noise", GYRO, "noise") ** 2 / self.robot.errors(GYRO).steady("period")

    def _predicted(self) -> tuple[ca.SX, ca.SX]:
        """Attitude and covariance at this instant, before its measurements."""
        period, n = self.robot.errors(GYRO).steady("period"), self.size
        attitude, measured = attitude_of(self.attitude.symbol), self.gyro.value.symbol[:n]
        turn = period * ((self.rate.symbol + measured) / 2 - self.bias.symbol)
        axes = list(self.axes)
        lever = period * ca.mtimes(attitude, turned_by(turn / 2))[axes, axes]
        white = self._sample_variance
        walk = self._number("bias_walk", GYRO, "bias_walk") ** 2 * period
        covariance = symmetric(self.covariance.symbol, self._count)
        # The mean of two samples has the error (n + n+) / 2. The part of the last sample, n, is a state, and
        # enters by the transition, -A / 2; that of the new sample is noise: A A^T var(n) / 4 = T^2 var(n) / 4
        # in delta, var(n) in the new state, and -A var(n) / 2 between them. The walk adds the covariances of
        # the module's equations.
        transition, noise = ca.SX.eye(self._count), ca.SX(self._count, self._count)
        transition[:n, n : 2 * n], transition[:n, 2 * n : 3 * n] = -lever, -lever / 2
        transition[2 * n : 3 * n, 2 * n : 3 * n] = ca.SX(n, n)
        noise[:n, :n] = (white / 4 + walk / 3) * period**2 * ca.SX.eye(n)
        for first, variance in ((n, walk), (2 * n, white)):
            columns = slice(first, first + n)
            noise[:n, columns], noise[columns, :n] = -variance / 2 * lever, -variance / 2 * lever.T
            noise[columns, columns] = variance * ca.SX.eye(n)
        spread = ca.mtimes(transition, ca.mtimes(covariance, transition.T)) + noise
        return ca.mtimes(attitude, turned_by(turn)), spread

    @property
    def _count(self) -> int:
        return (4 if self.late else 3) * self.size

    def contribution(self) -> Contribution:
        """Contribution: states, event at the gyro's sample instants, estimates and outputs."""
        robot, n = self.robot, self.size
        clock = Clock.of(f"{robot.label}.instants", robot.context.time, robot.errors(GYRO).steady("period"))
        first = clock.count.symbol < 0.5
        begin = robot.context.number("attitude_deg") * DEGREE
        initial_error = begin * robot.context.random(f"{robot.label}.begin", 1, n, ca.SX(0))
        predicted, spread = self._predicted()
        predicted = ca.if_else(first, ca.mtimes(turned_by(initial_error), self.true), predicted)
        spread = ca.if_else(first, self._initial(), spread)
        sample = self.tracker.value.symbol
        fresh = both(sample[-1] > self.used.symbol, negated(robot.rejected(TRACKER)))
        place = 3 * n if self.late else 0
        rows = ca.SX(n, self._count)
        rows[:, place : place + n] = ca.SX.eye(n)
        compared = attitude_of(self.copy.symbol) if self.late else predicted
        innovation = rotation_log(ca.mtimes(attitude_of(sample[:-1]), compared.T))[list(self.axes)]
        if self.config.attitude_noise is None:
            errors = robot.errors(TRACKER)
            variance = errors.number("noise") ** 2 / errors.steady("period")
        else:
            variance = robot.context.number("attitude_noise") ** 2
        correction, after, nis = updated(spread, rows, innovation, [variance] * n)
        correction, after = ca.if_else(fresh, correction, 0), ca.if_else(fresh, after, spread)
        attitude = ca.mtimes(turned_by(correction[:n]), predicted)
        bias = self.bias.symbol + correction[n : 2 * n]
        measured = self.gyro.value.symbol[:n] - correction[2 * n : 3 * n]
        axes = list(self.axes)
        numbers = self._numbers(attitude)
        updates = [
            (self.attitude, numbers),
            (self.bias, bias),
            (self.spin, ca.mtimes(attitude[axes, axes], measured - bias)),
            (self.rate, measured),
            (self.used, ca.if_else(fresh, sample[-1], self.used.symbol)),
            (self.nis, ca.if_else(fresh, nis, self.nis.symbol)),
        ]
        if self.late:
            sample_count = self.tracker.samples.symbol
            new = sample_count > self.copied.symbol + 0.5
            again = ca.SX.eye(self._count)
            again[3 * n :, :n], again[3 * n :, 3 * n :] = ca.SX.eye(n), ca.SX(n, n)
            after = ca.if_else(new, ca.mtimes(again, ca.mtimes(after, again.T)), after)
            updates += [(self.copy, ca.if_else(new, numbers, self.copy.symbol)), (self.copied, sample_count)]
        updates.append((self.covariance, triangle(after)))
        updates_by_name = {state.name: ca.densify(value) for state, value in updates}
        tick = clock.event(f"{robot.label}.estimated", "estimated", robot.label, updates_by_name, silent=True)
        estimate, spin = attitude_of(self.attitude.symbol), ca.SX(3, 1)
        spin[axes] = self.spin.symbol
        error = ca.mtimes(estimate, self.true.T)

        def turned(vector: ca.SX) -> ca.SX:
            """Rotation vector to the estimated attitude from an attitude whose vector to the true one is
            given.

            With exp(vector) = R_true R^T it is log(R_estimated R_true^T exp(vector)).
            """
            return rotation_log(ca.mtimes(error, rotation_exp(vector)))

        # innovations of the star tracker
        period_s = robot.context.parameters.value(f"{robot.errors(TRACKER).path}.period")
        instants = robot.errors(GYRO).steady("period"), ca.SX(0)
        innovation_of_tracker = Innovation(
            robot.label, TRACKER, self.nis.symbol, n, self.used.symbol, *instants, period_s
        )
        return Contribution(
            states=(*(state for state, _ in updates), clock.count),
            events=(tick,),
            outputs=tuple(self._outputs(clock)),
            estimates=((TRACKER, turned), (GYRO, lambda _: spin)),
            innovations=(innovation_of_tracker,),
        )

    def _present(self, clock: Clock) -> tuple[ca.SX, ca.SX]:
        """Attitude and covariance at the present time, propagated from the last update by the last sample.

        Controllers read the attitude of the last update, which is held. On a base that turns, its error grows
        between updates by many standard deviations of the update.
        """
        n, axes, period = self.size, list(self.axes), self.robot.errors(GYRO).steady("period")
        since = self.robot.context.time - ca.fmax(clock.count.symbol - 1, 0) * period
        attitude = attitude_of(self.attitude.symbol)
        covariance = symmetric(self.covariance.symbol, self._count)
        # the noise of the last sample acts for the whole time; in the mean of two samples its half does
        lever, transition = since * attitude[axes, axes], ca.SX.eye(self._count)
        transition[:n, n : 2 * n] = transition[:n, 2 * n : 3 * n] = -lever
        covariance = ca.mtimes(transition, ca.mtimes(covariance, transition.T))
        return ca.mtimes(turned_by(since * self.spin.symbol), attitude), covariance

    def _outputs(self, clock: Clock) -> Iterable[Output]:
        """Errors, standard deviations and normalised squared errors (consistency) of the present estimate."""
        n, name = self.size, self.robot.robot
        estimate, covariance = self._present(clock)
        error = rotation_log(ca.mtimes(self.true, estimate.T))[list(self.axes)]
        true = ca.SX.zeros(n) if self.gyro.bias is None else self.gyro.bias
        covariance = covariance[: 2 * n, : 2 * n]
        deviation = ca.sqrt(ca.diag(covariance))
        errors = ca.vertcat(error, true - self.bias.symbol)
        nees = ca.dot(errors, SymmetricFactors(covariance).solve(errors))
        vectors = {
            "attitude_estimate_error": (error, "rad", "rotation vector from estimated to true attitudes"),
            "attitude_estimate_deviation": (deviation[:n], "rad", "standard deviation of attitude estimates"),
            "bias_estimate": (self.bias.symbol, "rad/s", "estimated biases of gyros, axes of the base"),
            "bias_estimate_error": (
                errors[n:],
                "rad/s",
                "true minus estimated gyro bias, base axes",
            ),
            "bias_estimate_deviation": (deviation[n:], "rad/s", "standard deviation of bias estimates"),
        }
        for key, (value, unit, text) in vectors.items():
            vector = ca.SX(3, 1)
            vector[list(self.axes)] = value
            yield Output(key, vector, unit, text, "body", name)
        yield Output("attitude_nees", nees, "1", "normalised error squared of attitude filters", "body", name)
        text = "normalised innovation squared of attitude filters"
        yield Output("attitude_nis", self.nis.symbol, "1", text, "body", name)
        text = "degrees of freedom of attitude_nis, 0 until a sample of the star tracker is used"
        yield Output("attitude_nis_dof", n * (self.used.symbol >= 0), "1", text, "body", name)
