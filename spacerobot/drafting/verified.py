"""Verification of drafts by simulation and linearisation.

A drafted capture passes its verification if its simulation captures with a margin of :data:`SHARE` to the
limits of the envelope, stops the object, satisfies the limits of the URDFs and the conservation ledger, and
if the closed loop, linearised about the start, the capture and the end, has no pole in the right half-plane.
Otherwise the draft is slowed down: half the bandwidth, twice the time, a quarter of the torque. Comments in
the file state the results.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from spacerobot.closedloop import ClosedLoop
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.closedloop.stiffness import find_poles
from spacerobot.common.arrays import Array
from spacerobot.common.errors import DivergedError, ScenarioError
from spacerobot.common.files import StrPath, write_text
from spacerobot.common.tables import Content
from spacerobot.common.tabular import Tabular
from spacerobot.drafting.capture import CaptureGeometry, surface_point
from spacerobot.drafting.held import draft_scenario
from spacerobot.drafting.request import DraftRequest, check_absence
from spacerobot.linear.instants import Instant, instants
from spacerobot.result import Result
from spacerobot.result.missed_captures import SHOWN, envelope_quantities
from spacerobot.scene import Scene
from spacerobot.scene.overlaps import overlaps
from spacerobot.simulation import Progress, prepare_simulation

SLOWDOWNS = (1.0, 2.0, 4.0, 8.0)
"""Slowdowns in the order in which they are tried."""
SHARE = 0.3
"""Required relative margin to every limit of the capture envelope, except the distance."""
FAST = 2.0
"""Minimum magnitude of a pole times the duration of its phase for the pole to count. Slower poles belong to
the motion: pole pairs at zero of the total pose and momentum, and the drift of redundant joints."""
TRACKED, TURNED_DEG = 0.1, 2.0
"""Maximum error of a tip that holds the object, relative to its travel, and of its orientation [deg]."""
SHORTEST = 5.0  # minimum duration of a phase in the comparison with FAST [s]


@dataclass(frozen=True)
class Draft(Tabular):
    """A drafted scenario, which :meth:`save` writes.

    Attributes:
        file: File of the scenario; paths of URDFs are relative to its folder.
        text: YAML text with comments.
        scene: Scene of the scenario.
        problems: Reasons why the verification failed, for each slowdown; empty if it passed.
        checks: Results of simulation and linearisation in sentences, and why the draft was slowed down; empty
            without a simulation.
    """

    file: Path
    text: str
    scene: Scene
    problems: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the scene, and bodies that overlap at the start."""
        return (*self.scene.warnings, *overlaps(self.scene))

    @property
    def is_verified(self) -> bool:
        """Whether the draft was simulated and passed its verification."""
        return bool(self.checks) and not self.problems

    def save(self) -> Path:
        """Write the scenario and return its file.

        Raises:
            ScenarioError: If the file exists.
            ResultError: If it cannot be written.
        """
        check_absence(self.file)
        write_text(self.file, self.text)
        return self.file

    def __repr__(self) -> str:
        """File, and whether the draft passed its verification, in one line."""
        state = "failed" if self.problems else "passed" if self.checks else "not simulated"
        return f"<Draft {self.file}: {state}>"

    def content(self) -> Sequence[Content]:
        """Grasps, and the results of simulation and linearisation."""
        grasps = []
        for grasp in self.scene.grasps:
            verb = "holds" if grasp.config.begins == "closed" else "captures"
            base = grasp.tip.body.base.joint
            grasps.append(f"{grasp.tip.label} {verb} {grasp.config.frame}, {base} base")
        return [*grasps, *self.checks]

    def notices(self) -> Sequence[str]:
        """Warnings of the scene, and reasons why the verification failed."""
        failures = (f"{self.file} does not work yet: {problem}" for problem in self.problems)
        return [*self.warnings, *failures]


