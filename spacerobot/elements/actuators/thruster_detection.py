r"""Detection and isolation of failed thrusters from the momentum of their robot.

Linear momentum $P$ and angular momentum $L$ about the root link's origin o, of all the robot's bodies and
wheels, in the root link's axes (spin $\omega$, velocity $v$ of o), change by the thrusters' force $f$ and
torque $t$ alone,

$$ \dot P = f - \omega \times P, \qquad \dot L = t - \omega \times L - v \times P, $$

so that the residual of $(P, L)$ is the missing wrench
(:mod:`spacerobot.elements.actuators.momentum_residual`).
Thruster $j$, with the wrench $A_j$ at full thrust and the commanded throttle $a_j$, misses

$$ -a_j A_j \ \text{ if its valve is shut}, \qquad (1 - a_j) A_j \ \text{ if it is open}, $$

behind the same lag. A failure is detected if a component of the residual exceeds its threshold. It is
attributed to one thruster if, once the residual has exceeded a threshold for $4 / K$, the difference from
what this thruster would miss is below all thresholds, and the difference from every other explanation is
not. The lag then shows what is missing to 2 %. Thrusters with the same wrench cannot be distinguished, and
leaking valves are not named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
from pydantic import model_validator

from spacerobot.common.section import quantity
from spacerobot.dynamics import Inertias, forward_kinematics, momentum
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.momentum import subtree
from spacerobot.elements.actuators.momentum_residual import (
    Momenta,
    measured_velocity,
    sampled_residual,
)
from spacerobot.elements.core.clock import Clock
from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.contribution import Contribution, Output, memory
from spacerobot.elements.core.event import Event, both, negated
from spacerobot.elements.core.failure import ResidualTest, detected_failures, detection

SETTLED = 4.0
"""Time, in units of the lag's time constant, after which a residual is compared with the failure
hypotheses."""
MODES = {"shut": 0.0, "open": 1.0}
"""Failure modes to distinguish, with the fraction of thrust that the valve then gives."""


class ThrusterDetection(ResidualTest):
    """Detection of failed thrusters, which the allocation then leaves out; the robot must hold no object."""

    velocity_noise: float = quantity(
        "m/s", "standard deviation of a sample of the base's velocity", default=0.0, ge=0
    )
    joint_noise: float = quantity(
        "rad/s or m/s", "standard deviation of a sample of a joint's rate", default=0.0, ge=0
    )
    force_allowance: float = quantity(
        "N", "residual force that errors of the model may cause, on top of noise", default=0.0, ge=0
    )
    torque_allowance: float = quantity(
        "N m", "residual torque that errors of the model may cause, on top of noise", default=0.0, ge=0
    )

    @model_validator(mode="after")
    def _check(self) -> ThrusterDetection:
        for noise, allowance in (("velocity_noise", "force_allowance"), ("spin_noise", "torque_allowance")):
            if not getattr(self, noise) and not getattr(self, allowance):
                raise ValueError(f"{allowance}: found 0, allowed: above 0 without {noise}")
        return self


@dataclass(frozen=True)
class ThrusterTest:
    """Test of n thrusters of a base.

    Attributes:
        config, actuator: The section, and the thrusters' context.
        names: Names of the thrusters in the results.
        full: Wrenches at full thrust (k x n), of the components that move the base, root link's axes.
        rows: Indices of these components in a wrench (6,).
    """

    config: ThrusterDetection
    actuator: ActuatorContext
    names: Sequence[str]
    full: ca.SX
    rows: Sequence[int]

    def switches(self, mode: str) -> list[ca.SX]:
        """Switches (1x1) of thrusters that were found shut or open."""
        return [self.actuator.context.switch(f"{mode}.{i}") for i in range(len(self.names))]

    def contribution(self, parts: ca.SX) -> Contribution:
        """Residuals and detection events for commanded fractions of thrust (n x 1)."""
        actuator, count, size = self.actuator, len(self.names), len(self.rows)
        context = actuator.context.at(f"{actuator.context.path}.detection")
        name = f"{actuator.robot}/{actuator.context.path.rpartition('.')[2]}"
        # The commanded fractions behind the same lag are the residual of momenta that are zero.
        effort = ca.densify(ca.vertcat(ca.mtimes(self.full, parts), -parts))
        kinds = ["force_allowance" if row < 3 else "torque_allowance" for row in self.rows]
        allowance = ca.vertcat(*(context.number(kind) for kind in kinds))
        test = sampled_residual(self.config, context, f"{name}.detection", effort, self._momenta, allowance)
        residual, lagged, limit = test.values[:size], test.values[size:], test.threshold

        def excess(difference: ca.SX) -> ca.SX:
            return ca.mmax(ca.fabs(difference) / limit) - 1

        detected, events = context.switch("found"), list[Event]()
        beyond, over = excess(residual), memory(f"{name}.detection.over", ca.SX.zeros(1))
        (sampled,) = test.events
        counted = ca.if_else(beyond > 0, over.symbol + 1, 0)
        sampled = replace(sampled, updates={**sampled.updates, over.name: counted})
        settled = over.symbol * context.steady("period") * context.number("bandwidth") / SETTLED - 1
        events.append(detection(f"{name}.detected", name, beyond, detected))
        missed = {
            (mode, i): (part - lagged[i]) * self.full[:, i]
            for mode, part in MODES.items()
            for i in range(count)
        }
        excesses = {key: excess(residual - wrench) for key, wrench in missed.items()}
        for (mode, i), wrench in missed.items():
            switches = [self.switches(each)[i] for each in MODES]
            alternatives = [value for key, value in excesses.items() if key != (mode, i)]
            guard = ca.fmin(settled, -excesses[mode, i])
            for alternative in [beyond, *alternatives]:
                guard = ca.fmin(guard, alternative)
            sets = {self.switches(mode)[i].name(): True, detected.name(): True}
            new_residual = ca.densify(ca.vertcat(residual - wrench, lagged))
            updates = {f"{name}.detection.residual": new_residual, over.name: ca.SX.zeros(1)}
            who, armed = self.names[i], both(*(negated(switch) for switch in switches))
            events.append(Event(f"{who}.{mode}", "detected", who, guard, armed, sets, updates, onboard=True))
        residual_wrench = ca.SX(6, 1)
        residual_wrench[self.rows] = residual
        text = "missing in the rate of the robot's momentum, root link's axes"
        switches = [switch for mode in MODES for switch in self.switches(mode)]
        total = ca.fmax(detected, sum(switches[1:], switches[0]))
        outputs = (
            Output(
                "thruster_residual_force", residual_wrench[:3], "N", f"force {text}", "body", actuator.robot
            ),
            Output(
                "thruster_residual_torque",
                residual_wrench[3:],
                "N m",
                f"torque {text}",
                "body",
                actuator.robot,
            ),
            detected_failures(total, actuator.robot),
        )
        return Contribution(states=(*test.states, over), events=(sampled, *events), outputs=outputs)

    def _momenta(self, clock: Clock) -> Momenta:
        """Momenta and their known rates; the model is the scenario's nominal one."""
        actuator, plant = self.actuator, self.actuator.plant
        context = actuator.context.at(f"{actuator.context.path}.detection")
        name = f"{actuator.robot}/{actuator.context.path.rpartition('.')[2]}.detection"
        velocity, numbers = measured_velocity(actuator, context, name, self.config.period, clock)
        model, joint = plant.model, actuator.base_joint
        moving = forward_kinematics(model, plant.q, velocity)
        turn = plant.placement(actuator.base_frame)[0].T
        push, spun = momentum(
            model, moving, Inertias.from_model(model), subtree(model, joint), moving.origin[joint]
        )
        spin, point = moving.angular_velocity[joint], moving.linear_velocity[joint]
        push, spun = ca.mtimes(turn, push), ca.mtimes(turn, spun + actuator.stored)
        spin, point = ca.mtimes(turn, spin), ca.mtimes(turn, point)
        rate = ca.vertcat(-cross(spin, push), -cross(spin, spun) - cross(point, push))
        none = ca.SX.zeros(len(self.names))
        rows = list(self.rows)
        momenta = ca.densify(ca.vertcat(ca.vertcat(push, spun)[rows], none))
        return momenta, ca.densify(ca.vertcat(rate[rows], none)), numbers
