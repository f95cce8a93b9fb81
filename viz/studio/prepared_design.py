"""Scene prepared for the studio, so that a rollout of a design with the same structure takes milliseconds.

A compiler, if installed, works in the background; until it has finished, rollouts are interpreted.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from optim.problem.varied_parameters import PLACES
from spacerobot.closedloop import ClosedLoop
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.common.section import is_number, leaves, numbers
from spacerobot.elements.core.registry import FAMILIES, kinds
from spacerobot.result import Result
from spacerobot.rollout import Trajectory
from spacerobot.scenario.load import to_document
from spacerobot.scenario.paths import get
from spacerobot.scene import Scene, build_scene, load_scene
from spacerobot.simulation import PreparedSimulation, prepare_simulation
from viz.drawing.motion import SceneGeometry
from viz.page.animation import AnimatedResult, look_at
from viz.studio.metrics import Metric, Metrics, build_metrics
from viz.studio.parameters import Leaf, find_leaves
from viz.studio.supported import check_supported

Values = Mapping[str, Any]
"""Design: differences from the scenario, by dotted path."""

Tell = Callable[[str], None]

MOST_KEPT = 4
"""Maximum number of prepared structures, so that designs of different structures can be compared."""


@dataclass(frozen=True, eq=False)
class PreparedDesign:
    """Prepared structure of designs.

    Attributes:
        scene: Scene with the structural changes of the designs.
        ready: Rollout of the structure, ready for simulation.
        metrics: Metrics of a rollout.
        varied: Paths of numbers that are parameters by request only: exact zeros, inertias.
    """

    scene: Scene
    ready: PreparedSimulation
    metrics: Metrics
    varied: frozenset[str]

    @property
    def loop(self) -> ClosedLoop:
        """Closed loop of the structure."""
        return self.ready.loop

    @cached_property
    def leaves(self) -> dict[str, Leaf]:
        """Parameters that can be changed, by dotted path."""
        return find_leaves(self.scene)

    @cached_property
    def free(self) -> frozenset[str]:
        """Paths of the numbers that can change without another compilation."""
        return self.varied | {
            path for path in self.loop.parameter_paths if _link(path) is None and path in self.leaves
        }

    def roll(self, scene: Scene, numbers: Mapping[str, float]) -> tuple[Result, Trajectory]:
        """One rollout; ``scene`` is the one that is drawn.

        Raises:
            DivergedError: If no part of the rollout can be used.
        """
        return self.ready.simulate(scene, numbers)

    def drawn(self, numbers: Mapping[str, float]) -> Scene:
        """Scene of a rollout for pictures and the ledger; rebuilt if masses or pads differ.

        Raises:
            ScenarioError: If the masses are physically impossible.
        """
        shape_numbers = {
            path: value for path, value in numbers.items() if ".links." in path or path[:5] == "pads."
        }
        return (
            build_scene(self.scene.scenario, shape_numbers, source=self.scene.source)
            if shape_numbers
            else self.scene
        )

    @property
    def chosen_step(self) -> float | None:
        """Step [s] that was chosen automatically; None if the scenario states it."""
        rollout = self.ready.rollout
        return None if rollout.choice is None else rollout.choice.step_s

    @property
    def nominal(self) -> dict[str, float]:
        """The structure's own numbers, by path."""
        return dict(zip(self.loop.parameter_paths, map(float, self.loop.parameter_values), strict=True))

    def cost(self, numbers: Mapping[str, float], metric: Metric) -> float | None:
        """Value of a metric without the result's other data; None if the rollout diverged."""
        return _finite(metric.factor * self.ready.rollout.run(numbers).costs[metric.key])

    @property
    def has_gradients(self) -> bool:
        """Whether gradients are compiled."""
        return "_wrt" in self.__dict__

    def prepare_gradients(self) -> None:
        """Compile the gradients by all numbers that can change."""
        rollout = self.ready.rollout
        rollout.engines.adjoint(tuple(rollout.indices(sorted(self.free))), many=False)
        _ = self._wrt

    @cached_property
    def _wrt(self) -> tuple[str, ...]:
        return tuple(sorted(self.free))

    def gradient(
        self, numbers: Mapping[str, float], metric: Metric, shown: Collection[str] | None = None
    ) -> tuple[float | None, dict[str, float | None], str]:
        """A metric, its derivatives by path, and whether those by ``shown`` paths are exact (all if None)."""
        evaluation = self.ready.rollout.value_and_gradient(
            numbers, wrt=self._wrt, costs=[metric.key], compared=shown
        )
        slopes = (_finite(metric.factor * slope) for slope in evaluation.gradients[metric.key])
        value = _finite(metric.factor * float(evaluation.costs[metric.key]))
        return value, dict(zip(self._wrt, slopes, strict=True)), evaluation.status[0]

    def look(self, scene: Scene, result: Result) -> AnimatedResult:
        """Animation data of a rollout; ``scene`` is the one that was drawn."""
        return look_at(result, scene.scenario.name, scene, self.stage(scene))

    def stage(self, scene: Scene) -> SceneGeometry:
        """Moving geometry of a scene; with other pads it has other shapes."""
        return self._stage if scene.scenario.pads == self.scene.scenario.pads else SceneGeometry.of(scene)

    @cached_property
    def _stage(self) -> SceneGeometry:
        return SceneGeometry.of(self.scene)


