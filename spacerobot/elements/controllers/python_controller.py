"""Controllers whose law is a Python function, called periodically; forces are held between calls.

A CasADi law is compiled, differentiated and evaluated for many simulations at once. A Python function can be
anything (a neural network, a compiled library, a solver), is called once for each simulation and instant, and
has no derivative.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt
from pydantic import Field

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.common.registry import required
from spacerobot.common.section import MAX_SAMPLES, quantity
from spacerobot.elements.controllers.controller import INPUT, RobotController
from spacerobot.elements.controllers.measurements import robot_values
from spacerobot.elements.core.context import RobotContext
from spacerobot.elements.core.contribution import CommandedTorque, Contribution, Output, memory
from spacerobot.elements.sensors.signals import SIGNALS

Measurements = Mapping[str, Array]
"""Measurements by name, each (n,)."""
Update = Callable[[float, Measurements], npt.ArrayLike]
"""Function of the time [s] and the measurements that returns the held forces (n,)."""


@dataclass(frozen=True)
class HeldForces:
    """Order of the forces that a controller holds.

    Attributes:
        robot: Name of the robot.
        joints: Names of its free joints; the first forces are theirs [N m or N].
        force, torque: Whether three forces [N] and three torques [N m] on the base follow, world axes.
    """

    robot: str
    joints: tuple[str, ...]
    force: bool = False
    torque: bool = False

    @property
    def size(self) -> int:
        """Number of forces."""
        return len(self.joints) + 3 * self.force + 3 * self.torque


class PythonController(RobotController):
    """A controller whose update is a Python function; gradients and searches refuse it.

    A subclass overrides :meth:`update`, or :meth:`updater` if it stores data from one update to the next.
    """

    period: float = quantity(
        "s", "time between two updates, the first at the start", default=0.1, gt=0, recurs=MAX_SAMPLES
    )
    sampled: None = Field(default=None, description="none: it is periodic by itself")
    held: bool = Field(default=False, description="none: filled in by the simulation")

    @property
    def update_scheme(self) -> str:
        """Python functions, one for each simulation."""
        return "spacerobot.updates.python:PythonScheme"

    @required(instead="updater")
    def update(self, t: float, measurements: Measurements) -> npt.ArrayLike:
        """Return the forces that are held from now on, in the order of :class:`HeldForces`.

        Args:
            t: Time [s].
            measurements: Measurements of :meth:`measured`, by name, each (n,).
        """
        raise NotImplementedError

    def updater(self, forces: HeldForces) -> Update:
        """Return the function that is called at each update; a new one for each simulation.

        Args:
            forces: Order of the forces that the function returns.
        """
        del forces
        return self.update

    def measured(self, robot: RobotContext) -> Mapping[str, ca.SX]:
        """Expressions (n x 1) of the function's measurements, by name.

        By default measured positions and rates of the joints, and measured position, rotation vector since
        the start, velocity and spin of a floating base, world axes.

        Args:
            robot: Robot in the controllers' view.
        """
        return {name: robot.read(name, value) for name, value in robot_values(robot).items()}

    def reads(self) -> set[str]:
        """Signals of the joints and the base."""
        base = {f"base_{signal}" for signal in ("position", "orientation", "velocity", "spin")}
        return {"joint_position", "joint_rate"} | base

    def forces(self, robot: str, joints: tuple[str, ...]) -> HeldForces:
        """Order of the held forces: joints, and the parts of the base's wrench that it commands.

        Args:
            robot, joints: Names of the robot and of its free joints.
        """
        return HeldForces(robot, joints, "force" in self.own_wrench, "torque" in self.own_wrench)

    def build(self, robot: RobotContext) -> Contribution:
        """Held forces as a state, and the measurements as outputs.

        Raises:
            ScenarioError: If the simulation does not call the function.
        """
        if not self.held:
            raise ScenarioError(
                f"kind {self.kind} is updated by a Python function, which has no gradient: simulations, "
                "batches and campaigns call it; gradients, searches and margins do not",
                where=robot.context.path,
            )
        forces = self.forces(robot.name, robot.joint_names)
        for key in self.numbers():
            robot.context.number(key)  # a parameter, so that simulations of a batch may differ in it
        state = memory(f"{robot.name}/{robot.key}.held", ca.SX.zeros(forces.size))
        torque = robot.torque(state.symbol[: len(forces.joints)])
        wrench, first = ca.SX(6, 1), len(forces.joints)
        for part, rows in ((forces.force, [0, 1, 2]), (forces.torque, [3, 4, 5])):
            if part:
                wrench[rows] = state.symbol[first : first + 3]
                first += 3
        on_base = ca.mtimes(robot.plant.jacobian(robot.base_frame).T, ca.sparsify(wrench))
        torque = CommandedTorque(robot.name, torque.value + on_base)
        return Contribution(states=(state,), torques=(torque,), outputs=tuple(self._inputs(robot)))

    def numbers(self) -> tuple[str, ...]:
        """Keys of the section's numbers."""
        return tuple(key for key, value in self if isinstance(value, float))

    def _inputs(self, robot: RobotContext) -> Iterator[Output]:
        for name, value in self.measured(robot).items():
            unit, text = SIGNALS.get(name, ("1", name.replace("_", " ")))
            variable = f"{robot.key}{INPUT}{name}"
            for i, component in enumerate(ca.vertsplit(ca.densify(value))):
                label = f"{robot.name}/{robot.joint_names[i] if name.startswith('joint_') else i}"
                text = f"read by {self.kind}: {text}" if i == 0 else text
                yield Output(variable, component, unit, text, f"{variable}_component", label)

    def words(self) -> str:
        """Period."""
        return f"{self.kind}, in Python every {self.period:g} s"


def checked_forces(values: npt.ArrayLike, forces: HeldForces) -> Array:
    """Held forces as an array (n,).

    Raises:
        ValueError: If the number of values is wrong.
    """
    array = np.asarray(values, dtype=float)
    if array.shape != (forces.size,):
        parts = [f"{len(forces.joints)} of joints"]
        parts += ["3 forces on the base"] * forces.force + ["3 torques on the base"] * forces.torque
        raise ValueError(f"returned shape {array.shape}, allowed: ({forces.size},), {', '.join(parts)}")
    return array