@dataclass(frozen=True)
class Verification:
    """Results of the simulation and linearisation of a draft.

    Attributes:
        problems: Reasons why the verification failed.
        checks: Numbers in sentences.
    """

    problems: tuple[str, ...]
    checks: tuple[str, ...] = ()


def draft(
    request: DraftRequest,
    file: StrPath | None = None,
    *,
    capture: bool = False,
    simulate: bool = True,
    progress: Progress | None = None,
) -> Draft:
    """Draft a scenario from URDFs and verify it by simulation; :meth:`Draft.save` writes it.

    Args:
        request: URDFs and options. For a point of the object's surface, a URDF of the object with a
            mating frame there is written to the folder of the scenario.
        file: File of the scenario, which may not exist; paths of URDFs are relative to its folder. If None,
            ``NAME.yaml`` with the name of the first robot's or the bus's URDF.
        capture: Whether one robot approaches, captures and stops the object; otherwise robots hold it from
            the start.
        simulate: Whether the draft is verified, and slowed down until it passes.
        progress: Callback with a short text, called when a step that may take long begins.

    Returns:
        Draft: The draft, also if it fails the verification; its ``problems`` and its text then state why.

    Raises:
        ScenarioError, DescriptionError: If a URDF cannot be used, a link is missing, the scene cannot be
            simulated, or a file exists.
        ResultError: If the URDF with a mating frame cannot be written.
    """
    if not isinstance(request, DraftRequest):
        raise ScenarioError(f"found {type(request).__name__}, allowed: a DraftRequest", where="request")
    place = request.check_files(file)
    tell = progress or (lambda _: None)
    if request.point is None:
        return _verified(request, place, tell, capture=capture, simulate=simulate)
    if not capture:
        message = "needs --capture; a scenario that begins with a grasp needs a mating frame"
        raise ScenarioError(message, where="--point")
    request, urdf, text = surface_point(request, place)
    check_absence(urdf)
    write_text(urdf, text)
    with contextlib.ExitStack() as failure:
        failure.callback(urdf.unlink, missing_ok=True)
        drafted = _verified(request, place, tell, capture=True, simulate=simulate)
        failure.pop_all()
    return drafted


def _verified(request: DraftRequest, place: Path, tell: Progress, *, capture: bool, simulate: bool) -> Draft:
    """Draft of a request without a point, verified; see :func:`draft`."""
    if capture:
        geometry = CaptureGeometry.of(request, place, tell)
        write: Callable[[float], tuple[str, Scene]] = geometry.scenario
        verify = verify_capture
    else:
        write, verify = partial(draft_scenario, request, place, progress=tell), verify_held
    if not simulate:
        text, scene = write(1.0)
        return Draft(place, _headed(text, ["Not simulated yet."]), scene)
    tries = list[str]()
    for slowdown in SLOWDOWNS:
        text, scene = write(slowdown)
        verification = verify(scene, tell)
        if not verification.problems:
            break
        pace = "As first drafted" if slowdown == 1 else f"Slowed down by {slowdown:g}"
        tries.append(f"{pace}: {'; '.join(verification.problems)}.")
    if verification.problems:
        text, scene = write(1.0)
        lines = ["The draft did not pass its verification; change it by hand.", *tries]
        return Draft(place, _headed(text, lines), scene, tuple(tries))
    if tries:
        tries.append(f"Slowed down by {slowdown:g}: it divides the bandwidths and multiplies the times.")
    checks = [f"  {check}" for check in verification.checks]
    lines = ["Simulated and linearised before it was written:", *checks, *tries]
    return Draft(place, _headed(text, lines), scene, (), (*verification.checks, *tries))


def _headed(text: str, lines: Sequence[str]) -> str:
    """Text with comment lines inserted after its first line."""
    first, rest = text.split("\n", 1)
    return "\n".join([first, *(f"# {line}" for line in lines), rest])


