r"""Hybrid force and position control of a tip's translation or rotation.

Along each axis a selection $s$ between 0 and 1 divides the tip's acceleration between position and force
(Raibert and Craig 1981; by accelerations as Khatib 1987), $S = A\, \mathrm{diag}(s)\, A^\top$:

$$ a = \ddot x_\text{ref}
   + (1 - S) \left( k_d (\dot x_\text{ref} - \dot x) + k_p (x_\text{ref} - x) \right)
   + S \left( k_v (\dot x_\text{ref} - \dot x) + k_f e + k_i \int S e\, \mathrm{d}t \right),
   \qquad e = A f_\text{set} + \hat f, $$

$$ u = \Lambda^* (a - \gamma - W \hat f), \qquad \tau = J^{*\top} u, $$

with the setpoint $f_\text{set}$ of the force of the tip on its environment, and the measured wrench $\hat f$
of the environment on the tip, which is the opposite of it in equilibrium. The base reacts
(:mod:`spacerobot.elements.controllers.operational_space`). Of the rotation the same holds with the rotation
vector to the reference and the couple about the tip's origin. Without contact the force error accelerates the
tip up to the speed $(k_f e + k_i \int e) / k_v$, and its integral grows: select force where there is contact,
by phases.
"""

from __future__ import annotations

from typing import Annotated, Literal

import casadi as ca
from pydantic import Field

from spacerobot.common.section import Vector, quantity
from spacerobot.elements.controllers.compliance import (
    Axes,
    ComplianceController,
    gains_of,
    listed,
    read_pose_error,
    read_rate_error,
    reference_acceleration,
)
from spacerobot.elements.controllers.operational_space import accelerating
from spacerobot.elements.core.context import TipContext
from spacerobot.elements.core.contribution import Contribution, State
from spacerobot.elements.core.registry import register

Share = Annotated[float, Field(ge=0, le=1)]


@register
class HybridForce(ComplianceController):
    """Force along the selected axes by PI, position along the others, by the generalized Jacobian.

    Under a name that begins with ``orientation`` it controls the tip's rotation.
    """

    kind: Literal["hybrid_force"] = "hybrid_force"
    selection: tuple[Share, Share, Share] = quantity(
        "1", "of each of the axes: 1 controls force, 0 position", default=(0.0, 0.0, 1.0)
    )
    force: Vector = quantity(
        "N",
        "setpoint of the tip on its environment along each of the axes",
        rotation="N m",
        default=(0.0, 0.0, 0.0),
    )
    axes: Axes = Field(
        default="world", description="axes of selection and force: those of the world or of the reference"
    )
    kp: float = quantity("1/s^2", "proportional gain of position", default=100.0, ge=0)
    kd: float = quantity("1/s", "gain of velocity along position axes", default=20.0, ge=0)
    force_gain: float = quantity(
        "1/kg", "proportional gain of force", rotation="1/(kg m^2)", default=0.1, ge=0
    )
    force_integral: float = quantity(
        "1/(kg s)", "integral gain of force", rotation="1/(kg m^2 s)", default=0.0, ge=0
    )
    force_damping: float = quantity("1/s", "gain of velocity along force axes", default=20.0, ge=0)

    def build(self, tip: TipContext) -> Contribution:
        """Channel, and the integral of the force error."""
        motion, plant, number = self.controls(tip.key), tip.plant, tip.context.number
        turns = motion == "rotation"
        axes = list(plant.rotation_axes if turns else plant.translation_axes)
        wrench = tip.measured_wrench()
        by_force = gains_of(tip, "selection", self.axes)
        setpoint = ca.vertcat(*(number(f"force.{i}") for i in range(3)))
        if self.axes == "reference":
            setpoint = ca.mtimes(tip.motion.rotation, setpoint)
        error = ca.mtimes(by_force, setpoint + wrench[3 * turns : 3 * turns + 3])
        name, integral = f"{tip.label}/{tip.key}", ca.SX(3, 1)
        symbol = ca.SX.sym(f"{name}.integral", len(axes))
        integral[axes] = symbol
        offset, rate = read_pose_error(tip, turns=turns), read_rate_error(tip, turns=turns)
        position = number("kd") * rate + number("kp") * offset
        pushing = number("force_damping") * ca.mtimes(by_force, rate)
        integrated = ca.mtimes(by_force, integral)
        desired = (
            reference_acceleration(tip, turns=turns)
            + position
            - ca.mtimes(by_force, position)
            + pushing
            + number("force_gain") * error
            + number("force_integral") * integrated
        )
        state = State(f"{name}.integral", symbol, ca.SX.zeros(len(axes)), error[axes])
        return Contribution(states=(state,), channels=(accelerating(tip, motion, desired, wrench),))

    def assumptions(self) -> list[str]:
        """Effects that its model neglects."""
        return ["hybrid force control by the robot's model; knows the robot's inertia, not that of an object"]

    def words(self) -> str:
        """Selection and setpoint, in text form."""
        return f"hybrid force, selection {listed(self.selection)}, force {listed(self.force)}"
