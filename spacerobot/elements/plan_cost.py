"""Costs: what a planned motion minimises, a weighted sum of terms."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

import casadi as ca
from pydantic import Field

from spacerobot.elements.element import Element
from spacerobot.elements.plan_instant import JointCoordinate, PlanInstant
from spacerobot.section import Vector, quantity

Factor = Annotated[float, Field(ge=0)]


class PlanCost(Element):
    """A term of the cost: an integrand over the motion, a function of its last instant, or its duration.

    In a scenario a number alone is its ``weight``, and the key is its kind where the section names none:
    ``torque: 0.05`` is ``torque: {kind: torque, weight: 0.05}``.

    Attributes
    ----------
    unit
        Unit of the value that is reported.
    reported
        Value that is reported for the term: the root mean square over the duration, the integral itself, or
        the square root of what the last instant costs.
    of
        What the expression is: an integrand over the motion, or the cost of its last instant; or the term is
        the duration itself, which has no expression.
    relative_to_start
        Whether the value is measured from where the base is at the start.
    weighs
        What of a scene the term is about, for the message where a scene has none.
    """

    family: ClassVar[str] = "plan_cost"
    short: ClassVar[str] = "weight"
    unit: ClassVar[str]
    reported: ClassVar[Literal["rms", "integral", "root"]] = "rms"
    of: ClassVar[Literal["motion", "end", "duration"]] = "motion"
    relative_to_start: ClassVar[bool] = False
    weighs: ClassVar[str] = "that it depends on"

    weight: float

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Integrand, or cost of the last instant, without the weight (1x1).

        Raises
        ------
        ScenarioError
            If it names what there is not.
        """
        raise NotImplementedError

    def magnitudes(self, instant: PlanInstant) -> ca.SX:
        """Driving forces whose magnitudes' sum is the integrand (n x 1), in the place of an expression.

        They are linear in what drives the robots. The search splits each into two parts, f = f+ - f- with
        f+ >= 0 and f- >= 0, whose sum is the magnitude where it is least.
        """
        del instant
        return ca.SX(0, 1)


class JointCost(PlanCost):
    """A term over the joints of all robots."""

    weighs: ClassVar[str] = "joints that are planned"

    joints: dict[str, Factor] = Field(
        default={},
        description="factor of the square by joint, robot/joint; `*` matches any letters, a full name "
        "wins over a pattern; 1 where none is given [1]",
    )

    def value(self, joint: JointCoordinate) -> ca.SX:
        """Quantity of a joint that is squared (1x1)."""
        raise NotImplementedError

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Sum of the squares."""
        factors = instant.by_joint(self.joints, "joints")
        found = ca.SX(0)
        for label, joint in instant.joint_states().items():
            found += factors.get(label, 1.0) * self.value(joint) ** 2
        return found


class AxesCost(PlanCost):
    """A term over vectors, such as forces on bases."""

    axes: tuple[Factor, Factor, Factor] = quantity(
        "1", "factor of the square along or about each axis x, y, z", default=(1.0, 1.0, 1.0)
    )

    def vectors(self, instant: PlanInstant) -> Iterator[ca.SX]:
        """Vectors that are squared (3x1 each)."""
        raise NotImplementedError

    def expression(self, instant: PlanInstant) -> ca.SX:
        """Sum of the squares."""
        return sum((weighted_square(one, self.axes) for one in self.vectors(instant)), ca.SX(0))


def weighted_square(vector: ca.SX, axes: Vector) -> ca.SX:
    """Sum of the squares of the entries of a vector (3x1), each with a factor."""
    if axes == (1.0, 1.0, 1.0):
        return ca.sumsqr(vector)
    return sum((factor * vector[k] ** 2 for k, factor in enumerate(axes)), ca.SX(0))


def weight(unit: str, description: str) -> Any:
    """Field ``weight`` of a cost.

    Parameters
    ----------
    unit
        Of the weight: one over that of the term.
    description
        What is weighed.
    """
    return quantity(unit, f"weight of {description}", ge=0)