def verify_held(scene: Scene, progress: Progress | None = None) -> Verification:
    """Verify a scene in which robots hold the object from the start.

    The loop is linearised at the start and at the end of the simulation.

    Args:
        scene: The scene.
        progress: As for :func:`spacerobot.simulate`.
    """
    loop = cached_closed_loop(scene)
    try:
        prepared = prepare_simulation(scene, loop, progress=progress)
        result, _ = prepared.simulate(scene, {})
        if not result.completed:
            return Verification((f"the simulation {result.summary['status']['state']}",))
        duration = float(result.data["time"].values[-1])
        start, last = instants(prepared.rollout, loop, [0.0, duration])
        at = {duration: start, 0.999 * duration: last}
    except DivergedError as fault:
        return Verification((str(fault),))
    problems = [*_of_any(result), *_unstable(loop, at)]
    moved = float(np.linalg.norm(np.ptp(result.data["tip_reference"].values, axis=0), axis=-1).max())
    largest = float(np.linalg.norm(result.data["tip_error"].values, axis=-1).max())
    turned = np.degrees(np.linalg.norm(result.data["tip_orientation_error"].values, axis=-1).max())
    if largest > TRACKED * moved:
        problems.append(f"a tip error is {largest * 1e3:.3g} mm in a motion of {moved * 1e3:.3g} mm")
    controlled = any(tip.config.orientation_pid is not None for tip in scene.tips)
    if turned > TURNED_DEG and controlled:
        problems.append(f"the orientation error of a tip is {turned:.3g} deg")
    checks = (
        f"tips move by {moved * 1e3:.3g} mm with errors of {largest * 1e3:.2g} mm and {turned:.2g} deg.",
        *_joints(scene, result),
        _slowest(loop, at),
    )
    return Verification(tuple(problems), checks)


def verify_capture(scene: Scene, progress: Progress | None = None) -> Verification:
    """Verify a scene with one capture.

    The loop is linearised at the start, after the capture and at the end of the simulation.

    Args:
        scene: The scene.
        progress: As for :func:`spacerobot.simulate`.
    """
    loop, grasp = cached_closed_loop(scene), scene.grasps[0]
    try:
        prepared = prepare_simulation(scene, loop, progress=progress)
        result, _ = prepared.simulate(scene, {})
        if not result.completed:
            return Verification((f"the simulation {result.summary['status']['state']}",))
        if result.summary["outcome"] != "captured":
            missed = result.summary.get("missed", {}).get(grasp.name, {}).get("words", "")
            return Verification((f"{result.summary['outcome']}: {missed}",))
        events = result.summary["events"]
        captured = next(event for event in events if event["kind"] == "captured")["time_s"]
        end = events[-1]
        start, _, stop, last = instants(
            prepared.rollout, loop, [0.0, "approach.captured", 0.999 * end["time_s"]]
        )
        approach_s, stop_s = max(captured, SHORTEST), max(end["time_s"] - captured, SHORTEST)
        at = {approach_s: start, stop_s: stop, 1.001 * stop_s: last}
    except DivergedError as fault:
        return Verification((str(fault),))
    problems = [*_of_any(result), *_unstable(loop, at)]
    config, time = grasp.config.capture, result.data["time"].values
    assert config is not None, "a grasp that begins open has an envelope"
    before = max(int(np.searchsorted(time, captured)) - 1, 0)
    values = envelope_quantities(scene, grasp, config, result.data, [before])
    margins = list[str]()
    for name in config.limits:
        if name == "distance":
            continue  # a capture occurs at the limit of the distance
        word, unit, factor = SHOWN[name]
        value, limit = float(values[name][0]) * factor, float(getattr(config, name)) * factor
        least = 1e-3 * limit  # values far below their limits are not written, since they depend on rounding
        value_text = f"{value:.2g}" if value > least else f"below {least:.1g}"
        margins.append(f"{word} {value_text} of {limit:.3g} {unit}")
        if value > (1 - SHARE) * limit:
            problems.append(f"{word} at the capture: {value:.3g} {unit} of {limit:.3g} {unit}, too close")
    if not end["name"].endswith(".settled"):
        problems.append(f"after the capture the object did not come to rest: {end['name']}")
    checks = (
        f"captured after {captured:.3g} s ({', '.join(margins)}), at rest after {end['time_s']:.3g} s.",
        *_joints(scene, result),
        _slowest(loop, at),
    )
    return Verification(tuple(problems), checks)


