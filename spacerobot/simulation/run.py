"""The main job: a scene in, a result out."""

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
from spacerobot.result.dataset import build_dataset
from spacerobot.result.events import build_events
from spacerobot.result.metrics import fastest_joint
from spacerobot.result.summary import build_summary
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
"""Largest finite magnitude of a state or output that is kept: its square is still a number."""

MOST_INSTANTS = 100_000
"""Maximum number of samples in which peaks are searched; fewer steps are all searched."""

STEP_ERROR_LIMIT = 1e-5
"""Estimated error of a single step, relative to the larger of one unit and the state, that is warned of."""

REMEDY = (
    "for a stiff loop take softer gains and dampers; else give `simulation.step`, or a larger "
    "`simulation.tolerance`"
)
"""Advice where no step meets the tolerance."""

TOUCH_SHARE = 0.02
"""Part of the time for which shapes touch that is proposed as the longest step meanwhile."""

Backend = Literal["auto", "compiled", "interpreted"]


def simulate(
    scene: Scene,
    *,
    backend: Backend = "auto",
    progress: Progress | None = None,
    controller: StrPath | OnboardController | None = None,
) -> Result:
    """Simulate a scene by the engine its scenario names.

    Args:
        scene: What to simulate.
        backend: ``auto``, ``compiled`` or ``interpreted``, for the ``casadi`` engine.
        progress: Called with a few words whenever something that may take a while begins.
        controller: Exported flight code that takes the place of the periodic controllers, estimators and
            detections: a shared library, or a controller behind a link. A library runs with the rights of
            this process.

    Returns:
        Result: Also of a rollout that diverged, up to where it went; its summary's status says so.

    Raises:
        CompileError: If a compiled backend was asked for and there is none.
        DivergedError: If the rollout has no finite sample at all; if the step was to be chosen and none keeps
            to the tolerance; if a grasp does not close.
        NoPlanError: If model predictive control finds no first plan.
        ScenarioError: If the memory does not hold the result; if the engine finds no events but the scenario
            has some; if controllers with a Python update do not fit the scene.
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

            # the independent engine, which takes long enough to say how far it is
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
    """Simulate a scene at several values of its parameters, by one closed loop and its fixed-step engine.

    Each result is what :func:`simulate` gives for the scene with these values.

    Args:
        scene, loop: The scene, and a closed loop of it that depends on what the designs change.
        designs: Parameters that differ from the scene's, by dotted path, for each name.

    Raises:
        DivergedError: As :func:`simulate`.
    """
    ready = prepare_simulation(scene, loop, rollouts=1)  # as each would be simulated alone
    for name, design in designs.items():
        variant = build_scene(scene.scenario, design, source=scene.source)
        yield name, ready.simulate(variant, design)[0]


@dataclass(frozen=True)
class PreparedSimulation:
    """A scene, its closed loop, and what rolls that out at any values of its parameters, by fixed steps."""

    scene: Scene
    loop: ClosedLoop
    rollout: Rollout

    def simulate(self, scene: Scene, design: Mapping[str, float]) -> tuple[Result, Trajectory]:
        """Result at other values of parameters, by dotted path, and the trajectory that it was made of.

        ``scene`` is the one that has these values.

        Raises:
            DivergedError: As :func:`simulate`.
        """
        begin = time.perf_counter()
        with np.errstate(over="ignore", invalid="ignore"):
            run = _rolled(scene, self.rollout, design)
        return _result(run, self.loop, begin, begin), run.trajectory


class SimulationRequest(TypedDict, total=False):
    """Keyword arguments of :func:`prepare_simulation`, as of :func:`spacerobot.rollout.build_rollout`."""

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
    """Make a closed loop of a scene ready to run.

    Args:
        scene, loop: The scene, and a closed loop of it.
        measures: What each rollout is reduced to beside its result.
        progress: As for :func:`simulate`.
        **request: As :class:`SimulationRequest` has it.

    Raises:
        DivergedError: If the step was to be chosen and none keeps to the tolerance.
    """
    return PreparedSimulation(
        scene, loop, _ready(scene, loop, progress or (lambda _: None), measures, **request)
    )


def _result(run: _Run, loop: ClosedLoop, begin: float, built: float) -> Result:
    """Result of a run that began, and had its closed loop, at these times."""
    # up to the last sample that holds nothing but numbers, and none beyond LARGEST
    trajectory = run.trajectory
    parts = [trajectory.state, *trajectory.outputs.values()]
    if not all(np.abs(part).max(initial=0.0) <= LARGEST for part in parts):
        values = np.hstack(parts)
        with np.errstate(invalid="ignore"):
            bad = ~(np.abs(values) <= LARGEST)
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
    data = build_dataset(run.scene, trajectory, loop)
    timing = {
        "closed_loop": built - begin,
        "compile_or_load": run.ready - built,
        "rollout": trajectory.wall_s,
        "total": done - begin,
    }
    events = build_events(run.scene, loop, trajectory.events)
    summary = build_summary(run.scene, data, trajectory, timing, run.notes, events)
    summary.update(run.entries)  # type: ignore[typeddict-item]
    samples = data if run.every == 1 else data.isel(time=slice(None, None, run.every))
    return Result(run.scene.scenario, samples, summary)


@dataclass(frozen=True)
class _Run:
    """Scene with the step that was taken, time at which everything was ready, trajectory, notes on how.

    Every so many instants of the trajectory are kept; the headline numbers see all of them. ``entries`` are
    further entries of the summary.
    """

    scene: Scene
    ready: float
    trajectory: Trajectory
    every: int = 1
    notes: Mapping[str, str] = field(default_factory=dict)
    entries: Mapping[str, Any] = field(default_factory=dict)


def _flyable(scene: Scene) -> Scene:
    """Scene whose controllers are flown as exported code."""
    from spacerobot.flightcode.flyable import flyable

    return flyable(scene)


def _updated(
    updated: UpdatedScene, loop: ClosedLoop, backend: Backend, tell: Progress, flown: OnboardController | None
) -> _Run:
    """One rollout in pieces, between which Python updates the controllers."""
    scene, simulation = updated.original, updated.scene.scenario.simulation
    rollout = _ready(
        updated.scene, resumed(loop), tell, None, updated.period_s, backend=backend, rollouts=updated.pieces
    )
    scene, notes = _with_choice(scene, rollout)
    ready = time.perf_counter()
    if simulation.engine == "pinocchio":
        plant: SinglePlant = CheckedPlant(loop, rollout, updated.scene)
    elif flown is not None:
        from spacerobot.flightcode.flight import ControlledPlant

        plant = ControlledPlant(loop, rollout, simulation.output_step, flown)
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
    """One rollout of the fixed-step engine, seen at every step."""
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
    """Scene whose scenario has the chosen step, so that it runs again to the same result, and notes on it."""
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
    """The same steps with a sample at each, or at as many as there is room for.

    Args:
        grid: Steps, and samples at which results are kept.
    """
    fewest = math.ceil(grid.steps / MOST_INSTANTS)
    stride = next(n for n in range(min(fewest, grid.every), grid.every + 1) if grid.every % n == 0)
    return TimeGrid(grid.duration_s, grid.intervals * (grid.every // stride), stride)


def _warned(scene: Scene, rollout: Rollout, trajectory: Trajectory, notes: dict[str, str]) -> Scene:
    """Scene with a warning of the scenario's step if it is too long; the error is noted."""
    if rollout.choice is not None:
        return scene
    notes["step_error"] = f"{trajectory.step_error:.1e}"
    # a rollout that diverged has more to say than that its step is too long
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
    """Compiled or interpreted rollout, its step chosen if the scenario gives none."""
    simulation = scene.scenario.simulation
    tell("preparing the simulation")  # compiled, found compiled or interpreted
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
        # which joint moves fastest in a rollout, in words
        fastest = fast_words(fastest_joint(build_dataset(scene, fault.finest, loop)))
        # how stiff the loop is where it begins, and by which gains, in words
        cause, rate = "", find_fastest_rate(loop)
        if rate is not None:
            by = f", set by {' and '.join(rate.gains)}" if rate.gains else ""
            cause = f"the loop's fastest rate at the start is {rate.per_s:.3g} 1/s{by}"
        causes = (fault.message, cause, fastest, *touching, REMEDY)
        raise DivergedError("; ".join(filter(None, causes))) from None


def _touching(scene: Scene, loop: ClosedLoop, finest: Trajectory) -> Iterator[str]:
    """Contacts whose touches are too short for the steps that were tried, and what to give them."""
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
