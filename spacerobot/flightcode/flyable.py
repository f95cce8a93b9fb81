"""Scenes that can be exported as flight code: checks, and plans as inputs."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

from spacerobot.elements import RobotController, TipController
from spacerobot.scenario import Robot
from spacerobot.scene import Scene
from spacerobot.updates import UpdatedScene


def flyable(scene: Scene) -> Scene:
    """Return the scene if flight code can fly it.

    Raises:
        ScenarioError: If a controller is a Python function, or the engine is not ``casadi``.
    """
    if scene.scenario.simulation.engine != "casadi":
        raise scene.error("found pinocchio, allowed with a controller: casadi", "simulation.engine")
    for path, controller in controllers(scene):
        if isinstance(controller, RobotController) and controller.update_scheme and not controller.replanning:
            raise scene.error(
                f"found kind {controller.kind}, a Python function; allowed for flight code: laws that are "
                "expressions",
                path,
            )
    return scene


def prepared_scene(scene: Scene) -> Scene:
    """Scene with placeholders for plans that are made in flight, if there are any.

    See :func:`flyable` for errors.
    """
    updated = UpdatedScene.of(flyable(scene))
    return scene if updated is None else updated.scene


def plans(scene: Scene) -> dict[str, Sequence[str]]:
    """Parameters that uploaded plans replace: their dotted paths, by the name of the table."""
    plans = dict[str, Sequence[str]]()
    for path, controller in controllers(scene):
        if isinstance(controller, RobotController) and controller.replanning is not None:
            plans[f"{path}.begin"] = [f"{path}.begin"]
            for key, (rows, columns) in controller.replanning.tables.items():
                cells = itertools.product(range(rows), range(columns))
                plans[f"{path}.{key.removeprefix('knots.')}"] = [f"{path}.{key}.{k}.{j}" for k, j in cells]
    return plans


def controllers(scene: Scene) -> Iterator[tuple[str, TipController | RobotController]]:
    """Controllers by dotted path."""
    for tip in scene.tips:
        yield from ((f"{tip.path}.{key}", controller) for key, controller in tip.config.elements())
    for body in scene.robots:
        if isinstance(body.config, Robot):
            for key, controller in body.config.elements():
                yield f"{body.path}.{key}", controller
