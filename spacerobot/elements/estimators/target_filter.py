r"""Extended Kalman filter of the target's motion and inertia ratios from camera poses alone.

The target drifts freely as one body, with its centre of mass $r$, velocity $v$, attitude $R$, and spin
$\omega$ in its principal axes, whose moments of inertia have the ratios $e^{k_1} : e^{k_2} : 1$:

$$ \ddot r = g, \qquad \dot R = R\,[\omega]_\times, \qquad
   \dot\omega = -I^{-1} (\omega \times I \omega), \qquad \dot k = 0 $$

plus white accelerations of given densities (Aghili and Parsa 2009; the logarithms keep ratios positive).
Poses alone determine the moments up to a common factor. The errors are those of $r$ and $v$, a small
rotation $\delta$ about world axes, $R_\text{true} = \exp(\delta) R$, and those of $\omega$ and $k$:

$$ \dot\delta = R\,\delta\omega, \qquad \delta\dot\omega = F_\omega\,\delta\omega + F_k\,\delta k $$

with the derivatives $F$ of $\dot\omega$. Their transition is integrated with the mean by the Runge-Kutta
method of order 4. In a plane the spin is constant, and there are no ratios.

A camera shows position and attitude of a frame of the target at $t_k$ and is late by $T_d$. The filter is an
ordinary one at the instants $t_k$, evaluated at $t_k + T_d$. Its estimate at $t_k$ is then propagated by
$T_d$, and from there on with the closed loop. Controllers read the propagated estimate.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.section import Name, quantity
from spacerobot.dynamics import subtree
from spacerobot.dynamics.algebra import SymmetricFactors, cross, skew
from spacerobot.dynamics.inertias import shifted_inertia
from spacerobot.dynamics.rotations import rotation_exp, rotation_log
from spacerobot.elements.core.clock import ONCE, Clock
from spacerobot.elements.core.contribution import Contribution, Innovation, Output, State, memory
from spacerobot.elements.core.event import Event, both, negated
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties
from spacerobot.elements.estimators.estimator import Estimator, EstimatorContext
from spacerobot.elements.estimators.kalman import symmetric, triangle, updated
from spacerobot.elements.sensors.measurement import attitude_numbers, attitude_of, turned_by

PLACE, ATTITUDE = "target_position", "target_orientation"
DEGREE = math.pi / 180
LONGEST = 0.25  # s; step of the propagation: at 1 rad/s its error is 1e-5 of the turn


@register
class TargetFilter(Estimator):
    """Pose, velocity, spin and inertia ratios of a free target from camera poses (extended Kalman filter).

    It runs at the camera's samples. Measurement noise defaults to that of the sensors.
    """

    kind: Literal["target_filter"] = "target_filter"
    needs: ClassVar[tuple[str, ...]] = (PLACE, ATTITUDE)
    makes: ClassVar[tuple[str, ...]] = (PLACE, ATTITUDE, "target_velocity", "target_spin")

    tip: Name = Field(description="tip of the robot that carries the camera")
    frame: str = Field(description="link of the target whose pose the camera measures")
    position: float = quantity("m", "standard deviation of the initial position", default=0.1, gt=0)
    velocity: float = quantity("m/s", "standard deviation of the initial velocity", default=0.02, gt=0)
    attitude_deg: float = quantity("deg", "standard deviation of the initial attitude", default=5.0, gt=0)
    spin_deg: float = quantity("deg/s", "standard deviation of the initial spin", default=1.0, gt=0)
    inertia: float = quantity(
        "1", "standard deviation of the logarithms of the inertia ratios", default=0.1, gt=0
    )
    initial_factor: float = quantity(
        "1",
        "initial standard deviations that it assumes, over those its error is drawn with",
        default=1.0,
        gt=0,
    )
    acceleration: float = quantity(
        "m/s^1.5", "density of accelerations that the model leaves out", default=0.0, ge=0
    )
    spin_acceleration: float = quantity(
        "rad/s^1.5", "density of angular accelerations that the model leaves out", default=0.0, ge=0
    )
    position_noise: float | None = quantity(
        "m", "standard deviation of a sample of the position; the camera's if not given", default=None, gt=0
    )
    attitude_noise: float | None = quantity(
        "rad", "standard deviation of a sample of the attitude; the camera's if not given", default=None, gt=0
    )

    def frames(self) -> tuple[str, str]:
        """The tip that it looks from, and the link of the target that it looks at."""
        return self.tip, self.frame

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Measurements that it lacks, or that are not of one camera."""
        lacks = [*super().faults(robot)]
        yield from lacks
        if lacks:
            return
        place, attitude = (robot.sensors[signal].errors for signal in self.needs)
        assert place is not None
        assert attitude is not None
        for key in ("period", "delay"):
            if getattr(place, key) != getattr(attitude, key):
                yield (
                    "",
                    f"found {key} {getattr(place, key):g} s of {PLACE} and {getattr(attitude, key):g} s of "
                    f"{ATTITUDE}, allowed: the same, since one camera shows both",
                )
        for signal, errors, filter_noise in (
            (PLACE, place, self.position_noise),
            (ATTITUDE, attitude, self.attitude_noise),
        ):
            if filter_noise is None and not errors.noise:
                key = "position_noise" if signal == PLACE else "attitude_noise"
                yield key, f"missing, and {signal} has no `noise`; give one of them"

    def build(self, robot: EstimatorContext) -> Contribution:
        """Estimates, and the events that make them."""
        return _TargetFilterLaw(self, robot).contribution()

    def assumptions(self) -> list[str]:
        """Assumptions of its model, for the user."""
        return [
            "knows where the camera is, and the target's centre of mass and principal axes",
            "the target drifts freely as one body; the first estimate has a drawn error",
        ]

    def words(self) -> str:
        """Frame that it sees, and the tip that it sees it from."""
        return f"target_filter of {self.frame} as seen from {self.tip}"


