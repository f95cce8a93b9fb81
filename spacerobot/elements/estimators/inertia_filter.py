r"""Recursive least squares for the inertial parameters of the object that a tip holds, from momentum.

Only the actuators of its base act on the robot and the object that it holds. Their momentum about the
world's origin (that of the wheels included) is therefore $h + I$, with $h$ constant and the impulse $I$ of
these actuators, which is known as it is delivered, as by accelerometers. In the coordinates of the base's
velocity, with the base's rows $H$ of the robot's mass matrix, the tip's Jacobian $J$ (axes of the tip,
$J_b$ its columns of the base) and the regressor $Y$ of a body's momentum,

$$ J_b^\top\,Y(J v)\,\pi - X h = X I - (H v + \text{wheels}) $$

is linear in the object's ten parameters $\pi$ (axes of the tip) and in $h$, which is unknown too (Murotsu
and others, J. Guidance 17(3), 1994; Ma, Dang and Pham, IEEE TRO 24(5), 2008). It needs no acceleration, and
not the place of the object in the tip. The residual has the errors of $v$: with their variances $S$ (of the
base's velocity and spin and of the joints' rates) its covariance is

$$ W^{-1} = G S G^\top, \qquad G = H + J_b^\top M J $$

with the spatial inertia $M$ of the estimate so far. Errors of attitude, position and angles are smaller by
the duration of the motion, and are neglected. The rows $A = [J_b^\top Y, -X]$ contain the same noise, so
that $A^\top W z$, with the right side $z$, has the expectation

$$ A^\top W A\,(\pi, h) - \sum_j S_j \Bigl( \frac{\partial A}{\partial v_j} \Bigr)^\top W G_j. $$

The sum is added; without it slow motions would shrink the mass (bias-compensated least squares).

The information matrix $A^\top W A$ and the vector of ($\pi$ minus the assumed one, $h$) are summed over the
instants, from the prior of $\pi$ and none of $h$. Their solution, $h$ eliminated first, is the minimum of
the weighted squares so far. (Covariances instead of information lose digits: $h$ begins unknown and ends
known to 1e-5 of itself.)

``held_deviation`` is the root of the largest eigenvalue of the relative covariance $C$ (mass over the
assumed mass, centre over the radius of gyration, inertia over the mean moment), from a smooth upper bound:
$\operatorname{tr}(C^8)^{1/8}$ exceeds the largest eigenvalue by at most $10^{1/8}$, a third.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.errors import ScenarioError
from spacerobot.common.section import MAX_SAMPLES, Name, Vector, quantity
from spacerobot.dynamics import FreeFloating
from spacerobot.dynamics.algebra import SymmetricFactors, skew
from spacerobot.dynamics.inertial_parameters import (
    PLANAR,
    SIZE,
    in_other_axes,
    inertial_parameters,
    mass_properties,
    momentum_regressor,
    spatial_inertia,
)
from spacerobot.dynamics.rotations import rotation_exp
from spacerobot.elements.core.clock import Clock
from spacerobot.elements.core.contribution import Contribution, Output, State, memory
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties
from spacerobot.elements.estimators.estimator import HELD_INERTIA, Estimator, EstimatorContext
from spacerobot.elements.estimators.kalman import symmetric, triangle
from spacerobot.elements.sensors.joint_position import joint_position

NOISY = {"velocity_noise": "base_velocity", "spin_noise": "base_spin", "rate_noise": "joint_rate"}
OTHERS = ("base_position", "base_orientation", "joint_position")


@register
class InertiaFilter(Estimator):
    """Mass, centre of mass and inertia of a held object by recursive least squares on momentum.

    It runs while the tip holds the object, on sensors of base and joints or on filters listed before it.
    """

    kind: Literal["inertia_filter"] = "inertia_filter"
    makes: ClassVar[tuple[str, ...]] = (HELD_INERTIA,)

    tip: Name = Field(description="tip of the robot that holds the object")
    frame: str = Field(description="link of the target that it holds, a mating frame")
    period: float = quantity("s", "time between two updates", default=0.5, gt=0, recurs=MAX_SAMPLES)
    mass: float | None = quantity(
        "kg", "assumed mass, with which it begins; that of the target if not given", default=None, gt=0
    )
    com: Vector | None = quantity(
        "m", "assumed centre of mass, axes of the target's root link; likewise", default=None
    )
    inertia: tuple[float, float, float, float, float, float] | None = quantity(
        "kg m^2", "assumed ixx, iyy, izz, ixy, ixz, iyz about it, same axes; likewise", default=None
    )
    mass_deviation: float = quantity(
        "1", "standard deviation of the assumed mass, relative", default=0.5, gt=0
    )
    com_deviation: float = quantity(
        "m", "standard deviation of the assumed centre of mass, along each axis", default=0.1, gt=0
    )
    inertia_deviation: float = quantity(
        "1",
        "standard deviation of the assumed moments and products of inertia, over their mean moment",
        default=0.5,
        gt=0,
    )
    velocity_noise: float | None = quantity(
        "m/s", "standard deviation of the base's measured velocity; its sensor's if not given", default=None
    )
    spin_noise: float | None = quantity(
        "rad/s", "standard deviation of the base's measured spin; its sensor's if not given", default=None
    )
    rate_noise: float | None = quantity(
        "rad/s, m/s", "standard deviation of a measured joint rate; its sensor's if not given", default=None
    )

    def frames(self) -> tuple[str, str]:
        """The tip that holds, and the link of the target that is held."""
        return self.tip, self.frame

    def reads(self) -> set[str]:
        """Motion of the base and of the joints."""
        return {*NOISY.values(), *OTHERS}

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """Reasons why it cannot run: a fixed base, missing noise, samples at other instants than its own."""
        if robot.base == "fixed":
            yield "", f"the base of {robot.name} is fixed, so momentum is not conserved; leave it out"
        for signal in (*NOISY.values(), *OTHERS):
            sensor = robot.sensors.get(signal)
            errors = None if sensor is None else sensor.errors
            key = next((key for key, of in NOISY.items() if of == signal), None)
            if key and getattr(self, key) is None and not (errors and (errors.noise or errors.resolution)):
                yield key, f"missing, and {signal} has no `noise`; give one of them"
            ratio = self.period / errors.period if errors else 1.0
            if abs(ratio - round(ratio)) > 1e-9 * ratio or ratio < 0.5:
                yield (
                    "period",
                    f"found {self.period:g} s, allowed: whole multiples of the period of {signal}, "
                    f"{errors.period if errors else 0:g} s",
                )

    def build(self, robot: EstimatorContext) -> Contribution:
        """Estimates, and the event that makes them."""
        return _InertiaFilterLaw(self, robot).contribution()

    def assumptions(self) -> list[str]:
        """Assumptions of its model, for the user."""
        return [
            "knows the robot's own masses, and the impulse that the actuators of its base deliver; nothing "
            "else acts from outside"
        ]

    def words(self) -> str:
        """Tip and period."""
        return f"inertia_filter of what {self.tip} holds, every {self.period:g} s"


class _InertiaFilterLaw:
    """States and expressions of one filter, as in the module's equations."""

    def __init__(self, config: InertiaFilter, robot: EstimatorContext) -> None:
        self.config, self.robot, plant = config, robot, robot.plant
        self.planar = plant.planar
        self.columns = list(PLANAR if plant.planar else range(SIZE))
        model, joint = plant.model, int(plant.model.frames[robot.base_frame].parentJoint)
        self.joint, first = joint, int(model.idx_vs[joint])
        self.base = list(range(first, first + int(model.nvs[joint])))
        self.axes = [*plant.translation_axes, *(axis + 3 for axis in plant.rotation_axes)]
        self.tip, self.label = robot.tips[config.tip], robot.label
        once, expanded = robot.context.once, robot.context.constants.expanded
        # parameters of the assumed object (10x1), axes of the mating frame, which the tip's are to meet
        number, target = self.robot.context.number, self.robot.target
        assert target is not None, "scenes are refused whose filters see nothing"
        mass = ca.SX(target.mass) if self.config.mass is None else number("mass")
        if self.config.com is None:
            centre = ca.SX(ca.DM(target.centre))
        else:
            centre = ca.vertcat(*(number(f"com.{i}") for i in range(3)))
        if self.config.inertia is None:
            about = target.axes @ ca.DM(ca.diag(target.moments)) @ target.axes.T
            inertia = ca.SX(ca.vertcat(ca.diag(about), about[0, 1], about[0, 2], about[1, 2]))
        else:
            inertia = ca.vertcat(*(number(f"inertia.{i}") for i in range(6)))
        rotation, origin = (ca.SX(ca.DM(part)) for part in target.poses[self.config.frame])
        assumed_parameters = inertial_parameters(mass, centre, inertia)
        self.assumed = once(
            "assumed", expanded(in_other_axes(assumed_parameters, rotation.T, -ca.mtimes(rotation.T, origin)))
        )
        # covariance at the start, of independent errors of mass, centre and inertia
        mass, _, mean = self._scales()
        deviation = self._by_name(
            number("mass_deviation") * mass, number("com_deviation"), number("inertia_deviation") * mean
        )
        count = deviation.size1()
        # d pi / d named is the inverse of a triangular matrix
        back = ca.solve(ca.densify(self._slope(self.assumed[self.columns])), ca.SX.eye(count))
        self.first = once(
            "prior", expanded(triangle(ca.mtimes(back, ca.mtimes(ca.diag(deviation**2), back.T))))
        )
        self.size = size = len(self.columns) + len(self.base)
        self.start = ca.densify(self.assumed[self.columns])
        self.mean = memory(f"{self.label}.mean", self.start)
        self.covariance = memory(f"{self.label}.covariance", self.first)
        self.information = memory(f"{self.label}.information", ca.SX.zeros(size * (size + 1) // 2))
        self.vector = memory(f"{self.label}.vector", ca.SX.zeros(size))

    def _whole(self) -> ca.SX:
        """Estimate (10x1); parameters that do not affect planar motion keep their assumed values."""
        parameters = ca.SX(self.assumed)
        parameters[self.columns] = self.mean.symbol
        return parameters

    def _scales(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Mass, radius of gyration and mean moment of inertia of the assumed object (1x1 each)."""
        mass, _, inertia = mass_properties(self.assumed)
        mean = inertia[2] if self.planar else ca.sum1(inertia[:3]) / 3
        return mass, ca.sqrt((1.0 if self.planar else 1.5) * mean / mass), mean

    def _named(self, values: ca.SX) -> ca.SX:
        """Mass, centre and inertia of parameters that are estimated: ten, of four in a plane four."""
        if not self.planar:
            return ca.vertcat(*mass_properties(values))
        mass, x, y, moment = ca.vertsplit(values)
        return ca.vertcat(mass, x / mass, y / mass, moment - (x * x + y * y) / mass)

    def _slope(self, values: ca.SX) -> ca.SX:
        """Derivative of the named by the estimated parameters."""
        symbol = ca.SX.sym("pi", values.size1())
        slope = ca.Function("slope", [symbol], [ca.jacobian(self._named(symbol), symbol)])
        return slope(values)

    def _by_name(self, mass: ca.SX, centre: ca.SX, inertia: ca.SX) -> ca.SX:
        """Vector with ``mass``, ``centre`` and ``inertia`` repeated for each parameter of that type."""
        centres, inertias = (2, 1) if self.planar else (3, 6)
        return ca.vertcat(mass, ca.repmat(centre, centres, 1), ca.repmat(inertia, inertias, 1))

    def _variance(self, key: str) -> ca.SX:
        """Variance of a sample (1x1)."""
        if getattr(self.config, key) is not None:
            return self.robot.context.number(key) ** 2
        errors = self.robot.errors(NOISY[key])
        return errors.number("noise") ** 2 / errors.steady("period") + errors.number("resolution") ** 2 / 12

    def _added(self) -> tuple[ca.SX, ca.SX]:
        """Information of one sample: triangle of the matrix, and vector."""
        robot, plant = self.robot, self.robot.plant
        # measured q with the true base (nq x 1), v (nv x 1), and from momentum about the world's origin
        model, read = plant.model, robot.read
        rotation, origin = plant.placement(robot.base_frame)
        start = robot.context.once("attitude", robot.attitude)
        rotation_vector = read("base_orientation", plant.orientation_error(rotation, start))
        # from world axes to the estimated base axes, expressed in true base axes
        turn = ca.mtimes(rotation, ca.mtimes(rotation_exp(rotation_vector), start).T)
        place = read("base_position", origin)
        velocity, spin = plant.velocity(robot.base_frame)
        twist = ca.vertcat(
            ca.mtimes(turn, read("base_velocity", velocity)), ca.mtimes(turn, read("base_spin", spin))
        )
        onto = plant.jacobian(robot.base_frame)[:, self.base]  # whose columns are orthonormal
        v = ca.SX(plant.v)
        v[self.base] = ca.mtimes(onto.T, twist)
        columns = [int(model.idx_vs[joint]) for joint in robot.joints]
        v[columns] = read("joint_rate", plant.v[columns])
        v = ca.mtimes(plant.spread, v) if plant.ties.size2() else v
        angles = ca.vertcat(*(joint_position(model, joint, plant.q) for joint in robot.joints))
        q = ca.SX(plant.q)
        for joint, angle in robot.positions(read("joint_position", angles)).items():
            at = int(model.idx_qs[joint])
            if model.nqs[joint] == 1:
                q[at] = angle
            else:
                q[at], q[at + 1] = ca.cos(angle), ca.sin(angle)
        transport = ca.vertcat(ca.horzcat(turn, ca.SX(3, 3)), ca.horzcat(-ca.mtimes(turn, skew(place)), turn))
        total = ca.mtimes(onto.T, transport)[:, self.axes]
        split = FreeFloating.split(plant.model, plant.kinematics, plant.inertias, self.joint)
        count = plant.v.size1()
        inertia = ca.SX(len(self.base), count)
        inertia[:, self.base], inertia[:, list(split.columns)] = split.base_inertia, split.base_coupling
        axes = plant.placement(self.tip)[0].T
        jacobian = ca.mtimes(ca.diagcat(axes, axes), plant.jacobian(self.tip))
        inertia, jacobian = ca.substitute([inertia, jacobian], [plant.q], [q])
        twist, back = ca.mtimes(jacobian, v), jacobian[:, self.base].T
        regressor = ca.mtimes(back, momentum_regressor(twist[:3], twist[3:])[:, self.columns])
        wheels = ca.mtimes(onto.T, ca.vertcat(ca.SX(3, 1), robot.stored_momentum()))
        rows = ca.horzcat(regressor, -total)
        pushed = ca.mtimes(total, robot.base_impulse()[self.axes])
        right_side = pushed - ca.mtimes(inertia, v) - wheels - ca.mtimes(regressor, self.start)
        momentum_map = inertia + ca.mtimes(back, ca.mtimes(spatial_inertia(self._whole()), jacobian))
        momentum_map = ca.mtimes(momentum_map, plant.spread) if plant.ties.size2() else momentum_map
        variances = ca.SX(count, 1)
        moving = len(plant.translation_axes)
        variances[self.base[:moving]] = self._variance("velocity_noise")
        variances[self.base[moving:]] = self._variance("spin_noise")
        variances[[int(plant.model.idx_vs[joint]) for joint in robot.joints]] = self._variance("rate_noise")
        factors = SymmetricFactors(
            ca.densify(ca.mtimes(momentum_map, ca.mtimes(ca.diag(variances), momentum_map.T)))
        )
        white = factors.reduced(ca.horzcat(rows, right_side))
        weighted = ca.mtimes(ca.diag(-factors.negated_pivots), white)
        added = ca.mtimes(white[:, :-1].T, weighted)  # the last column is the vector
        # noise of the rows is correlated with that of the residual; its expectation, by parameter
        shared = ca.mtimes(back.T, factors.solve(ca.mtimes(momentum_map, ca.diag(variances))))
        shared = ca.mtimes(shared, jacobian.T)
        identity = ca.SX.eye(SIZE)
        bias = [ca.sum1(ca.sum2(spatial_inertia(identity[:, i]) * shared)) for i in self.columns]
        return triangle(added[:, :-1]), added[:, -1] + ca.vertcat(*bias, ca.SX(len(self.base), 1))

    def contribution(self) -> Contribution:
        """Contribution: states, event at the sample instants, estimate and outputs."""
        robot = self.robot
        for signal in (*NOISY.values(), *OTHERS):
            delay = robot.delay_s(signal)
            if delay:
                raise ScenarioError(
                    f"found {signal} {delay:g} s late, allowed: without `delay`, or an estimator above that "
                    "estimates it",
                    where=robot.context.path,
                )
        closed = robot.holds(self.config.tip, self.config.frame)
        clock = Clock.of(f"{self.label}.instants", robot.context.time, robot.context.steady("period"))
        information, vector = (
            old.symbol + new for old, new in zip((self.information, self.vector), self._added(), strict=True)
        )
        # parameters and the triangle of their covariance, the total momentum eliminated
        n = len(self.columns)
        information_matrix = symmetric(information, self.size)
        momentum, coupling = SymmetricFactors(information_matrix[n:, n:]), information_matrix[n:, :n]
        prior = SymmetricFactors(symmetric(self.first, n)).solve(ca.SX.eye(n))
        reduced = information_matrix[:n, :n] - ca.mtimes(coupling.T, momentum.solve(coupling))
        factors = SymmetricFactors(prior + reduced)
        right = vector[:n] - ca.mtimes(coupling.T, momentum.solve(vector[n:]))
        mean = self.start + factors.solve(right)
        covariance = triangle(factors.solve(ca.SX.eye(n)))
        updates: list[tuple[State, ca.SX]] = [
            (self.mean, ca.if_else(closed, mean, self.start)),
            (self.covariance, ca.if_else(closed, covariance, self.first)),
            (self.information, ca.if_else(closed, information, 0)),
            (self.vector, ca.if_else(closed, vector, 0)),
        ]
        updates_by_name = {state.name: ca.densify(value) for state, value in updates}
        tick = clock.event(f"{self.label}.estimated", "estimated", self.label, updates_by_name, silent=True)
        estimate = self._whole()
        return Contribution(
            states=(*(state for state, _ in updates), clock.count),
            events=(tick,),
            outputs=tuple(self._outputs()),
            estimates=((HELD_INERTIA, lambda _: closed * estimate),),
        )

    def _outputs(self) -> Iterable[Output]:
        """Errors, standard deviations and normalised squared error (consistency) of the estimate."""
        plant, target, name = self.robot.plant, self.robot.target, self.robot.robot
        assert target is not None, "scenes are refused whose filters see nothing"
        joint = int(plant.model.frames[target.root].parentJoint)
        mass, moment, about = (
            part[joint] for part in (plant.inertias.mass, plant.inertias.moment, plant.inertias.rotational)
        )
        entries = [about[place] for place in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
        body = ca.densify(ca.vertcat(mass, moment, *entries))
        axes, origin = plant.placement(self.tip)
        rotation = ca.mtimes(axes.T, plant.kinematics.rotation[joint])
        lever = ca.mtimes(axes.T, plant.kinematics.origin[joint] - origin)
        true = in_other_axes(body, rotation, lever)[self.columns]
        count = len(self.columns)
        mean = self.mean.symbol
        covariance = symmetric(self.covariance.symbol, count)
        slope = self._slope(mean)
        spread = ca.mtimes(slope, ca.mtimes(covariance, slope.T))
        error, deviation = self._named(true) - self._named(mean), ca.sqrt(ca.diag(spread))
        places = {
            "mass": ("kg", [0], [0]),
            "com": ("m", [1, 2], [0, 1]) if self.planar else ("m", [1, 2, 3], [0, 1, 2]),
            "moments": ("kg m^2", [3], [2]) if self.planar else ("kg m^2", [4, 5, 6], [0, 1, 2]),
        } | ({} if self.planar else {"products": ("kg m^2", [7, 8, 9], [0, 1, 2])})
        for key, (unit, columns, at) in places.items():
            for kind, values, text in (
                ("error", error, "true minus estimated"),
                ("deviation", deviation, "standard deviation of the estimated"),
            ):
                value = ca.SX(1 if key == "mass" else 3, 1)
                value[at] = values[columns]
                label = {
                    "com": "centre of mass",
                    "moments": "moments of inertia",
                    "products": "products of inertia",
                }
                text = f"{text} {label.get(key, key)} of held objects, axes of the tip"
                yield Output(f"held_{key}_{kind}", value, unit, text, "body", name)
        left = true - mean
        nees = ca.dot(left, SymmetricFactors(covariance).solve(left))
        yield Output("held_nees", nees, "1", "normalised error squared of inertia filters", "body", name)
        scale = 1 / self._by_name(*self._scales())
        power = ca.mtimes(ca.diag(scale), ca.mtimes(spread, ca.diag(scale)))
        size = ca.trace(power)
        power = power / size  # whose powers neither vanish nor grow
        for _ in range(3):
            power = ca.mtimes(power, power)
        worst = ca.sqrt(size * ca.trace(power) ** (1 / 8))
        text = "maximum relative standard deviation, in any direction, of inertia filters"
        yield Output("held_deviation", worst, "1", text, "body", name)
