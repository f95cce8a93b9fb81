"""Result of a trajectory that another program has simulated step by step."""

from __future__ import annotations

from spacerobot.closedloop import ClosedLoop
from spacerobot.result.dataset import build_dataset
from spacerobot.result.events import build_events
from spacerobot.result.result import Result
from spacerobot.result.summary import build_summary
from spacerobot.rollout import Trajectory
from spacerobot.scene import Scene


def build_result(scene: Scene, loop: ClosedLoop, trajectory: Trajectory) -> Result:
    """Result of a trajectory; its timing contains only the rollout.

    Args:
        scene: Scene with the parameters of the trajectory.
        loop: Closed loop with the same parameters.
        trajectory: Trajectory of the rollout.
    """
    data, wall = build_dataset(scene, trajectory, loop), trajectory.wall_s
    timing = {"closed_loop": 0.0, "compile_or_load": 0.0, "rollout": wall, "total": wall}
    events = build_events(scene, loop, trajectory.events)
    return Result(scene.scenario, data, build_summary(scene, data, trajectory, timing, {}, events))
