"""Closed loops in which external commands replace the controllers of robots.

A command is a parameter that the dynamics use as one constant in c, so the integrating program may change it
at any time. Sensors measure all signals that the replaced controllers would read.
"""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import casadi as ca

from spacerobot.closedloop.build import assemble, evaluate, section_context
from spacerobot.closedloop.closed_loop import ClosedLoop
from spacerobot.closedloop.initial_state import initial_state
from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.closedloop.plant import build_plant
from spacerobot.common.section import numbers
from spacerobot.elements import CommandedTorque, Contribution
from spacerobot.scenario import Robot
from spacerobot.scenario.load import to_document
from spacerobot.scene import Scene, SceneBody
from spacerobot.symbolic import Parameters

COMMANDS = "commands"
"""First word of the paths of commands: ``commands.ROBOT.JOINT``, ``commands.ROBOT.base.tz``."""

PLANAR_AXES, SPATIAL_AXES = ("fx", "fy", "tz"), ("fx", "fy", "fz", "tx", "ty", "tz")
"""Components of the wrench on a base: forces along and torques about axes of its root link."""


@dataclass(frozen=True)
class CommandInput:
    """Generalized force that is commanded from outside.

    Attributes:
        path: Dotted path of its parameter.
        keys: Words of the path; a joint's name may contain dots.
        column: Index in v.
        unit, text: ``N m`` or ``N``, and description.
    """

    path: str
    keys: tuple[str, ...]
    column: int
    unit: str
    text: str


def build_commanded_loop(
    scene: Scene, robots: Collection[str], vary: Collection[str] = ()
) -> tuple[ClosedLoop, tuple[CommandInput, ...]]:
    """Closed loop of a scene in which commands replace the controllers of some robots.

    Args:
        scene: The scene.
        robots: Names of the robots whose controllers are omitted.
        vary: See :func:`build_closed_loop`.

    Returns:
        ClosedLoop: The loop; the commands are parameters with nominal value zero.
        tuple of CommandInput: Commands of each driven joint, and of each base that actuators or the omitted
            controllers act on.
    """
    possible = {
        command.path: command
        for body in scene.robots
        if body.name in robots
        for command in _commands(scene, body)
    }
    values = dict(numbers(to_document(scene.scenario))) | dict.fromkeys(possible, 0.0)
    parameters = Parameters(values, vary)
    context = section_context(scene, parameters)
    start = initial_state(scene, parameters)
    builder = CommandedLoopBuilder(scene, context, build_plant(scene, parameters, context.constants), start)
    builder.commands.update(possible)
    loop = assemble(builder, evaluate(builder))
    for path in vary:
        loop.index(path)
    return loop, tuple(command for path, command in possible.items() if path in loop.parameter_paths)


def _commands(scene: Scene, body: SceneBody) -> Iterator[CommandInput]:
    """Commands of a robot: for its driven joints, then for its base."""
    model, names = scene.model, {joint.name: joint for joint in body.description.joints}
    for joint in body.driven_joints:
        name = body.joint_name(model, joint)
        slides = str(names[name].kind) == "prismatic" if name in names else False
        unit, what = ("N", "force") if slides else ("N m", "torque")
        keys = (COMMANDS, body.name, name)
        yield CommandInput(
            ".".join(keys), keys, int(model.idx_vs[joint]), unit, f"commanded {what} of the joint"
        )
    if not body.root_joint:
        return
    first, count = int(model.idx_vs[body.root_joint]), int(model.nvs[body.root_joint])
    for i, axis in enumerate(PLANAR_AXES if count == 3 else SPATIAL_AXES):
        unit, what = ("N", "force along") if axis.startswith("f") else ("N m", "torque about")
        text = f"commanded {what} {axis[1]} of the base, axes of the root link"
        words = (COMMANDS, body.name, "base", axis)
        yield CommandInput(".".join(words), words, first + i, unit, text)


class CommandedLoopBuilder(LoopBuilder):
    """Builder of a closed loop in which commands replace the controllers of some robots."""

    @functools.cached_property
    def commands(self) -> dict[str, CommandInput]:
        """Commands that are possible, by path."""
        return {}

    @functools.cached_property
    def controllers(self) -> list[Contribution]:
        """Contributions of the remaining controllers, and of the commands.

        The replaced controllers are built as well, so that sensors measure the signals that they read.
        """
        by_robot = self._by_robot()
        commanded = {command.keys[1] for command in self.commands.values()}
        others = [part for name, parts in by_robot.items() if name not in commanded for part in parts]
        bodies = [body for body in self.scene.robots if body.name in commanded]
        return [*others, *(self._commanded(body, by_robot[body.name]) for body in bodies)]

    def _by_robot(self) -> Mapping[str, list[Contribution]]:
        """Contributions of the scenario's controllers, by robot."""
        names = [tip.body.name for tip in self.scene.tips for _ in tip.config.elements()]
        bodies = [body for body in self.scene.robots if isinstance(body.config, Robot)]
        for body in bodies:
            assert isinstance(body.config, Robot)
            names += [body.name for _ in body.config.elements()]
        by_robot: dict[str, list[Contribution]] = {body.name: [] for body in self.scene.robots}
        for name, part in zip(names, self.scenario_controllers(), strict=True):
            by_robot[name].append(part)
        return by_robot

    def _commanded(self, body: SceneBody, omitted: list[Contribution]) -> Contribution:
        """Commands of a robot, as one contribution."""
        drives = [drive for part in self.actuators(body) for drive in part.drives]
        acted = {column for drive in drives for column in drive.columns}
        for part in omitted:
            values = [*(one.value for one in part.torques), *(one.actuation for one in part.channels)]
            acted |= {row for value in values for row in value.sparsity().row()}
        joints = {int(self.plant.model.idx_vs[joint]) for joint in body.driven_joints}
        torque = ca.SX(self.plant.v.size1(), 1)
        for path, command in self.commands.items():
            if command.keys[1] == body.name and command.column in acted | joints:
                torque[command.column] = self.context.constants.hoist(path, self.context.parameters(path))
        return Contribution(torques=(CommandedTorque(body.name, torque),))
