"""Controllers: the signals that they read from a robot or a tip, and the torques that they command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from spacerobot.common.registry import required
from spacerobot.common.section import Section
from spacerobot.elements.core.context import RobotContext, TipContext
from spacerobot.elements.core.contribution import Contribution
from spacerobot.elements.core.element import Element
from spacerobot.elements.core.robot_element import RobotElement
from spacerobot.elements.core.sampling import SAMPLED, Sampling

INPUT = "_input_"
"""Infix in the names of outputs that are inputs of controllers with a Python update."""

MPC_INPUT = f"mpc{INPUT}"
"""Prefix in the names of outputs that are the measured or estimated initial states of MPC plans."""


class TipController(Element):
    """A controller of one tip."""

    family: ClassVar[str] = "tip_controller"
    by_phase: ClassVar[tuple[str, ...]] = ()
    """Keys of words that may differ by phase, beside numbers; the law reads them by ``context.chosen``."""

    sampled: Sampling | None = SAMPLED

    @required()
    def build(self, tip: TipContext) -> Contribution:
        """Contribution to the closed loop."""
        raise NotImplementedError

    def reads(self, key: str, siblings: Mapping[str, Section]) -> set[str]:
        """Names of the signals that it reads from sensors; none by default.

        Args:
            key, siblings: Key of the controller in the tip's section, and the other sections there, as in
                :class:`TipContext`.
        """
        del key, siblings
        return set()

    @property
    def feeds_back_joint_acceleration(self) -> bool:
        """Whether its law has the ideal derivative of joint rates."""
        return False

    def controls(self, key: str) -> Literal["translation", "rotation"] | None:
        """Motion of the tip that it removes from the null space of the robot's joints, if any."""
        del key
        return None


def named_motion(key: str) -> Literal["translation", "rotation"]:
    """Motion of a tip that the key of a controller names: rotation for ``controllers.orientation_soft``.

    Args:
        key: Key of the controller in the tip's section.
    """
    return "rotation" if key.rpartition(".")[2].startswith("orientation") else "translation"


@dataclass(frozen=True)
class Replanning:
    """In-flight replanning of the plan that a controller tracks.

    Attributes:
        period: Time between two plans [s].
        min_horizon: Minimum horizon of a plan [s].
        delay: Time from the measurement to the first use of the plan made from it [s].
        iterations: Maximum number of the solver's iterations for one plan.
        tables: Rows (points) and columns of the numbers that a plan replaces, by key in the section.
    """

    period: float
    min_horizon: float
    delay: float
    iterations: int
    tables: Mapping[str, tuple[int, int]] = field(default_factory=dict)


class RobotController(RobotElement):
    """A controller of all joints of a robot."""

    family: ClassVar[str] = "robot_controller"

    sampled: Sampling | None = SAMPLED

    @property
    def update_scheme(self) -> str | None:
        """Scheme by which Python updates it, ``module:Class``; None for a controller that is an expression.

        See :mod:`spacerobot.updates.scheme`.
        """
        return None

    @property
    def replanning(self) -> Replanning | None:
        """Replanning in flight (model predictive control); None for a controller without."""
        return None

    @required()
    def build(self, robot: RobotContext) -> Contribution:
        """Contribution to the closed loop."""
        raise NotImplementedError

    def reads(self) -> set[str]:
        """Signals that it reads from sensors."""
        return set()
