r"""Motors that drive joints through an elastic gear.

The rotor of a motor turns about an axis parallel to the joint's axis $a$, with the speed $s$ relative to the
link that carries it (the joint's parent), whose angular velocity is $\omega$. With the gear ratio $N$, the
deflection $p$ of the transmission, seen at the joint, and its torque $t$,

$$ \dot p = \frac{s}{N} - \dot q, \qquad t = K p + D \dot p. $$

The rotor's angular momentum about its axis is $h = J\,(s + a \cdot \omega)$, and

$$ \dot h = m - \frac{t}{N} - f(s), \qquad
   f(s) = \Bigl( C + S\,e^{-(s / s_S)^2} \Bigr) \frac{s}{\sqrt{s^2 + s_C^2}} + V s, $$

where $m$ is the torque of the motor, the command divided by $N$ up to its limits, and $f$ its Coulomb,
Stribeck and viscous friction.

The joint receives $t$. The parent link receives $-a \dot h - \omega \times a h$, so that angular momentum
is conserved. The rotor's energy is $J (s + a \cdot \omega)^2 / 2$, not only that of its own spin (M. W.
Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Sys. Meas. Control 109, 1987, neglects the
rest). A stiff joint therefore reflects the inertia $N^2 J$ on a fixed base, and a different one on a
floating base. The rate of the energy, that of the spring $K p^2 / 2$ included, is $m s - f s - D \dot p^2$.
The rotor's mass, and its inertia across its axis, are part of the parent link. For a prismatic joint $N$ is
in rad/m, as of a screw.

With the backlash $2 b$ the teeth touch at $p = b$ on one flank, and at $p = -b$ on the other. They press and
never pull:

$$ t = \max\bigl(K (p - b) + D \dot p,\ 0\bigr) \text{ if } p > b, \qquad t = 0 \text{ if } |p| \le b, $$

and correspondingly below. The damper of this dead zone cannot hold the flanks together (M. Nordin, P.-O.
Gutman, Controlling mechanical systems with backlash - a survey, Automatica 38, 2002). Each flank has a
switch, which events set: the torque begins at $p = b$ and ends at $t = 0$. The energy that is left in the
spring then is dissipated by the damper.

The torque-speed line of a direct-current motor at its maximum voltage limits the motor's torque by the stall
torque $M$ and the no-load speed $W$, and its current limits it further:

$$ -M \Bigl(1 + \frac{s}{W}\Bigr) \le m \le M \Bigl(1 - \frac{s}{W}\Bigr), \qquad |m| \le m_\text{max} $$
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, Literal, Self

import casadi as ca
from pydantic import Field, model_validator

from spacerobot.common.errors import near_names
from spacerobot.common.section import matching, quantity
from spacerobot.dynamics import Wrench
from spacerobot.dynamics.algebra import cross
from spacerobot.elements.actuators.actuator import Actuator
from spacerobot.elements.actuators.saturation import saturation_events
from spacerobot.elements.core.context import ActuatorContext
from spacerobot.elements.core.contribution import (
    ActuatorDrive,
    Contribution,
    MotorSide,
    Output,
    PowerTerm,
    State,
    StoredMomentum,
)
from spacerobot.elements.core.event import Event, negated
from spacerobot.elements.core.registry import register
from spacerobot.elements.core.robot_element import RobotProperties


@register
class Transmission(Actuator):
    """Joint motors with rotor inertia and friction, behind an elastic gear that may have backlash."""

    kind: Literal["transmission"] = "transmission"
    has_motors: ClassVar[bool] = True
    joints: str = Field(default="*", description="joint by name; `*` matches any letters")
    ratio: float = quantity("1 or rad/m", "turns of the rotor for one of the joint, N", default=1.0, gt=0)
    inertia: float = quantity("kg m^2", "of the rotor about its axis, J; in addition to the links'", gt=0)
    stiffness: float = quantity("N m/rad or N/m", "of the transmission, at the joint", gt=0)
    damping: float = quantity("N m s/rad or N s/m", "of the transmission, at the joint", default=0.0, ge=0)
    backlash: float = quantity(
        "rad or m", "play of the transmission at the joint, 2 b; it begins in the middle", default=0.0, ge=0
    )
    viscous: float = quantity("N m s/rad", "friction of the motor by its speed", default=0.0, ge=0)
    coulomb: float = quantity("N m", "friction of the motor that does not depend on speed", default=0.0, ge=0)
    coulomb_speed: float = quantity(
        "rad/s",
        "speed of the motor at which that friction has reached 1/sqrt(2) of its value",
        default=1.0,
        gt=0,
    )
    stribeck: float = quantity("N m", "friction at low speed beyond Coulomb friction", default=0.0, ge=0)
    stribeck_speed: float = quantity(
        "rad/s", "speed of the motor at which 1/e of it is left", default=5.0, gt=0
    )
    torque_limit: float | None = quantity("N m", "maximum torque of the motor", default=None, gt=0)
    no_load_speed: float | None = quantity(
        "rad/s",
        "speed of the motor at which it can no longer drive, W; unlimited if not given",
        default=None,
        gt=0,
    )
    stall_torque: float | None = quantity(
        "N m",
        "torque of the motor at rest, M, from which it falls linearly to zero at `no_load_speed`; "
        "`torque_limit` if not given",
        default=None,
        gt=0,
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.no_load_speed is None and self.stall_torque is not None:
            raise ValueError("stall_torque: it belongs to `no_load_speed`; give that too")
        if self.no_load_speed is not None and self.stall_torque is None and self.torque_limit is None:
            raise ValueError("no_load_speed: give `stall_torque` or `torque_limit` too")
        return self

    def build(self, actuator: ActuatorContext) -> Contribution:
        """The rotors' angular momenta and the deflections are states."""
        names = matching(tuple(actuator.columns), self.joints)
        if not names:
            return Contribution()
        context, plant = actuator.context, actuator.plant
        number = {key: context.number(key) for key in ("ratio", "inertia", "stiffness", "damping")}
        name, ratio = f"{actuator.robot}/{context.path.rpartition('.')[2]}", number["ratio"]
        columns = [actuator.columns[joint] for joint in names]
        kinematics = plant.kinematics
        joints = [
            next(candidate for candidate in kinematics.joints if candidate.idx_v == column)
            for column in columns
        ]
        joint_indices = [joint.index for joint in joints]
        axes = [
            kinematics.angular[j] if kinematics.angular[j].nnz() else kinematics.linear[j]
            for j in joint_indices
        ]
        spins = [kinematics.angular_velocity[joint.parent] for joint in joints]
        carried = ca.vertcat(*(ca.dot(axis, spin) for axis, spin in zip(axes, spins, strict=True)))
        size, rates = len(names), plant.v[columns]
        momentum, deflection = ca.SX.sym(f"{name}.momentum", size), ca.SX.sym(f"{name}.deflection", size)
        speed = momentum / number["inertia"] - carried
        twisting = speed / ratio - rates
        labels = [f"{actuator.robot}/{joint}" for joint in names]
        stretch, torque, teeth = self._gear(actuator, labels, deflection, twisting)
        # friction against the motors' motion (n x 1) [N m]
        once = {
            key: context.once(key, context.parameters.sparse(f"{context.path}.{key}"))
            for key in ("coulomb", "viscous", *(("stribeck",) if self.stribeck else ()))
        }
        coulomb, friction = once["coulomb"], once["viscous"] * speed
        if self.stribeck:
            coulomb = coulomb + once["stribeck"] * ca.exp(-((speed / context.number("stribeck_speed")) ** 2))
        if self.coulomb or self.stribeck:
            friction = friction + coulomb * speed / ca.sqrt(speed**2 + context.number("coulomb_speed") ** 2)

        def answer(command: ca.SX) -> Contribution:
            """States of motors and gears, and their reaction on the links that carry the motors."""
            # torques of the motors (n x 1), and relative excess over the limits (n x 1 each), by the
            # limit's
            motor_command = command / ratio
            context, drive_torque, beyond = actuator.context, motor_command, dict[str, ca.SX]()
            if self.no_load_speed is not None:
                stall = context.number("torque_limit" if self.stall_torque is None else "stall_torque")
                relative = speed / context.number("no_load_speed")
                drive_torque = ca.fmin(
                    ca.fmax(motor_command, -stall * (1 + relative)), stall * (1 - relative)
                )
                beyond["forward"] = motor_command / stall + relative - 1
                beyond["backward"] = -motor_command / stall - relative - 1
            if self.torque_limit is not None:
                limit = context.number("torque_limit")
                drive_torque = ca.fmin(ca.fmax(drive_torque, -limit), limit)
                beyond[""] = ca.fabs(motor_command) / limit - 1
            net = drive_torque - torque / ratio - friction
            wrenches = [
                Wrench(
                    joint.parent,
                    ca.SX(3, 1),
                    -axis * net[i] - cross(spin, axis * momentum[i]),
                    kinematics.origin[joint.index],
                )
                for i, (joint, axis, spin) in enumerate(zip(joints, axes, spins, strict=True))
            ]
            damped = number["damping"] * ca.dot(twisting, twisting)
            if teeth:
                damped = ca.dot(torque - number["stiffness"] * stretch, twisting)
            lost = ca.dot(friction, speed) + damped
            put_in = ca.dot(drive_torque, speed) - ca.dot(torque, rates)  # beside that of the joints' torques
            observations = {
                "motor_speed": (speed, "rad/s", "speed of motors that drive transmissions"),
                "motor_torque": (drive_torque, "N m", "torque of motors that drive transmissions"),
            }
            limits = (
                saturation_events(actuator, labels, over, side=side and f".{side}")
                for side, over in beyond.items()
            )
            return Contribution(
                states=(
                    State(f"{name}.momentum", momentum, number["inertia"] * (ratio * rates + carried), net),
                    State(f"{name}.deflection", deflection, ca.SX.zeros(size), twisting),
                ),
                wrenches=tuple(wrenches),
                energy=number["stiffness"] * ca.dot(stretch, stretch) / 2,
                powers=(PowerTerm("actuator", put_in, "in"), PowerTerm("transmission", lost)),
                outputs=tuple(
                    Output(key, value[i], unit, text, "motor", labels[i])
                    for key, (value, unit, text) in observations.items()
                    for i in range(size)
                ),
                events=(*teeth, *(event for events in limits for event in events)),
            )

        total_momentum = sum((axis * momentum[i] for i, axis in enumerate(axes)), ca.SX(3, 1))
        energy = ca.dot(momentum, momentum) / (2 * number["inertia"])
        drive = ActuatorDrive(tuple(columns), lambda _: torque, answer)
        return Contribution(
            drives=(drive,),
            stored=(StoredMomentum(actuator.robot, total_momentum, energy),),
            motors=tuple(
                MotorSide(column, deflection[i], speed[i] / ratio) for i, column in enumerate(columns)
            ),
        )

    def _gear(
        self, actuator: ActuatorContext, labels: list[str], deflection: ca.SX, twisting: ca.SX
    ) -> tuple[ca.SX, ca.SX, tuple[Event, ...]]:
        """Spring deflections and torques at the joints (n x 1 each), and events of gears with backlash."""
        context = actuator.context
        stiffness, damping = context.number("stiffness"), context.number("damping")
        if context.is_zero("backlash"):
            return deflection, stiffness * deflection + damping * twisting, ()
        half, torque, events = context.number("backlash") / 2, ca.SX(len(labels), 1), list[Event]()
        for i, label in enumerate(labels):
            for side, sign in (("forward", 1), ("backward", -1)):
                meshed, slack = (context.switch(f"{what}.{side}.{i}") for what in ("meshed", "slack"))
                deep = sign * deflection[i] - half
                press = stiffness * deep + sign * damping * twisting[i]
                torque[i] += sign * meshed * press
                bite = ca.fmin(deep, press / stiffness)
                on, off = {meshed.name(): True}, {meshed.name(): False}
                if not context.is_zero("damping"):
                    # flanks separate with the spring still compressed; the energy has a kink there
                    on, off = on | {slack.name(): False}, off | {slack.name(): True}
                    eased = Event(
                        f"{label}.eased.{side}",
                        "eased",
                        label,
                        -deep,
                        slack,
                        {slack.name(): False},
                        kink=True,
                    )
                    events.append(eased)
                for kind, guard, armed, sets in (
                    ("meshed", bite, negated(meshed), on),
                    ("separated", -bite, meshed, off),
                ):
                    events.append(Event(f"{label}.{kind}.{side}", kind, label, guard, armed, sets))
        stretch = ca.fmax(deflection - half, 0) + ca.fmin(deflection + half, 0)
        return stretch, torque, tuple(events)

    def faults(self, robot: RobotProperties) -> Iterable[tuple[str, str]]:
        """A pattern that no joint matches."""
        if not matching(robot.joints, self.joints):
            yield "joints", f"no joint {self.joints!r}; {near_names(self.joints, robot.joints)}"

    def assumptions(self) -> list[str]:
        """Mass properties of rotors that links include."""
        return ["mass of rotors, and their inertia across their axes, are part of the links that carry them"]

    def words(self) -> str:
        """Ratio, inertia and stiffness."""
        return (
            f"transmission of {self.joints}, ratio {self.ratio:g}, rotor {self.inertia:g} kg m^2, "
            f"stiffness {self.stiffness:g}"
        )
