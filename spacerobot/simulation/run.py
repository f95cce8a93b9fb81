"""Simulation of a scene."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

import numpy as np

from spacerobot.closedloop import ClosedLoop, find_fastest_rate
from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.closedloop.onboard_ports import OnboardLoopBuilder
from spacerobot.common.errors import DivergedError
from spacerobot.common.files import StrPath
from spacerobot.result import Result
from spacerobot.result.assembly import build_result
from spacerobot.result.dataset import build_dataset
from spacerobot.result.metrics import fastest_joint
from spacerobot.result.trust import fast_words
from spacerobot.rollout import (
    Measures,
    Rollout,
    TimeGrid,
    Trajectory,
    build_rollout,
)
from spacerobot.rollout.resumable_loop import resumed
from spacerobot.rollout.step_choice import NoStepError
from spacerobot.scene import Scene, build_scene
from spacerobot.scene.memory import check_size
from spacerobot.updates import UpdatedScene, run_updates
from spacerobot.updates.plant import CheckedPlant, SinglePlant

if TYPE_CHECKING:
    from spacerobot.flightcode.controller_library import OnboardController

Progress = Callable[[str], None]
LARGEST = 1e150
"""Maximum magnitude of states and outputs in results: the square still is finite."""

MOST_INSTANTS = 100_000
"""Number of steps up to which peaks are searched at every step."""

STEP_ERROR_LIMIT = 1e-5
"""Estimated error of a single step above which a warning is issued, relative to max(1, |state|)."""

REMEDY = (
    "for a stiff loop take softer gains and dampers; else give `simulation.step`, or a larger "
    "`simulation.tolerance`"
)
"""Advice if no step satisfies the tolerance."""

TOUCH_SHARE = 0.02
"""Proposed maximum step during a contact, relative to the duration of the contact."""

Backend = Literal["auto", "compiled", "interpreted"]


def simulate(
    scene: Scene,
    *,
    backend: Backend = "auto",
    progress: Progress | None = None,
    controller: StrPath | OnboardController | None = None,
) -> Result:
    """Simulate a scene with the engine of its scenario.

    Args:
        scene: The scene.
        backend: ``auto``, ``compiled`` or ``interpreted``, for the ``casadi`` engine.
        progress: Callback with a short text, called when a step that may take long begins.
        controller: Exported flight code that replaces the periodic controllers, estimators and detections: a
            shared library, or a link to a controller on other hardware. A library runs with the rights of
            this process.

    Returns:
        Result: Signals up to the end, or up to the time of divergence, as the summary's ``status`` states.

    Raises:
        CompileError: If a compiled backend is required and there is no compiler.
        DivergedError: If no sample is finite, no step satisfies the tolerance, or a grasp does not close.
        NoPlanError: If model predictive control finds no initial plan.
        ScenarioError: If the result exceeds the memory, the engine does not support the scenario, or a
            scheme cannot update its controllers in Python.
    """
    tell = progress or (lambda _: None)
    begin = time.perf_counter()
    check_size(scene)
    tell("building the closed loop")
    updated = UpdatedScene.of(scene if controller is None else _flyable(scene))
    prepared = scene if updated is None else updated.scene
    loop = cached_closed_loop(prepared, kind=LoopBuilder if controller is None else OnboardLoopBuilder)
    built = time.perf_counter()
    with np.errstate(over="ignore", invalid="ignore"):  # a rollout that diverges says so by its status
        simulation = scene.scenario.simulation
        flown = None
        if controller is not None:
            from spacerobot.flightcode.controller_library import loaded_controller

            flown = loaded_controller(controller, prepared, loop)
        if updated is not None:
            run = _updated(updated, loop, backend, tell, flown)
        elif simulation.engine == "pinocchio":
            from spacerobot.pinocchio_engine import simulate as check
            from spacerobot.pinocchio_engine.simulate import CHECKING_TOLERANCE, fired_events

            # the independent engine is slow and reports its progress
            tell(words := "simulating with Pinocchio's own algorithms")
            ready = time.perf_counter()
            local = simulation.tolerance * CHECKING_TOLERANCE
            checked = check(
                scene, rtol=local, atol=local / 10, progress=lambda part: tell(f"{words}: {part:.0%}")
            )
            run = _Run(scene, ready, dataclasses.replace(checked, events=fired_events(loop, checked)))
        else:
            rollout = _ready(scene, loop, tell, backend=backend, rollouts=1)
            tell("rolling out")
            run = _rolled(scene, rollout, {}, flown)
    return _result(run, loop, begin, built)


def simulate_designs(
    scene: Scene, loop: ClosedLoop, designs: Mapping[str, Mapping[str, float]]
) -> Iterator[tuple[str, Result]]:
    """Simulate a scene at several values of its parameters with one closed loop and the fixed-step engine.

    Each result equals that of :func:`simulate` for the scene with these values.

    Args:
        scene, loop: The scene, and a closed loop whose parameters include those of the designs.
        designs: Changed parameters by dotted path, for each design's name.

    Yields:
        Name and result of each design.

    Raises:
        DivergedError: As :func:`simulate`.
    """
    ready = prepare_simulation(scene, loop, rollouts=1)  # the same backend as in single simulations
    for name, design in designs.items():
        variant = build_scene(scene.scenario, design, source=scene.source)
        yield name, ready.simulate(variant, design)[0]


@dataclass(frozen=True)
class PreparedSimulation:
    """A scene with its closed loop and a rollout for any values of its parameters.

    Attributes:
        scene: The scene.
        loop: Closed loop of the scene.
        rollout: Fixed-step rollout of the closed loop.
    """

    scene: Scene
    loop: ClosedLoop
    rollout: Rollout

    def simulate(self, scene: Scene, design: Mapping[str, float]) -> tuple[Result, Trajectory]:
        """Simulate at other values of parameters.

        Args:
            scene: Scene with these values.
            design: Changed parameters by dotted path.

        Returns:
            tuple: The result, and the trajectory from which it was built.

        Raises:
            DivergedError: As :func:`simulate`.
        """
        begin = time.perf_counter()
        with np.errstate(over="ignore", invalid="ignore"):
            run = _rolled(scene, self.rollout, design)
        return _result(run, self.loop, begin, begin), run.trajectory


class SimulationRequest(TypedDict, total=False):
    """Arguments that :func:`prepare_simulation` passes to :func:`spacerobot.rollout.build_rollout`."""

    backend: Backend
    rollouts: float | None
    in_background: bool


def prepare_simulation(
    scene: Scene,
    loop: ClosedLoop,
    measures: Measures | None = None,
    progress: Progress | None = None,
    **request: Unpack[SimulationRequest],
) -> PreparedSimulation:
    """Prepare the fixed-step rollout of a scene's closed loop.

    Args:
        scene, loop: The scene, and its closed loop.
        measures: Integrals, peaks and final values that each rollout evaluates in addition.
        progress: As for :func:`simulate`.
        **request: See :class:`SimulationRequest`.

    Raises:
        DivergedError: If the scenario has no step and none satisfies the tolerance.
    """
    return PreparedSimulation(
        scene, loop, _ready(scene, loop, progress or (lambda _: None), measures, **request)
    )


def _result(run: _Run, loop: ClosedLoop, begin: float, built: float) -> Result:
    """Result of a run up to the last sample whose values are finite and at most LARGEST.

    Args:
        run, loop: The run, and its closed loop.
        begin, built: Times at which the simulation began and the closed loop was complete [s].
    """
    trajectory = run.trajectory
    parts = [trajectory.state, *trajectory.outputs.values()]
    if not all(np.abs(part).max(initial=0.0) <= LARGEST for part in parts):
        values = np.hstack(parts)
        with np.errstate(invalid="ignore"):
            bad = ~(np.abs(values) <= LARGEST)
        # outputs that are NaN at the start have no value by definition
        nothing = np.isnan(values[0])
        nothing[: trajectory.state.shape[1]] = False
        rows = np.flatnonzero((bad & ~nothing).any(axis=1))
        if rows.size:
            if rows[0] == 0:
                at = int(np.nanargmax(np.abs(trajectory.state[0])))
                worst = f"{loop.state_names[at]} = {trajectory.state[0, at]:.3g}"
                raise DivergedError(
                    f"the rollout diverged at the start, where {worst}: nothing could be kept"
                )
            good = slice(rows[0])
            trajectory = dataclasses.replace(
                trajectory,
                time=trajectory.time[good],
                state=trajectory.state[good],
                outputs={name: output[good] for name, output in trajectory.outputs.items()},
                status="diverged",
                diverged_at_s=float(trajectory.time[good][-1]),
            )
    done = time.perf_counter()
    timing = {
        "closed_loop": built - begin,
        "compile_or_load": run.ready - built,
        "rollout": trajectory.wall_s,
        "total": done - begin,
    }
    result = build_result(run.scene, loop, trajectory, timing, run.notes)
    result.summary.update(run.entries)  # type: ignore[typeddict-item]
    if run.every == 1:
        return result
    return dataclasses.replace(result, data=result.data.isel(time=slice(None, None, run.every)))


@dataclass(frozen=True)
class _Run:
    """A simulation that has been run.

    Attributes:
        scene: Scene with the step of the rollout.
        ready: Time at which the rollout was compiled or loaded [s].
        trajectory: Trajectory, with more samples than the result.
        every: Number of samples of the trajectory for each sample of the result. Headline numbers are
            computed from all samples.
        notes: Notes on the step and the backend for the summary.
        entries: Further entries of the summary.
    """

    scene: Scene
    ready: float
    trajectory: Trajectory
    every: int = 1
    notes: Mapping[str, str] = field(default_factory=dict)
    entries: Mapping[str, Any] = field(default_factory=dict)


def _flyable(scene: Scene) -> Scene:
    """Scene prepared for exported flight code in place of its controllers."""
    from spacerobot.flightcode.flyable import flyable

    return flyable(scene)


def _updated(
    updated: UpdatedScene,
    loop: ClosedLoop,
    backend: Backend,
    tell: Progress,
    onboard: OnboardController | None,
) -> _Run:
    """Run of a simulation whose controllers are updated in Python between segments of the rollout."""
    scene, simulation = updated.original, updated.scene.scenario.simulation
    rollout = _ready(
        updated.scene, resumed(loop), tell, None, updated.period_s, backend=backend, rollouts=updated.pieces
    )
    scene, notes = _with_choice(scene, rollout)
    ready = time.perf_counter()
    if simulation.engine == "pinocchio":
        plant: SinglePlant = CheckedPlant(loop, rollout, updated.scene)
    elif onboard is not None:
        from spacerobot.flightcode.flight import ControlledPlant

        plant = ControlledPlant(loop, rollout, simulation.output_step, onboard)
    else:
        plant = SinglePlant(loop, rollout, simulation.output_step)
    updates = [scheme.start(plant, 1, backend, tell) for scheme in updated.schemes]
    run_updates(plant, updates, updated.duration_s)
    for each in updates:
        for fault in filter(None, each.faults):
            raise fault
    trajectory = plant.trajectory
    scene = _warned(scene, rollout, trajectory, notes)
    entries = {key: value for each in updates for key, value in each.summary().items()}
    return _Run(scene, ready, trajectory, notes=notes, entries=entries)


def _rolled(
    scene: Scene, rollout: Rollout, design: Mapping[str, float], flown: OnboardController | None = None
) -> _Run:
    """Run of the fixed-step engine, sampled as by :func:`sampled_steps`."""
    scene, notes = _with_choice(scene, rollout)
    ready = time.perf_counter()
    fine = sampled_steps(rollout.grid)
    every = rollout.grid.every // fine.every
    if flown is None:
        trajectory = dataclasses.replace(rollout, grid=fine).run(design, estimate=True)
    else:
        from spacerobot.flightcode.flight import fly

        trajectory = fly(scene, rollout, fine, flown)
    return _Run(_warned(scene, rollout, trajectory, notes), ready, trajectory, every, notes)


def _with_choice(scene: Scene, rollout: Rollout) -> tuple[Scene, dict[str, str]]:
    """Scene with the chosen step, which reproduces the result, and notes for the summary."""
    because = {"interpreted_because": rollout.fallback} if rollout.fallback else {}
    notes = {"toolchain": rollout.summary, **because}
    if rollout.choice is not None:
        simulation = scene.scenario.simulation.model_copy(update={"step": rollout.choice.step_s})
        scene = dataclasses.replace(
            scene, scenario=scene.scenario.model_copy(update={"simulation": simulation})
        )
        choice = rollout.choice
        errors = f"error {choice.error:.1e}, of a single step {choice.step_error:.1e}"
        notes["step_chosen"] = f"{errors}, tolerance {choice.tolerance:g}"
    return scene, notes


def sampled_steps(grid: TimeGrid) -> TimeGrid:
    """Time grid with the same steps and a sample at every step, or at fewer if there are too many steps.

    Args:
        grid: Time grid of the result. Its samples are among those of the returned grid.
    """
    fewest = math.ceil(grid.steps / MOST_INSTANTS)
    stride = next(n for n in range(min(fewest, grid.every), grid.every + 1) if grid.every % n == 0)
    return TimeGrid(grid.duration_s, grid.intervals * (grid.every // stride), stride)


def _warned(scene: Scene, rollout: Rollout, trajectory: Trajectory, notes: dict[str, str]) -> Scene:
    """Scene with a warning if the scenario's step is too long; the step's error is added to the notes."""
    if rollout.choice is not None:
        return scene
    notes["step_error"] = f"{trajectory.step_error:.1e}"
    # divergence is reported by the status
    if trajectory.status != "completed" or trajectory.step_error <= STEP_ERROR_LIMIT:
        return scene
    message = (
        f"simulation.step: a single step errs by up to {trajectory.step_error:.1e}, above "
        f"{STEP_ERROR_LIMIT:g}; give a shorter one, or none to have it chosen"
    )
    return dataclasses.replace(scene, warnings=(*scene.warnings, message))


def _ready(
    scene: Scene,
    loop: ClosedLoop,
    tell: Progress,
    measures: Measures | None = None,
    duration_s: float | None = None,
    **request: Unpack[SimulationRequest],
) -> Rollout:
    """Compiled or interpreted rollout, whose step is chosen if the scenario has none.

    Raises:
        DivergedError: If no step satisfies the tolerance; the message states probable causes.
    """
    simulation = scene.scenario.simulation
    tell("preparing the simulation")
    try:
        return build_rollout(
            loop,
            duration_s=simulation.duration if duration_s is None else duration_s,
            step_s=simulation.step,
            output_step_s=simulation.output_step,
            tolerance=simulation.tolerance,
            method=simulation.method,
            measures=measures,
            progress=tell,
            **request,
        )
    except NoStepError as fault:
        touching = _touching(scene, loop, fault.finest)
        # probable causes: the fastest joint, and the fastest rate of the linearised loop at the start
        fastest = fast_words(fastest_joint(build_dataset(scene, fault.finest, loop)))
        cause, rate = "", find_fastest_rate(loop)
        if rate is not None:
            by = f", set by {' and '.join(rate.gains)}" if rate.gains else ""
            cause = f"the loop's fastest rate at the start is {rate.per_s:.3g} 1/s{by}"
        causes = (fault.message, cause, fastest, *touching, REMEDY)
        raise DivergedError("; ".join(filter(None, causes))) from None


def _touching(scene: Scene, loop: ClosedLoop, finest: Trajectory) -> Iterator[str]:
    """Advice about contacts that are too short for the steps of the finest trial rollout."""
    began, shortest = dict[str, float](), dict[str, float]()
    for fired in finest.events:
        pair, _, kind = loop.events[fired.event].name.rpartition(".")
        if kind == "touched":
            began[pair] = fired.time_s
        elif kind == "parted" and pair in began:
            who = loop.events[fired.event].who
            lasts = fired.time_s - began.pop(pair)
            shortest[who] = min(shortest.get(who, math.inf), lasts)
    for contact in scene.contacts:
        lasts = shortest.get(contact.name, math.inf)
        allowed = contact.config.longest_step
        if lasts < math.inf and (allowed is None or allowed > lasts * TOUCH_SHARE):
            yield (
                f"{contact.path} touches for {lasts:.2g} s: take steps of about {lasts * TOUCH_SHARE:.1g} s "
                f"there alone, by {contact.path}.longest_step"
            )
