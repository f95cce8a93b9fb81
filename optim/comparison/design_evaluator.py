"""Evaluation of all designs by one rollout: on the nominal plant and on plants with other parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from optim.problem.formulation import rollout_of
from optim.problem.objectives import OBJECTIVE, build_terms, extended_loop
from optim.problem.scene_recipe import changed_scene, tuning_of
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.common.arrays import Array
from spacerobot.rollout import Rollout
from spacerobot.scenario import Robustness
from spacerobot.scene import Scene, build_scene


@dataclass(frozen=True)
class DesignEvaluator:
    """Evaluator of designs, values by dotted path, on the nominal plant and on plants that deviate from it.

    Attributes:
        scene: The scene of one variant, with sensors whose offsets can be varied.
        rollout: Rollout of the closed loop without tied parameters.
        spread: Deviations of the other plants.
    """

    scene: Scene
    rollout: Rollout
    spread: Robustness
    threads: int | None = None

    def nominal(self, design: Mapping[str, float]) -> dict[str, Array]:
        """Objective () and measures (n,) of a design; an empty design has the scenario's values."""
        nothing = {self.rollout.loop.parameter_paths[0]: self.rollout.values()[:1]}
        measures = self._roll(design, nothing)
        return {name: values[0] for name, values in measures.items()}

    def varied(self, design: Mapping[str, float]) -> dict[str, Array]:
        """Objective (N,) and measures (N, n) of a design on the plants."""
        return self._roll(design, self.plants)

    @cached_property
    def plants(self) -> dict[str, Array]:
        """Values (N,) of the numbers that differ between the plants, by dotted path: a Latin hypercube."""
        from scipy.stats import qmc

        groups = _groups(self.scene, self.spread)
        nominal_values = dict(zip(self.rollout.loop.parameter_paths, self.rollout.values(), strict=True))
        draw = qmc.LatinHypercube(len(groups), rng=np.random.default_rng(self.spread.seed))
        sample = 2 * draw.random(self.spread.plants) - 1
        plant_values = {}
        for column, (prefixes, relative, absolute) in zip(sample.T, groups, strict=True):
            for path, value in nominal_values.items():
                if any(path == prefix or path.startswith(prefix + ".") for prefix in prefixes):
                    plant_values[path] = value * (1 + relative * column) + absolute * column
        return plant_values

    def _roll(self, design: Mapping[str, float], plants: Mapping[str, Array]) -> dict[str, Array]:
        count = len(next(iter(plants.values())))
        columns = [np.full(count, value) for value in design.values()] + list(plants.values())
        paths, rows = (*design, *plants), np.column_stack(columns)
        batch = self.rollout.batch(paths, rows, threads=self.threads)
        return {OBJECTIVE: batch.costs[OBJECTIVE], **batch.measures}


def build_design_evaluator(
    scene: Scene, *, variant: str | None = None, threads: int | None = None
) -> DesignEvaluator:
    """Evaluator of the designs of one variant.

    Args:
        scene, variant: See :func:`optim.problem.tuning_problem.build_problem`.
        threads: Number of threads of this process's rollouts; each usable core if None.
    """
    scene = changed_scene(scene, variant)
    robots = scene.scenario.robots
    missing: dict[str, object] = {
        f"robots.{name}.sensors": {} for name, robot in robots.items() if robot.sensors is None
    }
    scene = build_scene(scene.scenario, missing, source=scene.source) if missing else scene
    tuning = tuning_of(scene)
    variable = [path for prefixes, _, _ in _groups(scene, tuning.robustness) for path in prefixes]
    prefixes = tuple(f"{path}." for path in variable)
    parameter_paths = cached_closed_loop(scene).parameter_paths
    loop = cached_closed_loop(
        scene, vary=[path for path in parameter_paths if f"{path}.".startswith(prefixes)]
    )
    extended = extended_loop(loop, scene, tuning.objective)
    terms = build_terms(extended, scene, tuning.objective, tuning.constraints)
    return DesignEvaluator(scene, rollout_of(scene, extended, terms), tuning.robustness, threads)


def _groups(scene: Scene, spread: Robustness) -> list[tuple[list[str], float, float]]:
    """Groups of parameters with a common deviation: paths or prefixes, relative and absolute spread."""
    groups: list[tuple[list[str], float, float]] = []
    for body in scene.bodies:
        if body.path == "target":
            links = list(body.config.links)
            for what in ("mass", "inertia"):
                groups.append(([f"target.links.{n}.{what}" for n in links], spread.object, 0.0))
            continue
        groups += [([f"{body.path}.links.{n}.mass"], spread.links, 0.0) for n in body.config.links]
        groups.append(([f"{body.path}.sensors.tip_position.offset"], 0.0, spread.tip_position_offset))
        groups.append(([f"{body.path}.sensors.joint_rate.offset"], 0.0, spread.joint_rate_offset))
    groups += [([f"{grasp.path}.stiffness"], spread.grip, 0.0) for grasp in scene.grasps]
    return groups
