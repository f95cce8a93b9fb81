"""Causes of missed captures: closest approach, and violated limits of the capture envelope."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.scene import Scene, SceneGrasp

if TYPE_CHECKING:
    import xarray as xr

Booleans = npt.NDArray[np.bool_]
INSTANTS = 3000
"""Maximum number of instants at which the relative motion is evaluated."""
SHOWN = {
    "distance": ("distance", "mm", 1e3),
    "misalignment_deg": ("angle", "deg", 1.0),
    "closing_speed": ("closing speed", "mm/s", 1e3),
    "lateral_speed": ("lateral speed", "mm/s", 1e3),
    "spin_deg": ("spin", "deg/s", 1.0),
}
"""Limits of a capture envelope: name in words, display unit and its factor."""
ENVELOPE = tuple(SHOWN)
"""Names of the five limits of a capture envelope."""


def missed_captures(
    scene: Scene, data: xr.Dataset, events: Sequence[Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Find the causes of missed captures.

    Args:
        scene: The scene.
        data: Dataset of the complete rollout, at every step.
        events: Events of the rollout, as in a summary.

    Returns:
        dict: Causes by name of each grasp that begins open and was never captured:

            * ``closest``: closest approach, ``time_s`` and the five quantities of the envelope, in the
              units of its limits;
            * ``inside_s``: longest time for which all limits held;
            * ``violated``: violated limits in the order of time, each with ``limit``, ``allowed``, ``value``
              (the worst one), ``from_s`` and ``for_s``. They are searched in the longest time within
              ``distance``, or, if the tip was inside the envelope, after the longest time inside;
            * ``words``: the cause in one sentence.
    """
    captured = {event["who"] for event in events if event["kind"] == "captured"}
    causes = {}
    for grasp in scene.grasps:
        capture = grasp.config.capture
        if grasp.config.begins == "closed" or capture is None or grasp.name in captured:
            continue
        time = data["time"].values
        # samples at which the phase permits the capture (nt,)
        phases = scene.scenario.phases
        allowed = np.full(len(time), not phases)
        phase_starts = [(next(iter(phases)), -np.inf)] if phases else []
        phase_starts += [(event["who"], event["time_s"]) for event in events if event["kind"] == "phase"]
        for (name, begin), (_, end) in pairwise([*phase_starts, ("", np.inf)]):
            captures = phases[name].captures
            if captures is None or grasp.name in captures:
                allowed |= (time >= begin) & (time <= end)
        if not allowed.any():
            causes[grasp.name] = {"words": "no phase in which it may close began"}
        elif capture.at is not None:
            causes[grasp.name] = {"words": f"the simulation ended before {capture.at:g} s"}
        else:
            causes[grasp.name] = _why(scene, grasp, capture, data, allowed)
    return causes


def _why(
    scene: Scene, grasp: SceneGrasp, capture: Any, data: xr.Dataset, allowed: Booleans
) -> dict[str, Any]:
    """Entry of :func:`missed_captures` for one grasp with a capture envelope."""
    time = data["time"].values
    gaps = np.linalg.norm(data["grasp_gap"].sel(grasp=grasp.name).values, axis=1)
    gaps = np.where(allowed, gaps, np.inf)
    nearest = int(np.argmin(gaps))
    close = allowed if capture.distance is None else gaps <= capture.distance
    limits = {name: float(getattr(capture, name)) for name in capture.limits}
    closest = envelope_quantities(scene, grasp, capture, data, [nearest])
    cause: dict[str, Any] = {
        "closest": {"time_s": float(time[nearest])} | {name: float(closest[name][0]) for name in ENVELOPE},
        "inside_s": 0.0,
        "violated": [],
    }
    if not close.any():
        first = int(np.argmax(allowed))
        cause["violated"] = [
            {
                "limit": "distance",
                "allowed": limits["distance"],
                "value": float(gaps[nearest]),
                "from_s": float(time[first]),
                "for_s": float(time[np.flatnonzero(allowed)[-1]] - time[first]),
            }
        ]
        return cause | {"words": _words(capture, cause)}
    rows = np.flatnonzero(close)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), INSTANTS)).astype(int))]
    values = envelope_quantities(scene, grasp, capture, data, rows)
    over = {name: values[name] > limits[name] for name in limits if name != "distance"}
    good = ~np.any([*over.values(), np.zeros(len(rows), bool)], axis=0)

    def lasts(run: slice) -> float:
        """Duration of a run of rows [s]."""
        return float(time[rows[run.stop - 1]] - time[rows[run.start]])

    passes = [*_runs(np.ones(len(rows), bool), rows, close)]
    part, stays = max(passes, key=lasts), [*_runs(good, rows, close)]
    if stays:
        # the limits that ended the longest time inside: from there to the end of the time within `distance`
        stay = max(stays, key=lasts)
        cause["inside_s"] = lasts(stay)
        around = next(run for run in passes if run.start <= stay.start < run.stop)
        part = slice(stay.stop, around.stop)
    span = rows[part]
    # duration of each sample: half of the intervals to its neighbours
    edges = time[span]
    lengths = np.diff(np.r_[edges[:1], (edges[1:] + edges[:-1]) / 2, edges[-1:]])
    for name, mask in over.items():
        here = mask[part]
        if here.any():
            cause["violated"].append(
                {
                    "limit": name,
                    "allowed": limits[name],
                    "value": float(values[name][part].max()),
                    "from_s": float(time[span[int(np.argmax(here))]]),
                    "for_s": float(lengths[here].sum()) if len(span) > 1 else 0.0,
                }
            )
    cause["violated"].sort(key=lambda one: (one["from_s"], -one["for_s"]))
    # no other limit ended the time inside: the distance did, unless the simulation ended
    if stays and not cause["violated"] and "distance" in limits and rows[stay.stop - 1] + 1 < len(time):
        end = rows[stay.stop - 1] + 1
        cause["violated"] = [
            {
                "limit": "distance",
                "allowed": limits["distance"],
                "value": float(np.where(allowed, gaps, 0)[end:].max(initial=limits["distance"])),
                "from_s": float(time[min(end, len(time) - 1)]),
                "for_s": float(time[-1] - time[min(end, len(time) - 1)]),
            }
        ]
    return cause | {"words": _words(capture, cause)}


