r"""Feed-forward of the wrench that the object at a tip needs to follow the tip's reference.

$$ \tau = k\,J^\top \begin{bmatrix} f \\ n \end{bmatrix}, \qquad
   f = m a + \alpha \times m c + \omega \times (\omega \times m c), \qquad
   n = I \alpha + \omega \times I \omega + m c \times a $$

The spin $\omega$ and the accelerations $a$, $\alpha$ are those of the reference. The ten inertial parameters
(mass $m$, centre of mass $c$, inertia $I$ about the tip) are numbers of the section, or the present estimate
of an estimator. The torque is zero while nothing is held.
"""

from __future__ import annotations

from typing import Literal

import casadi as ca
from pydantic import model_validator

from spacerobot.common.errors import ScenarioError
from spacerobot.common.section import Vector, quantity
from spacerobot.dynamics.inertial_parameters import inertial_parameters, inertial_wrench
from spacerobot.elements.controllers.controller import TipController
from spacerobot.elements.core.context import TipContext
from spacerobot.elements.core.contribution import Contribution
from spacerobot.elements.core.registry import register

KEYS = ("mass", "com", "inertia")


@register
class PayloadFeedForward(TipController):
    """Feed-forward torques with which the object at the tip, given or identified, follows the reference."""

    kind: Literal["payload_feed_forward"] = "payload_feed_forward"
    feed_forward: float = quantity("1", "fraction that is commanded", default=1.0, ge=0)
    mass: float | None = quantity(
        "kg", "of the object; if not given, an inertia_filter of the tip estimates it", default=None, gt=0
    )
    com: Vector | None = quantity("m", "its centre of mass, axes of the tip", default=None)
    inertia: tuple[float, float, float, float, float, float] | None = quantity(
        "kg m^2", "its ixx, iyy, izz, ixy, ixz, iyz about it, axes of the tip", default=None
    )

    @model_validator(mode="after")
    def _check(self) -> PayloadFeedForward:
        keys = [key for key in KEYS if getattr(self, key) is not None]
        if keys and len(keys) < len(KEYS):
            raise ValueError(f"found {', '.join(keys)} alone, allowed: {', '.join(KEYS)}, or none of them")
        return self

    def build(self, tip: TipContext) -> Contribution:
        """Contribution: torques of the arm's joints.

        Raises:
            ScenarioError: If the object's inertial parameters are neither given nor estimated.
        """
        context, motion = tip.context, tip.motion
        if self.mass is not None:
            com, inertia = (
                ca.vertcat(*(context.number(f"{key}.{i}") for i in range(size)))
                for key, size in (("com", 3), ("inertia", 6))
            )
            parameters = inertial_parameters(context.number("mass"), com, inertia)
            parameters = context.once("held", context.constants.expanded(parameters))
        elif tip.held_inertia is not None:
            parameters = tip.held_inertia
        else:
            raise ScenarioError(
                "found neither mass, com and inertia nor an estimator of kind inertia_filter of "
                f"{tip.label}; give one of them",
                where=context.path,
            )
        axes = motion.rotation
        gravity = ca.SX(ca.DM(tip.plant.model.gravity.linear))
        wrench = inertial_wrench(
            context.number("feed_forward") * parameters,
            ca.mtimes(axes.T, motion.acceleration - gravity),
            ca.mtimes(axes.T, motion.angular_velocity),
            ca.mtimes(axes.T, motion.angular_acceleration),
        )
        return Contribution(torques=(tip.torque(*(ca.mtimes(axes, part) for part in wrench)),))

    def assumptions(self) -> list[str]:
        """Effects that the feed-forward neglects."""
        return ["feeds the object's motion forward as its reference has it, not the arm's own"]

    def words(self) -> str:
        """Source of the payload mass, for the user."""
        object_ = "the identified object" if self.mass is None else f"an object of {self.mass:g} kg"
        return f"payload_feed_forward {self.feed_forward:g} of {object_}"
