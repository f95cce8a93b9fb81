"""The main job: a scene in, a result out."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

from spacerobot.closedloop import ClosedLoop, build_closed_loop
from spacerobot.result import Result
from spacerobot.result.dataset import build_dataset
from spacerobot.result.summary import build_summary
from spacerobot.rollout import Trajectory, build_rollout
from spacerobot.scenario import Scenario, Simulation
from spacerobot.scene import Scene

Progress = Callable[[str], None]


def simulate(scene: Scene, *, backend: str = "auto", progress: Progress | None = None) -> Result:
    """Simulate a scene by the engine its scenario names.

    Parameters
    ----------
    scene
        What to simulate.
    backend
        ``auto``, ``compiled`` or ``interpreted``, for the ``casadi`` engine.
    progress
        Called with a few words whenever something that may take a while begins.

    Returns
    -------
    Result
        Also of a rollout that diverged, up to where it went; its summary's status says so.

    Raises
    ------
    CompileError
        If a compiled backend was asked for and there is none.
    """
    tell = progress or (lambda _: None)
    begin = time.perf_counter()
    tell("building the closed loop")
    loop = build_closed_loop(scene)
    built = time.perf_counter()
    scene, trajectory, ready = _run(scene, loop, backend, tell)
    done = time.perf_counter()
    data = build_dataset(scene, trajectory, loop.state_names)
    timing = {
        "closed_loop": built - begin,
        "compile_or_load": ready - built,
        "rollout": trajectory.wall_s,
        "total": done - begin,
    }
    return Result(scene.scenario, data, build_summary(scene, data, trajectory, timing))


def _run(scene: Scene, loop: ClosedLoop, backend: str, tell: Progress) -> tuple[Scene, Trajectory, float]:
    """Scene with the step that was taken, trajectory, and the time at which everything was ready."""
    simulation = scene.scenario.simulation
    if simulation.engine == "pinocchio":
        from spacerobot.pinocchio_engine import simulate as check

        tell("simulating with Pinocchio's own algorithms")
        ready = time.perf_counter()
        return scene, check(scene), ready
    if simulation.engine == "cvodes":
        from spacerobot.rollout.cvodes import integrate_cvodes

        tell("integrating with CVODES")
        ready = time.perf_counter()
        grid = {"duration_s": simulation.duration, "output_step_s": simulation.output_step}
        return scene, integrate_cvodes(loop, **grid, tolerance=simulation.tolerance), ready
    step = simulation.step
    if step is None:
        from spacerobot.rollout.step_choice import choose_step

        tell("choosing the step")
        step = choose_step(
            loop, duration_s=simulation.duration, tolerance=simulation.tolerance, backend=backend
        ).step_s
        scene = dataclasses.replace(scene, scenario=_with_step(scene.scenario, simulation, step))
    tell("compiling the closed loop, or finding it compiled")
    rollout = build_rollout(
        loop,
        duration_s=simulation.duration,
        step_s=step,
        output_step_s=simulation.output_step,
        backend=backend,  # type: ignore[arg-type]
    )
    ready = time.perf_counter()
    tell("rolling out")
    return scene, rollout.run(), ready


def _with_step(scenario: Scenario, simulation: Simulation, step: float) -> Scenario:
    return scenario.model_copy(update={"simulation": simulation.model_copy(update={"step": step})})