def _runs(mask: Booleans, rows: npt.NDArray[np.int64], close: Booleans) -> Iterator[slice]:
    """Runs of consecutive ``rows`` for which a mask holds and all samples in between are ``close``."""
    apart = np.cumsum(~close)[rows]
    begin = None
    for k in range(len(rows) + 1):
        ends = k == len(rows) or not mask[k] or (begin is not None and apart[k] != apart[begin])
        if ends and begin is not None:
            yield slice(begin, k)
            begin = None
        if k < len(rows) and mask[k] and begin is None:
            begin = k


def envelope_quantities(
    scene: Scene, grasp: SceneGrasp, capture: Any, data: xr.Dataset, rows: Sequence[int] | Array
) -> dict[str, Array]:
    """Evaluate the quantities of a capture envelope.

    Args:
        scene, grasp, capture: The scene, a grasp that begins open, and its capture envelope.
        data: Dataset of a rollout.
        rows: Indices of n samples.

    Returns:
        dict: Each quantity of :data:`ENVELOPE` (n,), in the unit of its limit.
    """
    model, axes = scene.model, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    kinematics = model.createData()
    unit = np.array(capture.axis) / np.linalg.norm(capture.axis)
    mated = pin.rpy.rpyToMatrix(np.radians(capture.mated_deg))
    values = np.empty((len(rows), len(ENVELOPE)))
    for k, (q, v) in enumerate(zip(data["q"].values[rows], data["v"].values[rows], strict=True)):
        pin.forwardKinematics(model, kinematics, q, v)
        tip, mate = (pin.updateFramePlacement(model, kinematics, f) for f in (grasp.tip.frame, grasp.frame))
        moving = pin.getFrameVelocity(model, kinematics, grasp.tip.frame, axes)
        other = pin.getFrameVelocity(model, kinematics, grasp.frame, axes)
        gap = tip.translation - mate.translation
        velocity = moving.linear - other.linear - np.cross(other.angular, gap)
        closing = float(mate.rotation @ unit @ velocity)
        misalignment = pin.log3((mate.rotation @ mated).T @ tip.rotation)
        values[k] = (
            np.linalg.norm(gap),
            np.degrees(np.linalg.norm(misalignment)),
            abs(closing),
            np.sqrt(max(float(velocity @ velocity) - closing**2, 0.0)),
            np.degrees(np.linalg.norm(moving.angular - other.angular)),
        )
    return {name: values[:, i] for i, name in enumerate(ENVELOPE)}


def shown(name: str, value: float) -> str:
    """Quantity of a capture envelope in its display unit, as text."""
    _, unit, factor = SHOWN[name]
    return f"{value * factor:.3g} {unit}"


def _words(capture: Any, event: Mapping[str, Any]) -> str:
    """Cause of a missed capture in one sentence: violated limits, then the closest approach."""
    parts = []
    if event["inside_s"]:
        stay = f"{event['inside_s']:.3g} s of the dwell of {capture.dwell:g} s"
        parts.append(f"inside its envelope for {stay}, then")
    limits = [
        f"{SHOWN[one['limit']][0]} {shown(one['limit'], one['value'])}, allowed "
        f"{shown(one['limit'], one['allowed'])}, from {one['from_s']:.4g} s for {one['for_s']:.3g} s"
        for one in event["violated"]
    ]
    if event["violated"] and event["violated"][0]["limit"] == "distance" and not event["inside_s"]:
        one = event["violated"][0]
        limits = [f"never within {shown('distance', one['allowed'])} in {one['for_s']:.3g} s"]
    parts.append("; ".join(limits) or "the simulation ended before the dwell was over")
    near = event["closest"]
    rest = ", ".join(f"{SHOWN[name][0]} {shown(name, near[name])}" for name in ENVELOPE[1:])
    when = f"{shown('distance', near['distance'])} at {near['time_s']:.4g} s"
    return f"{' '.join(parts)}; closest approach {when} ({rest})"
