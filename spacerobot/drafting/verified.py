"""Drafts that were simulated and linearised before they are written.

A drafted capture is accepted where its simulation captures with :data:`SHARE` of the envelope's limits left,
stops the object, keeps to the URDF's limits, keeps its conservation audit, and where the closed
loop, linearised about the start, the capture and the end, has no pole in the right half-plane. Otherwise
it is slowed down: half the bandwidth, twice the time, a quarter of the torque. The file says what was found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from spacerobot.closedloop import ClosedLoop
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.closedloop.stiffness import find_poles
from spacerobot.common.arrays import Array
from spacerobot.common.errors import DivergedError
from spacerobot.common.files import StrPath
from spacerobot.drafting.capture import CaptureGeometry
from spacerobot.drafting.held import DraftRequest, draft_scenario
from spacerobot.linear.instants import Instant, instants
from spacerobot.result import Result
from spacerobot.result.missed_captures import SHOWN, envelope_quantities
from spacerobot.scene import Scene
from spacerobot.scene.overlaps import overlaps
from spacerobot.simulation import Progress, prepare_simulation

SLOWDOWNS = (1.0, 2.0, 4.0, 8.0)
"""Factors by which a capture is slowed down, in the order in which they are tried."""
SHARE = 0.3
"""Part of every limit of the capture envelope, the distance aside, that is left at the capture."""
FAST = 2.0
"""Poles slower than this, over the time for which the loop stays as it is, belong to the motion: pose and
momentum of the whole have zeros, and redundant joints drift with the posture while a tip moves."""
TRACKED, TURNED_DEG = 0.1, 2.0
"""Largest error of a held tip, in parts of its way, and of its orientation where that is controlled [deg]."""
SHORTEST = 5.0  # [s] for which the loop counts as staying as it is


@dataclass(frozen=True)
class Draft:
    """A drafted scenario.

    Attributes:
        file: Where the text belongs: URDFs are named relative to it.
        text: The scenario as YAML, with comments.
        scene: The same, ready to simulate.
        problems: Why it does not capture, or hold; empty if it does.
        checks: Results of the simulation and linearisation, a sentence each; empty if nothing was simulated.
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
        """Whether it was simulated and passed its verification."""
        return bool(self.checks) and not self.problems


@dataclass(frozen=True)
class Verification:
    """Results of simulating and linearising a draft: problems and numbers, a sentence each."""

    problems: tuple[str, ...]
    checks: tuple[str, ...] = ()


def draft(
    request: DraftRequest,
    file: StrPath,
    *,
    capture: bool = False,
    simulate: bool = True,
    progress: Progress | None = None,
) -> Draft:
    """Draft a scenario from URDFs, and simulate it before it is written; nothing is written here.

    Args:
        request: URDFs, and what is chosen.
        file: Where the text will be written; URDFs are named relative to it.
        capture: Whether the object is approached, captured and stopped by one robot, or held from the start.
        simulate: Whether it is simulated and linearised, and a capture slowed down until it succeeds.
        progress: Called with a few words whenever a step that may take a while begins.

    Returns:
        Draft: Also of a scenario that does not work; its problems say why, in the text too.

    Raises:
        ScenarioError, DescriptionError: If a URDF cannot be used, a link is not there, or no such scene can
            be simulated.
    """
    tell = progress or (lambda _: None)
    place = Path(file)
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
        found = verify(scene, tell)
        if not found.problems:
            break
        pace = "As first drafted" if slowdown == 1 else f"Slowed down by {slowdown:g}"
        tries.append(f"{pace}: {'; '.join(found.problems)}.")
    if found.problems:
        text, scene = write(1.0)
        lines = ["The draft did not pass its verification; change it by hand.", *tries]
        return Draft(place, _headed(text, lines), scene, tuple(tries))
    if tries:
        tries.append(f"Slowed down by {slowdown:g}: it divides the bandwidths and multiplies the times.")
    lines = ["Simulated and linearised before it was written:", *(f"  {one}" for one in found.checks), *tries]
    return Draft(place, _headed(text, lines), scene, (), found.checks)