def _of_any(result: Result) -> Iterator[str]:
    """Problems of any simulation: violated limits of the URDFs, and an open conservation ledger."""
    for one in result.summary.get("beyond_limits", ()):
        yield f"{one['joint']}: {one['quantity']} beyond {one['limit']:.3g} {one['unit']}"
    if not result.summary["status"]["trusted"]:
        yield "the conservation audit is open"


def _joints(scene: Scene, result: Result) -> Iterator[str]:
    """Largest torque and rate relative to the URDFs' limits, in a sentence; none without limits."""
    data, largest = result.data, dict[str, tuple[float, str]]()
    joints = {
        f"{robot.name}/{joint.name}": joint for robot in scene.robots for joint in robot.description.joints
    }
    for k, label in enumerate(data["joint"].values):
        joint = joints.get(str(label))
        if joint is None:
            continue
        for word, array, limit in (
            ("torque", "joint_torque", joint.effort),
            ("rate", "joint_velocity", joint.velocity),
        ):
            if 0 < limit < np.inf:
                share = float(np.nanmax(np.abs(data[array].values[:, k]))) / limit
                largest[word] = max(largest.get(word, (0.0, "")), (share, joint.name))
    if largest:
        shares = (f"{word} {100 * share:.2g} % ({joint})" for word, (share, joint) in largest.items())
        yield f"joints use at most this share of the URDF's limits: {', '.join(shares)}."


def _fast_poles(loop: ClosedLoop, instant: Instant, lasts_s: float) -> Array:
    """Poles [1/s] that are fast compared with the duration of a phase [s], by descending real part."""
    poles = find_poles(loop, instant.time_s, instant.x, instant.c)
    fast = poles[np.abs(poles) * lasts_s > FAST]
    return fast[np.argsort(-fast.real)]


def _unstable(loop: ClosedLoop, at: Mapping[float, Instant]) -> Iterator[str]:
    """Unstable poles in words.

    Args:
        loop: The closed loop.
        at: Instants of linearisation by the durations of their phases [s].
    """
    for lasts_s, instant in at.items():
        poles = _fast_poles(loop, instant, lasts_s)
        if poles.size and not poles[0].real <= 0:
            yield f"unstable {_when(instant)}: a pole at {poles[0].real:.2g} 1/s"


def _when(instant: Instant) -> str:
    """Instant in words."""
    if instant.is_start:
        return "at the start"
    if instant.label.endswith("captured, after"):
        return "just after the capture"
    return f"at {instant.time_s:.3g} s"


def _slowest(loop: ClosedLoop, at: Mapping[float, Instant]) -> str:
    """Fastest pole and smallest damping ratio in a sentence."""
    poles = np.concatenate([_fast_poles(loop, instant, lasts_s) for lasts_s, instant in at.items()])
    where = ", ".join(_when(instant) for instant in at.values())
    # the linearisation holds samples constant: feedback through samples has no poles in it
    if any(rule.clock for rule in loop.events):
        where += " between samples (`spacerobot margins` includes what is fed back through samples)"
    if not poles.size:
        return f"linearised {where}: no pole is faster than the motion."
    damping = -poles.real / np.abs(poles)
    return (
        f"linearised {where}: fastest pole {np.abs(poles).max():.3g} 1/s, "
        f"minimum damping ratio {damping.min():.2g} (stable above 0, no oscillation at 1)."
    )
