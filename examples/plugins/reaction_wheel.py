"""An actuator of one's own: a reaction wheel that takes up the spin of its robot's base about one axis.

spacerobot run servicer --plugin reaction_wheel.py --set 'robots.*.actuators={yaw: {kind: reaction_wheel}}'
"""

from typing import Literal

import casadi as ca

import spacerobot as sr
from spacerobot.elements import (
    Actuator,
    ActuatorContext,
    Contribution,
    Output,
    PowerTerm,
    State,
    StoredMomentum,
    Vector,
    quantity,
)


@sr.register
class ReactionWheel(Actuator):
    """Reaction wheel on the robot's base, at rest relative to it at the start."""

    kind: Literal["reaction_wheel"] = "reaction_wheel"
    axis: Vector = quantity("1", "unit vector along its axis, root link's axes", default=(0.0, 0.0, 1.0))
    inertia: float = quantity("kg m^2", "about its axis, in addition to the URDF's", default=0.1, gt=0)
    gain: float = quantity("N m s/rad", "torque by the base's spin about the axis", default=5.0, ge=0)

    def build(self, actuator: ActuatorContext) -> Contribution:
        """The wheel's absolute angular momentum is a state; the motor presses on wheel and base alike."""
        name = f"{actuator.robot}/wheel.momentum"
        inertia, gain = actuator.context.number("inertia"), actuator.context.number("gain")
        rotation = actuator.plant.placement(actuator.base_frame)[0]
        axis = ca.mtimes(rotation, actuator.context.vector("axis"))
        spin = actuator.plant.velocity(actuator.base_frame)[1]
        momentum, about = ca.SX.sym(name), ca.dot(axis, spin)
        torque, speed = gain * about, momentum / inertia - about
        turning = ca.cross(spin, momentum * axis)  # the wheel's axis turns with the base
        text = "speed of reaction wheels relative to their bases"
        return Contribution(
            states=(State(name, momentum, inertia * about, torque),),
            wrenches=(actuator.on_base(torque=-torque * axis - turning),),
            stored=(StoredMomentum(actuator.robot, momentum * axis, momentum**2 / (2 * inertia)),),
            powers=(PowerTerm("actuator", torque * speed, "in"),),
            outputs=(Output("wheel_speed", speed, "rad/s", text, "body", actuator.robot),),
        )
