"""Assembly of a result from the trajectory of a rollout."""

from __future__ import annotations

from collections.abc import Mapping

from spacerobot.closedloop import ClosedLoop
from spacerobot.result.dataset import build_dataset
from spacerobot.result.events import build_events
from spacerobot.result.result import Result
from spacerobot.result.summary import build_summary
from spacerobot.rollout import Trajectory
from spacerobot.scene import Scene


def build_result(
    scene: Scene,
    loop: ClosedLoop,
    trajectory: Trajectory,
    timing: Mapping[str, float] | None = None,
    notes: Mapping[str, str] | None = None,
) -> Result:
    """Result of a trajectory, with every sample.

    Args:
        scene: Scene with the parameters of the trajectory.
        loop: Closed loop with the same parameters.
        trajectory: Trajectory of the rollout.
        timing: Wall times [s]; only that of the rollout if None.
        notes: Notes on the engine; none if None.
    """
    data, wall = build_dataset(scene, trajectory, loop), trajectory.wall_s
    timing = timing or {"closed_loop": 0.0, "compile_or_load": 0.0, "rollout": wall, "total": wall}
    events = build_events(scene, loop, trajectory.events)
    return Result(scene.scenario, data, build_summary(scene, data, trajectory, timing, notes or {}, events))