def _headed(text: str, lines: Sequence[str]) -> str:
    """Text with comments after its first line."""
    first, rest = text.split("\n", 1)
    return "\n".join([first, *(f"# {line}" for line in lines), rest])


def verify_held(scene: Scene, progress: Progress | None = None) -> Verification:
    """Simulate a scene in which the object is held from the start, and linearise it at its start and end.

    Args:
        scene: The scene.
        progress: As of :func:`spacerobot.simulate`.
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
    """Simulate a scene with one capture, and linearise it at the start, at the capture and at the end.

    Args:
        scene: The scene.
        progress: As of :func:`spacerobot.simulate`.
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
    told = list[str]()
    for name in config.limits:
        if name == "distance":
            continue  # the capture happens where the tip comes within it
        word, unit, factor = SHOWN[name]
        value, limit = float(values[name][0]) * factor, float(getattr(config, name)) * factor
        least = 1e-3 * limit  # digits of a value far below its limit decide nothing
        shown = f"{value:.2g}" if value > least else f"below {least:.1g}"
        told.append(f"{word} {shown} of {limit:.3g} {unit}")
        if value > (1 - SHARE) * limit:
            problems.append(f"{word} at the capture: {value:.3g} {unit} of {limit:.3g} {unit}, too close")
    if not end["name"].endswith(".settled"):
        problems.append(f"after the capture the object did not come to rest: {end['name']}")
    checks = (
        f"captured after {captured:.3g} s ({', '.join(told)}), at rest after {end['time_s']:.3g} s.",
        *_joints(scene, result),
        _slowest(loop, at),
    )
    return Verification(tuple(problems), checks)


def _of_any(result: Result) -> Iterator[str]:
    """Problems of any simulation: limits of the URDF, and the conservation audit."""
    for one in result.summary.get("beyond_limits", ()):
        yield f"{one['joint']}: {one['quantity']} beyond {one['limit']:.3g} {one['unit']}"
    if not result.summary["status"]["trusted"]:
        yield "the conservation audit is open"


def _joints(scene: Scene, result: Result) -> Iterator[str]:
    """Largest parts of the URDF's limits that joints use, in a sentence; none if it has no limits."""
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
        told = (f"{word} {100 * share:.2g} % ({joint})" for word, (share, joint) in largest.items())
        yield f"joints use at most this share of the URDF's limits: {', '.join(told)}."


def _fast_poles(loop: ClosedLoop, instant: Instant, lasts_s: float) -> Array:
    """Poles that matter within a time [s], real parts descending."""
    found = find_poles(loop, instant.time_s, instant.x, instant.c)
    fast = found[np.abs(found) * lasts_s > FAST]
    return fast[np.argsort(-fast.real)]


def _unstable(loop: ClosedLoop, at: Mapping[float, Instant]) -> Iterator[str]:
    """Instants about which the loop is unstable, by how long it stays as it is there [s]."""
    for lasts_s, instant in at.items():
        found = _fast_poles(loop, instant, lasts_s)
        if found.size and not found[0].real <= 0:
            yield f"unstable {_when(instant)}: a pole at {found[0].real:.2g} 1/s"


def _when(instant: Instant) -> str:
    """An instant in words."""
    if instant.is_start:
        return "at the start"
    if instant.label.endswith("captured, after"):
        return "just after the capture"
    return f"at {instant.time_s:.3g} s"


def _slowest(loop: ClosedLoop, at: Mapping[float, Instant]) -> str:
    """Poles in a sentence."""
    found = np.concatenate([_fast_poles(loop, instant, lasts_s) for lasts_s, instant in at.items()])
    where = ", ".join(_when(instant) for instant in at.values())
    # samples are held in the Jacobian: what is fed back through them has no pole there
    if any(rule.clock for rule in loop.events):
        where += " between samples (`spacerobot margins` includes what is fed back through samples)"
    if not found.size:
        return f"linearised {where}: no pole is faster than the motion."
    damping = -found.real / np.abs(found)
    return (
        f"linearised {where}: fastest pole {np.abs(found).max():.3g} 1/s, "
        f"least damping ratio {damping.min():.2g} (stable above 0, no oscillation at 1)."
    )