class _TargetFilterLaw:
    """States, numbers and expressions of one filter.

    A motion is the stack of position, velocity, attitude numbers, spin and inertia ratios, along the axes of
    the scene.
    """

    def __init__(self, config: TargetFilter, robot: EstimatorContext) -> None:
        self.config, self.robot, plant = config, robot, robot.plant
        self.along, self.about = list(plant.translation_axes), list(plant.rotation_axes)
        self.planar, self.ratios = plant.planar, 0 if plant.planar else 2
        m, n = len(self.along), len(self.about)
        self.errors = [m, m, n, n, self.ratios]  # components of the error
        self.numbers = [m, m, 2 if plant.planar else 4, n, self.ratios]
        body = robot.target
        assert body is not None, "scenes without a target are refused"
        self.body = body
        self.camera = plant.placement(robot.tips[config.tip])[1]
        rotation, origin = plant.placement(body.root)
        velocity, spin = plant.velocity(body.root)
        lever = ca.mtimes(rotation, ca.SX(ca.DM(body.centre)))
        self.axes = ca.sparsify(ca.SX(ca.DM(body.axes)))  # principal ones, in those of the root link
        attitude = attitude_numbers(ca.mtimes(rotation, self.axes), planar=self.planar)
        parts = (
            (origin + lever)[self.along],
            (velocity + cross(spin, lever))[self.along],
            attitude,
            ca.mtimes(self.axes.T, ca.mtimes(rotation.T, spin))[self.about],
            self._true_ratios(ca.mtimes(rotation, self.axes), origin + lever),
        )
        self.true = ca.densify(ca.vertcat(*parts))
        seen_rotation, seen_place = body.poses[config.frame]
        # the observed frame, in principal axes about the centre of mass
        self.arm = ca.mtimes(self.axes.T, ca.SX(ca.DM(seen_place - body.centre)))
        self.turn = ca.mtimes(self.axes.T, ca.SX(ca.DM(seen_rotation)))
        how, where = plant.placement(body.links[config.frame])
        away = ca.norm_2(ca.densify(where - self.camera))
        carrier = plant.placement(robot.tips[config.tip])[0]
        self.place = robot.sample(
            PLACE, where - self.camera, plant.translation_axes, carrier, (self.camera, away)
        )
        self.attitude = robot.sample(ATTITUDE, how, plant.rotation_axes, carrier, (self.camera, away))
        label, initial_motion = robot.label, self.true
        self.mean = memory(f"{label}.mean", initial_motion)
        self.covariance = memory(
            f"{label}.covariance",
            triangle(ca.diag((self.robot.context.number("initial_factor") * self._deviations()) ** 2)),
        )
        self.used = memory(f"{label}.used", ca.SX([-0.5, -0.5]))
        self.nis = memory(f"{label}.nis", ca.SX.zeros(2))
        symbol = ca.SX.sym(f"{label}.now", initial_motion.size1())
        self.now = State(f"{label}.now", symbol, initial_motion, self._rate(symbol))

    def _true_ratios(self, axes: ca.SX, centre: ca.SX) -> ca.SX:
        """Logarithms of the true inertia ratios, also where a campaign varies inertias.

        Args:
            axes, centre: Principal axes (3x3) and centre of mass (3x1) [m] in the world.
        """
        if not self.ratios:
            return ca.SX(0, 1)
        plant, total = self.robot.plant, ca.SX(3, 3)
        for joint in subtree(plant.model, plant.model.frames[self.body.root].parentJoint):
            arm = plant.kinematics.origin[joint] - centre
            total += shifted_inertia(*plant.inertias.in_world(plant.kinematics, joint), arm)[2]
        moments = ca.diag(ca.mtimes(axes.T, ca.mtimes(total, axes)))
        return ca.log(moments[:2] / moments[2])

    def _parts(self, motion: ca.SX) -> list[ca.SX]:
        """r, v, attitude numbers, spin and ratios of a motion."""
        return [ca.SX(part) for part in ca.vertsplit(motion, [0, *_summed(self.numbers)])]

    def _spin_rate(self, spin: ca.SX, ratios: ca.SX) -> ca.SX:
        """Euler's equations with the moments e^k1, e^k2, 1; none in a plane."""
        if self.planar:
            return ca.SX.zeros(1)
        inertia = ca.vertcat(ca.exp(ratios), 1)
        return -cross(spin, inertia * spin) / inertia

    def _rate(self, motion: ca.SX) -> ca.SX:
        """Rate of a free-drift motion."""
        _, velocity, attitude, spin, ratios = self._parts(motion)
        if self.planar:
            attitude_rate = spin * ca.vertcat(-attitude[1], attitude[0])
        else:
            vector, scalar = attitude[:3], attitude[3]
            attitude_rate = ca.vertcat(scalar * spin + cross(vector, spin), -ca.dot(vector, spin)) / 2
        gravity = ca.SX(ca.DM(self.robot.plant.model.gravity.linear))[self.along]
        return ca.densify(
            ca.vertcat(
                velocity, gravity, attitude_rate, self._spin_rate(spin, ratios), ca.SX.zeros(self.ratios)
            )
        )

    def _advanced(self, motion: ca.SX, time: ca.SX, steps: int) -> tuple[ca.SX, ca.SX]:
        """Motion after a time, and the transition matrix of its errors."""
        n, count = len(self.about), len(self.about) + self.ratios
        spin_symbol, driven = ca.SX.sym("w", n), ca.SX.sym("k", self.ratios)
        slope = ca.jacobian(self._spin_rate(spin_symbol, driven), ca.vertcat(spin_symbol, driven))
        slopes = ca.Function("slopes", [spin_symbol, driven], [slope])

        def rate(motion: ca.SX, spread: ca.SX, _: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
            """Rates of a motion, of its spin and of its turn by the first spin and the ratios."""
            _, _, attitude, spin, ratios = self._parts(motion)
            jacobian = slopes(spin, ratios)
            driven = ca.mtimes(jacobian[:, :n], spread)
            driven[:, n:] += jacobian[:, n:]
            axes = attitude_of(attitude)[self.about, self.about]
            return self._rate(motion), driven, ca.mtimes(axes, spread)

        parts = self._parts(motion)
        spread, ratio_part, h = ca.SX.eye(n), ca.SX.zeros(n, count), time / steps
        spread = ca.horzcat(spread, ca.SX.zeros(n, self.ratios))
        for _ in range(steps):
            value = (motion, spread, ratio_part)
            first = rate(*value)
            second = rate(*(x + h / 2 * k for x, k in zip(value, first, strict=True)))
            third = rate(*(x + h / 2 * k for x, k in zip(value, second, strict=True)))
            fourth = rate(*(x + h * k for x, k in zip(value, third, strict=True)))
            slopes_of = zip(value, first, second, third, fourth, strict=True)
            motion, spread, ratio_part = (x + h / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in slopes_of)
        place, velocity, attitude, spin, ratios = self._parts(motion)
        if self.planar:  # exactly
            attitude = self._turned(parts[2], time * parts[3])
        attitude = attitude / ca.norm_2(attitude)
        m, size = len(self.along), sum(self.errors)
        transition = ca.SX.eye(size)
        transition[:m, m : 2 * m] = time * ca.SX.eye(m)
        transition[2 * m : 2 * m + n, 2 * m + n :] = ratio_part
        transition[2 * m + n : 2 * m + 2 * n, 2 * m + n :] = spread
        return ca.vertcat(place, velocity, attitude, spin, ratios), transition

    def _noise(self, attitude: ca.SX, time: ca.SX) -> ca.SX:
        """Process noise covariance of white accelerations over a time.

        White acceleration of the density s integrates to a velocity with the variance s^2 T and to a position
        with s^2 int (T - t)^2 dt = s^2 T^3 / 3; their covariance is s^2 int (T - t) dt = s^2 T^2 / 2. The
        spin is in principal axes and the rotation about world axes, hence R in their covariance.
        """
        number, m, n = self.robot.context.number, len(self.along), len(self.about)
        covariance = ca.SX(sum(self.errors), sum(self.errors))
        axes = attitude_of(attitude)[self.about, self.about]
        for key, first, size, turn in (
            ("acceleration", 0, m, ca.SX.eye(m)),
            ("spin_acceleration", 2 * m, n, axes),
        ):
            density, next_ = number(key) ** 2, first + size
            covariance[first:next_, first:next_] = density * time**3 / 3 * ca.SX.eye(size)
            covariance[first:next_, next_ : next_ + size] = density * time**2 / 2 * turn
            covariance[next_ : next_ + size, first:next_] = density * time**2 / 2 * turn.T
            covariance[next_ : next_ + size, next_ : next_ + size] = density * time * ca.SX.eye(size)
        return covariance

    def _deviations(self) -> ca.SX:
        """Standard deviations at the start."""
        number = self.robot.context.number
        deviations = (
            number("position"),
            number("velocity"),
            number("attitude_deg") * DEGREE,
            number("spin_deg") * DEGREE,
            number("inertia"),
        )
        return ca.vertcat(*(ca.repmat(x, size, 1) for x, size in zip(deviations, self.errors, strict=True)))

    def _corrected(self, motion: ca.SX, correction: ca.SX) -> ca.SX:
        """Motion to which errors are added."""
        place, velocity, attitude, spin, ratios = self._parts(motion)
        parts = ca.vertsplit(correction, [0, *_summed(self.errors)])
        numbers = self._turned(attitude, ca.SX(parts[2]))
        return ca.densify(
            ca.vertcat(place + parts[0], velocity + parts[1], numbers, spin + parts[3], ratios + parts[4])
        )

    def _turned(self, attitude: ca.SX, vector: ca.SX) -> ca.SX:
        """Attitude numbers after a small rotation about world axes."""
        return attitude_numbers(ca.mtimes(turned_by(vector), attitude_of(attitude)), planar=self.planar)

    def _updates(self, first: ca.SX) -> list[tuple[State, ca.SX]]:
        """New values of the filter's states at a sample; ``first`` (1x1) marks the first sample."""
        period = self.robot.errors(PLACE).steady("period")
        nominal = self.robot.context.parameters.value(f"{self.robot.errors(PLACE).path}.period")
        mean, transition = self._advanced(self.mean.symbol, period, math.ceil(nominal / LONGEST))
        size, m, n = sum(self.errors), len(self.along), len(self.about)
        spread = symmetric(self.covariance.symbol, size)
        predicted = ca.mtimes(transition, ca.mtimes(spread, transition.T))
        predicted = predicted + self._noise(self._parts(mean)[2], period)
        mean, spread = ca.if_else(first, self.mean.symbol, mean), ca.if_else(first, spread, predicted)
        place, _, attitude, _, _ = self._parts(mean)
        rotation = attitude_of(attitude)
        lever = ca.mtimes(rotation, self.arm)
        position_sample, attitude_sample = self.place.value.symbol, self.attitude.value.symbol
        away = ca.norm_2(position_sample[:m] - self.camera[self.along])
        # The camera shows r + R l with the arm l in principal axes. With R_true = exp(delta) R it is
        # r + R l + delta x (R l) to first order, so the derivative by delta is -[R l]x. The innovation of the
        # attitude is log(R_m (R R_l)^T) = delta + noise.
        rows = ca.SX(m + n, size)
        rows[:m, :m] = ca.SX.eye(m)
        rows[:m, 2 * m : 2 * m + n] = -skew(lever)[self.along, self.about]
        rows[m:, 2 * m : 2 * m + n] = ca.SX.eye(n)
        rotation_error = rotation_log(
            ca.mtimes(attitude_of(attitude_sample[:-1]), ca.mtimes(rotation, self.turn).T)
        )[self.about]
        innovation = ca.vertcat(position_sample[:m] - place - lever[self.along], rotation_error)
        correction, used, squares = ca.SX.zeros(size), [], []
        samples = (
            (slice(0, m), position_sample, "position_noise", PLACE),
            (slice(m, m + n), attitude_sample, "attitude_noise", ATTITUDE),
        )
        for i, (part, value, key, signal) in enumerate(samples):
            # variance of a component of a sample, taken at a distance (1x1)
            if getattr(self.config, key) is not None:
                variance = self.robot.context.number(key) ** 2
            else:
                errors = self.robot.errors(signal)
                grown = errors.number("noise") * (1 + errors.number("noise_growth") * away)
                variance = grown**2 / errors.steady("period")
            residual = innovation[part] - ca.mtimes(rows[part, :], correction)
            step, after, nis = updated(spread, rows[part, :], residual, [variance] * residual.size1())
            fresh = both(value[-1] > self.used.symbol[i], negated(self.robot.rejected(signal)))
            correction = correction + ca.if_else(fresh, step, 0)
            spread = ca.if_else(fresh, after, spread)
            squares.append(ca.if_else(fresh, nis, 0))
            used.append(ca.if_else(fresh, value[-1], self.used.symbol[i]))
        mean = self._corrected(mean, correction)
        present = mean
        if not self.robot.errors(PLACE).is_zero("delay"):
            late = self.robot.errors(PLACE).steady("delay")
            nominal = self.robot.context.parameters.value(f"{self.robot.errors(PLACE).path}.delay")
            present = self._advanced(mean, late, math.ceil(nominal / LONGEST))[0]
        return [
            (self.mean, mean),
            (self.covariance, triangle(spread)),
            (self.used, ca.vertcat(*used)),
            (self.nis, ca.vertcat(*squares)),
            (self.now, present),
        ]

    def contribution(self) -> Contribution:
        """Contribution: states, events, estimates and outputs."""
        robot, label = self.robot, self.robot.label
        errors = robot.errors(PLACE)
        begins = Clock.of(f"{label}.begin", robot.context.time, ca.SX(ONCE))
        initial_error = self._deviations() * robot.context.random(
            f"{label}.begin", 1, sum(self.errors), ca.SX(0)
        )
        initial = self._corrected(self.mean.symbol, initial_error)
        first = {self.mean.name: initial, self.now.name: initial}
        delay = errors.steady("delay")
        clock = Clock.of(f"{label}.arrivals", robot.context.time, errors.steady("period"), delay)
        self.arrived = clock.count.symbol
        updates = self._updates(clock.count.symbol < 0.5)
        updates_by_name = {state.name: ca.densify(value) for state, value in updates}
        events: tuple[Event, ...] = (
            begins.event(f"{label}.begun", "estimated", label, first, silent=True),
            clock.event(f"{label}.estimated", "estimated", label, updates_by_name, silent=True),
        )
        # place and velocity of points (3x1) of the target, its rotation vectors and spin, world axes
        plant = self.robot.plant
        place, velocity, attitude, spin, _ = self._parts(self.now.symbol)
        centre, velocity_of_centre, spin_of_target = ca.SX(3, 1), ca.SX(3, 1), ca.SX(3, 1)
        centre[self.along], velocity_of_centre[self.along], spin_of_target[self.about] = place, velocity, spin
        principal = attitude_of(attitude / ca.norm_2(attitude))
        spin_of_target = ca.mtimes(principal, spin_of_target)
        rotation, origin = plant.placement(self.body.root)
        error = ca.mtimes(ca.mtimes(principal, self.axes.T), rotation.T)
        true = origin + ca.mtimes(rotation, ca.SX(ca.DM(self.body.centre)))
        if self.planar:
            centre[2] = true[2]

        def lever(point: ca.SX) -> ca.SX:
            return ca.mtimes(error, point - true)

        return Contribution(
            states=(*(state for state, _ in updates), begins.count, clock.count),
            events=events,
            outputs=tuple(self._outputs()),
            estimates=tuple(
                {
                    PLACE: lambda point: centre + lever(point),
                    ATTITUDE: lambda vector: rotation_log(ca.mtimes(error, rotation_exp(vector))),
                    "target_velocity": lambda point: velocity_of_centre + cross(spin_of_target, lever(point)),
                    "target_spin": lambda _: spin_of_target,
                }.items()
            ),
            innovations=tuple(self._innovations()),
        )

    def _innovations(self) -> Iterable[Innovation]:
        """Innovations of the position and, given that, of the attitude, which are independent."""
        robot, errors = self.robot, self.robot.errors(PLACE)
        instants = errors.steady("period"), errors.steady("delay")
        period_s = robot.context.parameters.value(f"{errors.path}.period")
        for i, (signal, axes) in enumerate(((PLACE, self.along), (ATTITUDE, self.about))):
            square, used = self.nis.symbol[i], self.used.symbol[i]
            yield Innovation(robot.label, signal, square, len(axes), used, *instants, period_s)

    def _outputs(self) -> Iterable[Output]:
        """Errors, standard deviations and normalised squared errors (consistency) of the present estimate."""
        name, size, m, n = self.robot.robot, sum(self.errors), len(self.along), len(self.about)
        since = self.robot.context.time
        errors, parameters = self.robot.errors(PLACE), self.robot.context.parameters
        since = since - ca.fmax(self.arrived - 1, 0) * errors.steady("period")
        longest = sum(parameters.value(f"{errors.path}.{key}") for key in ("period", "delay"))
        mean, transition = self._advanced(self.mean.symbol, since, math.ceil(longest / LONGEST))
        covariance = symmetric(self.covariance.symbol, size)
        covariance = ca.mtimes(transition, ca.mtimes(covariance, transition.T))
        covariance = covariance + self._noise(self._parts(mean)[2], since)
        deviation = ca.sqrt(ca.diag(covariance))
        estimate, truth = self._parts(self.now.symbol), self._parts(self.true)
        turn = rotation_log(ca.mtimes(attitude_of(truth[2]), attitude_of(estimate[2]).T))[self.about]
        error = ca.vertcat(
            *(b - a for a, b in zip(estimate[:2], truth[:2], strict=True)),
            turn,
            *(b - a for a, b in zip(estimate[3:], truth[3:], strict=True)),
        )
        texts = (
            ("position", "m", "of the target's centre of mass", self.along),
            ("velocity", "m/s", "of its velocity", self.along),
            ("attitude", "rad", "of the target's attitude", self.about),
            ("spin", "rad/s", "of its spin, principal axes", self.about),
        )
        for (key, unit, text, axes), first in zip(texts, (0, m, 2 * m, 2 * m + n), strict=True):
            for kind, values, prefix in (
                ("error", error, "true minus estimated, "),
                ("deviation", deviation, "standard deviation "),
            ):
                vector = ca.SX(3, 1)
                vector[axes] = values[first : first + len(axes)]
                yield Output(f"target_{key}_{kind}", vector, unit, prefix + text, "body", name)
        ratios = self._parts(self.now.symbol)[4]
        for i in range(self.ratios):
            text = f"estimated logarithm of the target's inertia ratio {i + 1} : 3"
            yield Output(f"target_inertia_{i + 1}", ratios[i], "1", text, "body", name)
        nees = ca.dot(error, SymmetricFactors(covariance).solve(error))
        text = "normalised error squared of target filters"
        yield Output("target_nees", nees, "1", text, "body", name)
        text = "normalised innovation squared of target filters"
        yield Output("target_nis", ca.sum1(self.nis.symbol), "1", text, "body", name)
        # A dropout leaves the time of the last used sample a whole period or more before the last instant.
        used = self.used.symbol > (self.arrived - 1.5) * errors.steady("period")
        freedoms = ca.dot(used, ca.SX([m, n]))
        text = "degrees of freedom of target_nis: components of the innovation used in the last update"
        yield Output("target_nis_dof", freedoms, "1", text, "body", name)


def _summed(sizes: list[int]) -> list[int]:
    return [sum(sizes[: i + 1]) for i in range(len(sizes))]
