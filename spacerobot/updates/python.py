"""Controllers whose update is a Python function, called once for each simulation."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.elements.controllers.controller import INPUT
from spacerobot.elements.controllers.python_controller import (
    HeldForces,
    PythonController,
    checked_forces,
)
from spacerobot.scene import Scene, build_scene
from spacerobot.updates.plant import SHORT, Inputs, Rows, UpdatedPlant


@dataclass(frozen=True)
class UpdatedController:
    """A controller whose update is a Python function.

    Attributes:
        path, key: Dotted path of the controller's section, and its last part.
        config: The section.
        forces: Names and order of the held forces.
    """

    path: str
    key: str
    config: PythonController
    forces: HeldForces


class PythonScheme:
    """Scheme of :class:`PythonController`; see :class:`spacerobot.updates.scheme.UpdateScheme`.

    Args:
        scene: Scene whose closed loop has states for the held forces.
        controllers: Its controllers with a Python function.
    """

    measures: ClassVar[Mapping[str, str]] = {}

    def __init__(self, scene: Scene, controllers: tuple[UpdatedController, ...]) -> None:
        self.scene, self.controllers = scene, controllers
        self.duration_s = scene.scenario.simulation.duration
        self.period_s = min(one.config.period for one in controllers)
        self.prediction_s = 0.0
        self.intervals = {f"the period of {one.path}": one.config.period for one in controllers}

    @classmethod
    def of(cls, scene: Scene, vary: Collection[str] = ()) -> Self:
        """See :class:`spacerobot.updates.scheme.UpdateScheme`."""
        del vary
        controllers, changes = list[UpdatedController](), dict[str, Any]()
        for body in scene.robots:
            joints = tuple(body.joint_name(scene.model, joint) for joint in body.driven_joints)
            for key, config in scene.scenario.robots[body.name].controllers.items():
                if isinstance(config, PythonController):
                    path, forces = f"{body.path}.controllers.{key}", config.forces(body.name, joints)
                    controllers.append(UpdatedController(path, key, config, forces))
                    changes[f"{path}.held"] = True
        prepared = build_scene(scene.scenario, changes, source=scene.source)
        return cls(prepared, tuple(controllers))

    @property
    def summary(self) -> str:
        """Kinds of the controllers and shortest period, in one line."""
        kinds = dict.fromkeys(one.config.kind for one in self.controllers)
        return f"Python updates of {', '.join(kinds)}, every {self.period_s:g} s"

    def check_batch(self) -> None:
        """See :class:`spacerobot.updates.scheme.UpdateScheme`."""

    def start(
        self, plant: UpdatedPlant, workers: int, backend: str, notify: Callable[[str], None]
    ) -> PythonUpdates:
        """See :class:`spacerobot.updates.scheme.UpdateScheme`."""
        del workers, backend, notify
        return PythonUpdates(self, plant)


class PythonUpdates:
    """Held forces of N simulations; see :class:`spacerobot.updates.scheme.Updates`.

    Args:
        scheme, plant: The scheme, and the simulations.
    """

    def __init__(self, scheme: PythonScheme, plant: UpdatedPlant) -> None:
        self.scheme, self.plant = scheme, plant
        count, places = len(plant.start), {path: i for i, path in enumerate(plant.loop.parameter_paths)}
        self.faults: list[SpaceRobotError | None] = [None] * count
        states = {name: 1 + i for i, name in enumerate(plant.loop.state_names)}
        # columns of each controller's held forces in ``start``: time, state, switches
        self._held = [
            [states[f"{one.forces.robot}/{one.key}.held[{i}]"] for i in range(one.forces.size)]
            for one in scheme.controllers
        ]
        # section of each controller in each simulation, with that simulation's parameters
        self._configs: list[list[PythonController]] = []
        for one in scheme.controllers:
            numbers = {
                key: plant.parameters[:, places[f"{one.path}.{key}"]]
                for key in one.config.numbers()
                if f"{one.path}.{key}" in places
            }
            self._configs.append(
                [
                    one.config.model_copy(update={key: float(column[row]) for key, column in numbers.items()})
                    for row in range(count)
                ]
            )
        self._functions = [
            [config.updater(one.forces) for config in configs]
            for one, configs in zip(scheme.controllers, self._configs, strict=True)
        ]
        # periods [s] and indices of the next updates (controllers, N)
        self._periods = np.array([[config.period for config in configs] for configs in self._configs])
        self._counts = np.zeros(self._periods.shape)

    @property
    def next(self) -> Array:
        """Time of the next update of each simulation (N,) [s]."""
        return np.asarray((self._counts * self._periods).min(axis=0))

    def update(self, rows: Rows) -> None:
        """See :class:`spacerobot.updates.scheme.Updates`.

        Raises:
            SpaceRobotError: If a function raises, or returns a wrong number of forces.
        """
        plant, times = self.plant, self._counts * self._periods
        inputs = [plant.inputs[row] for row in rows]
        if not all(inputs):  # at the start
            inputs = list(plant.roll(plant.parameters[rows], plant.start[rows], SHORT).inputs)
        for number, one in enumerate(self.scheme.controllers):
            for row, values in zip(rows, inputs, strict=True):
                t = float(times[number, row])
                if t > times[:, row].min():
                    continue
                try:
                    held = self._functions[number][row](t, self._measurements(one, values))
                    plant.start[row, self._held[number]] = checked_forces(held, one.forces)
                except SpaceRobotError:
                    raise
                except Exception as fault:
                    message = f"update at t = {t:g} s: {type(fault).__name__}: {fault}"
                    raise SpaceRobotError(message, source=self.scheme.scene.source, where=one.path) from fault
                self._counts[number, row] += 1

    def _measurements(self, controller: UpdatedController, inputs: Inputs) -> dict[str, Array]:
        """Measurements of a controller among the inputs of a simulation."""
        prefix, measurements = f"{controller.key}{INPUT}", dict[str, Array]()
        for variable in self.plant.variables:
            if variable.name.startswith(prefix) and variable.name in inputs:
                robots = [label.partition("/")[0] == controller.forces.robot for label in variable.labels]
                measurements[variable.name.removeprefix(prefix)] = np.ravel(inputs[variable.name])[robots]
        return {name: values for name, values in measurements.items() if values.size}

    def finish(self) -> None:
        """See :class:`spacerobot.updates.scheme.Updates`."""

    def summary(self) -> Mapping[str, Any]:
        """No entries."""
        return {}

    def measures(self) -> Mapping[str, Array]:
        """No statistics."""
        return {}
