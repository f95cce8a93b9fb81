"""Events of a rollout with times, impulses and energy losses, and the outcome of a docking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.common.tables import Table
from spacerobot.rollout import FiredEvent
from spacerobot.scene import Scene, SceneGrasp

INNER = ("reference", "eased", "settling", "moving", "control", "cut", "measured", "clipped", "unclipped")
"""Kinds of internal events, which results do not list, for example the start of a reference motion, a body
that settles or moves while a phase waits, the start and end of thruster pulses, sensor measurements, and a
motor that reaches or leaves its torque limit."""


AT_ONCE = 1e-9
"""Time between capture and release up to which a grasp counts as released at once [s]."""


def build_events(scene: Scene, loop: ClosedLoop, fired_events: Sequence[FiredEvent]) -> list[dict[str, Any]]:
    """Events for a summary, in their order.

    Args:
        scene, loop: The scene, and its closed loop.
        fired_events: Events of the rollout.

    Returns:
        list of dict: Each event has ``time_s``, ``kind``, ``who``, ``name`` and ``momentum_change``, the
            change of the total momentum across it, relative to the largest momentum of a body. Further keys
            depend on the event:

            * ``relative_velocity_m_s`` just before the event, world axes: for a grasp that of the tip
                relative
              to the target, for a contact that of the second shape relative to the first;
            * ``relative_spin_rad_s``: for a grasp the angular velocity of the tip relative to the target;
            * ``impulses_n_s``: non-zero impulses on the target by grasp; when a contact ends, the impulse on
              its second shape since it began;
            * ``energy_lost_j``: energy dissipated in the event, or in a contact since it began;
            * ``delay_s``: for a detection the time since the failure.
    """
    if not fired_events:
        return []
    c = loop.setup(loop.parameter_values)[1].full().ravel()
    jumps, grasps = {place: c[place] for place in loop.jumps}, {grasp.name: grasp for grasp in scene.grasps}
    contacts, touched = [contact.name for contact in scene.contacts], dict[str, Mapping[str, Array]]()
    records = list[dict[str, Any]]()
    for one in fired_events:
        rule = loop.events[one.event]
        for place, when in jumps.items():
            c[place] = np.inf if one.time_s < when else -np.inf
        switches, c[list(loop.switches)] = c[list(loop.switches)], one.switches
        if rule.kind in INNER:
            continue
        after = _outputs(loop, one.time_s, one.after, c)
        c[list(loop.switches)] = switches
        before = _outputs(loop, one.time_s, one.before, c)
        c[list(loop.switches)] = one.switches
        record = dict[str, Any](time_s=float(one.time_s), kind=rule.kind, who=rule.who, name=rule.name)
        if rule.who in grasps:
            velocity, spin = relative_velocity(scene, grasps[rule.who], one.before)
            record |= {"relative_velocity_m_s": velocity.tolist(), "relative_spin_rad_s": spin.tolist()}
        if rule.who in contacts:
            # contact_impulse and contact_loss are integrals: their differences belong to this contact alone
            place = contacts.index(rule.who)
            record["relative_velocity_m_s"] = before["contact_velocity"].reshape(-1, 3)[place].tolist()
            pair, _, kind = rule.name.rpartition(".")
            if kind == "touched":
                touched[pair] = before
            elif kind == "parted" and pair in touched:
                first = touched.pop(pair)
                impulse = (before["contact_impulse"] - first["contact_impulse"]).reshape(-1, 3)[place]
                record["impulses_n_s"] = {rule.name.partition(".")[0]: impulse.tolist()}
                record["energy_lost_j"] = float((before["contact_loss"] - first["contact_loss"])[place])
        if rule.kind == "detected":
            failed = [e["time_s"] for e in records if e["kind"] == "failed" and e["who"] == rule.who]
            record |= {"delay_s": one.time_s - failed[-1]} if failed else {}
        # impulses of grasps and energy lost in the event, if not zero
        fields: dict[str, Any] = {}
        if "grasp_impulse" in after:
            change = np.nan_to_num(after["grasp_impulse"] - before["grasp_impulse"]).reshape(-1, 3)
            impulses = {
                g.name: row.tolist() for g, row in zip(scene.grasps, change, strict=True) if row.any()
            }
            fields |= {"impulses_n_s": impulses} if impulses else {}
        if "work_event" in after:
            lost = float(after["work_event"][0] - before["work_event"][0])
            fields |= {"energy_lost_j": lost} if lost else {}
        # change of the total momentum relative to the largest momentum of a body; 0 if nothing moves
        parts = []
        for kind in ("linear", "angular"):
            partial = np.concatenate([before[f"body_momentum_{kind}"], after[f"body_momentum_{kind}"]])
            largest = float(np.linalg.norm(partial.reshape(-1, 3), axis=1).max())
            jump = float(np.linalg.norm(after[f"momentum_{kind}"] - before[f"momentum_{kind}"]))
            parts.append(jump / largest if largest else 0.0)
        records.append(record | fields | {"momentum_change": max(parts)})
    return records


def relative_velocity(scene: Scene, grasp: SceneGrasp, x: Array) -> tuple[Array, Array]:
    """Velocity [m/s] and angular velocity [rad/s] of a tip relative to the target, world axes (3,).

    The target's velocity is that of its material point at the tip.

    Args:
        scene, grasp: The scene, and the grasp with tip and mating frame.
        x: State (nx,).
    """
    model, data = scene.model, scene.model.createData()
    pin.forwardKinematics(model, data, x[: model.nq], x[model.nq : model.nq + model.nv])
    pin.updateFramePlacements(model, data)
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    tip, mate = (pin.getFrameVelocity(model, data, frame, axes) for frame in (grasp.tip.frame, grasp.frame))
    arm = data.oMf[grasp.tip.frame].translation - data.oMf[grasp.frame].translation
    velocity: Array = tip.linear - mate.linear - np.cross(mate.angular, arm)
    return velocity, np.array(tip.angular - mate.angular)


def _outputs(loop: ClosedLoop, time: float, x: Array, c: Array) -> dict[str, Array]:
    """Outputs by name, each (n,)."""
    values = loop.outputs(time, x, loop.at(time, x, c))
    return {name: value.full().ravel() for name, value in zip(loop.outputs.name_out(), values, strict=True)}


def outcome_of(scene: Scene, events: Sequence[Mapping[str, Any]]) -> str | None:
    """Outcome of a docking; None if no grasp begins open.

    The outcome is ``broke away`` if a captured grasp broke away and was not captured again, ``released at
    once`` if a grasp was released at the time of its capture, ``captured`` if all grasps that begin open were
    captured, ``collided`` if one was not captured and a contact occurred, and ``missed`` otherwise.
    """
    begins_open = [grasp.name for grasp in scene.grasps if grasp.config.begins == "open"]
    if not begins_open:
        return None
    ends = dict.fromkeys(begins_open, "missed")
    when = dict[str, float]()
    for event in events:
        name, kind = event["who"], event["kind"]
        if name not in ends or kind not in ("captured", "slipped", "released"):
            continue
        if kind == "captured":
            when[name] = event["time_s"]
        if kind != "released":
            ends[name] = kind
        elif event["time_s"] - when.get(name, -np.inf) <= AT_ONCE:
            ends[name] = "released at once"
    if "slipped" in ends.values():
        return "broke away"
    if "released at once" in ends.values():
        return "released at once"
    if "missed" not in ends.values():
        return "captured"
    return "collided" if any(event["kind"] == "touched" for event in events) else "missed"


def event_rows(events: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Events as rows of texts in the columns of :data:`HEADINGS`."""
    rows: list[tuple[str, ...]] = []
    for event in events:
        impulses = event.get("impulses_n_s", {}).values()
        largest = max((float(np.linalg.norm(impulse)) for impulse in impulses), default=None)
        speed = event.get("relative_velocity_m_s")
        rows.append(
            (
                f"{event['time_s']:.6f}",
                what_happened(event),
                "" if speed is None else f"{np.linalg.norm(speed) * 1e3:.4g}",
                "" if largest is None else f"{largest:.4g}",
                f"{event['energy_lost_j']:.4g}" if "energy_lost_j" in event else "",
            )
        )
    return rows


def event_table(events: Sequence[Mapping[str, Any]], title: str | None = None) -> Table:
    """Table of events; columns without entries are left out."""
    rows = event_rows(events)
    filled = [k for k in range(len(HEADINGS)) if any(row[k] for row in rows)]
    return Table(title, [HEADINGS[k] for k in filled], [[row[k] for k in filled] for row in rows])


def what_happened(event: Mapping[str, Any]) -> str:
    """Event in words, such as ``left captured``."""
    return f"{event['who']} {WORDS.get(event['kind'], event['kind'])}"


WORDS = {
    "entered": "in its envelope",
    "left": "out of its envelope",
    "slipped": "broke away",
    "drawn": "drawn in",
    "saturated": "at its speed limit",
    "freed": "free of its speed limit",
    "phase": "begins",
    "end": "ends the simulation",
}
"""Words for kinds of events; other kinds stand for themselves."""
HEADINGS = ("time [s]", "event", "relative speed [mm/s]", "impulse [N s]", "energy lost [J]")
"""Headings of the columns of :func:`event_rows`."""