@dataclass(frozen=True)
class Origin:
    """Origin of designs: a scene, and its name on the command line.

    Attributes:
        scene: The scene.
        name: File or name of the scenario; None for a scene that was not loaded.
        changes_at_load: Changes with which it was loaded.
    """

    scene: Scene
    name: str | None = None
    changes_at_load: tuple[tuple[str, Any], ...] = ()

    def build(self, changes: Mapping[str, Any]) -> Scene:
        """The scene with further changes, as the command line would load it.

        Raises:
            ScenarioError, DescriptionError: If it cannot be simulated.
        """
        if self.name is None:
            return build_scene(self.scene.scenario, changes, source=self.scene.source)
        return load_scene(self.name, [*self.changes_at_load, *changes.items()])


class DesignCache:
    """Prepared structures of a scene, built on first use.

    Args:
        origin: Scene from which designs differ.
        tell: Called with a message before a long step, and with an empty text after it.
    """

    def __init__(self, origin: Origin, tell: Tell = lambda _: None) -> None:
        self.origin = origin
        self._tell = tell
        self._document = to_document(origin.scene.scenario)
        self._numbers = dict(numbers(self._document))
        self._kept: dict[str, PreparedDesign] = {}
        self._fixed: set[str] = set()
        self._free: frozenset[str] = frozenset()
        self.base = self.make({})
        self._free = self.base.free

    def find(self, values: Values) -> tuple[PreparedDesign, dict[str, float]] | None:
        """Compiled structure for a design, and the design's numbers by path; None if it is not compiled yet.

        Raises:
            ScenarioError: If a value is not allowed at its path.
        """
        inner, others, asked = self._split(values)
        plant = self._kept.get(_key(others, asked))
        if plant is None:
            return None
        for path, value in inner.items():
            if path in plant.leaves:
                plant.leaves[path].check(value)
        return plant, inner

    def make(self, values: Values) -> PreparedDesign:
        """Prepare the structure of a design.

        Raises:
            ScenarioError, DescriptionError: If the design is not valid.
            DivergedError: If no step keeps to the tolerance.
        """
        self._tell("building the closed loop")
        try:
            _, others, asked = self._split(values)
            try:
                plant = self._made(others, asked)
            except UnknownParameterError:
                self._fixed.update(asked)
                _, others, asked = self._split(values)
                plant = self._made(others, asked)
        finally:
            self._tell("")
        self._kept[_key(others, asked)] = plant
        if len(self._kept) > MOST_KEPT:
            del self._kept[next(key for key, plant_kept in self._kept.items() if plant_kept is not self.base)]
        return plant

    def changes(self, values: Values) -> dict[str, Any]:
        """Changes of the scenario for values of the page; a new kind keeps the entries that it also has.

        Raises:
            ScenarioError: If a path is a pattern, a URDF is one that a page may not name, or there is no such
                kind.
        """
        changes = {}
        for path, value in values.items():
            # no place beyond one of the scenario, and no file that is not beside it
            if "*" in path:
                raise ScenarioError("a pattern, which is for the command line alone", where=path)
            for place, text in leaves(value, path):
                file = str(text)
                if place.rpartition(".")[2] == "urdf" and (
                    Path(file).is_absolute() or PureWindowsPath(file).anchor or ".." in file or ":" in file
                ):
                    allowed = "a URDF that ships, or is in the scenario's folder"
                    raise ScenarioError(f"found {file!r}, allowed on a page: {allowed}", where=place)
            head, _, key = path.rpartition(".")
            section = None
            if key == "kind":
                with suppress(ScenarioError):  # there may be no such section
                    section = get(self._document, head)
            if not isinstance(section, dict) or section.get("kind", value) == value:
                changes[path] = value
                continue
            # the section as one of another kind: keys that this does not know are left out
            families = (family for family in map(kinds, FAMILIES) if section["kind"] in family)
            family = next((family for family in families if value in list(family)), None)  # may be no name
            if family is None:
                raise ScenarioError(f"found {value!r}, which is no kind of this section", where=path)
            fields = family[value].model_fields
            changes[head] = {name: each for name, each in section.items() if name in fields} | {"kind": value}
        return changes

    def _split(self, values: Values) -> tuple[dict[str, float], dict[str, Any], list[str]]:
        """Values divided into parameters of the closed loop, other changes, and parameters to be requested.

        The last are paths of numbers that the closed loop has only if they are requested when it is built.
        """
        inner: dict[str, float] = {}
        others: dict[str, Any] = {}
        for path, value in self.changes(values).items():
            follows = path in self._numbers and path not in self._fixed and is_number(value)
            if follows and (path in self._free or path.partition(".")[0] in (*PLACES, "phases")):
                inner[path] = value
            else:
                others[path] = value
        return inner, others, sorted(path for path in inner if path not in self._free)

    def _made(self, others: Mapping[str, Any], asked: Sequence[str]) -> PreparedDesign:
        scene = self.origin.build(others) if others else self.origin.scene
        check_supported(scene.scenario)
        vary = set(asked) | {f"{link}.mass" for link in map(_link, asked) if link}
        try:
            loop = cached_closed_loop(scene, sorted(vary))
        except ScenarioError as fault:
            if asked:
                raise UnknownParameterError from fault
            raise
        metrics = build_metrics(loop, scene)
        ready = prepare_simulation(scene, loop, metrics.measures, self._tell, in_background=True)
        return PreparedDesign(scene, ready, metrics, frozenset(vary))


class UnknownParameterError(Exception):
    """Error for requested parameters on which the closed loop does not depend."""


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _key(others: Mapping[str, Any], paths: Sequence[str]) -> str:
    return json.dumps([others, paths])


def _link(path: str) -> str | None:
    """Path of the link whose inertia a path is part of."""
    head, separator, _ = path.partition(".inertia")
    return head if separator and ".links." in head else None
