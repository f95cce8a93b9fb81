"""Events of a rollout: what happened when and to what, what it took, and how it came out."""

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
"""Kinds of events that are not told: a motion's time has come, a body moves slowly while a phase waits, a
decision on pulses, the end of one, a sensor measures, a motor comes to its torque limit and leaves it,
the spring of a transmission whose teeth have parted has relaxed."""


AT_ONCE = 1e-9
"""A grasp that is released so soon after its capture [s] was never held."""


def build_events(scene: Scene, loop: ClosedLoop, happened: Sequence[FiredEvent]) -> list[dict[str, Any]]:
    """Events as they stand in a summary, in their order.

    Each has ``time_s``, ``kind``, ``who``, ``name``; of a grasp, the tip's velocity and spin relative to the
    target just before (``relative_velocity_m_s``, ``relative_spin_rad_s``, world axes), of a contact the
    velocity of its second shape relative to the first; where they are not zero, the ``impulses_n_s`` on the
    target and the ``energy_lost_j``, of a contact that parts since it touched; where a failure is detected,
    ``delay_s`` since it; and ``momentum_change``, of everything across it, in parts of the largest momentum
    of a body.
    """
    if not happened:
        return []
    c = loop.setup(loop.parameter_values)[1].full().ravel()
    jumps, grasps = {place: c[place] for place in loop.jumps}, {grasp.name: grasp for grasp in scene.grasps}
    contacts, touched = [contact.name for contact in scene.contacts], dict[str, Mapping[str, Array]]()
    records = list[dict[str, Any]]()
    for one in happened:
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
            # relative velocity at a contact; as it parts, impulse on the second and loss since it touched
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
        # impulses of grasps and energy that an event took, where they are not zero
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
        # greatest change of the whole's momentum, in parts of the largest of a body; 0 where nothing moves
        parts = []
        for kind in ("linear", "angular"):
            partial = np.concatenate([before[f"body_momentum_{kind}"], after[f"body_momentum_{kind}"]])
            largest = float(np.linalg.norm(partial.reshape(-1, 3), axis=1).max())
            moved = float(np.linalg.norm(after[f"momentum_{kind}"] - before[f"momentum_{kind}"]))
            parts.append(moved / largest if largest else 0.0)
        records.append(record | fields | {"momentum_change": max(parts)})
    return records


def relative_velocity(scene: Scene, grasp: SceneGrasp, x: Array) -> tuple[Array, Array]:
    """Velocity [m/s] and spin [rad/s] of a tip relative to the target at the tip's point, world axes (3,)."""
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
    """Outcome of a docking; None where no grasp begins open.

    ``captured`` if every such grasp was; ``broke away`` if one was, and not captured again; ``released at
    once`` if one was let go at the instant of its capture; ``collided`` if one was not captured and something
    touched; else ``missed``.
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
    """Events as rows of texts: time, what, relative speed, impulse, energy lost."""
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
    """Table of events; a column that is empty for all of them is left out."""
    rows = event_rows(events)
    filled = [k for k in range(len(HEADINGS)) if any(row[k] for row in rows)]
    return Table(title, [HEADINGS[k] for k in filled], [[row[k] for k in filled] for row in rows])


def what_happened(event: Mapping[str, Any]) -> str:
    """An event in words, ``left captured``."""
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
"""How events are called where that is not their kind."""
HEADINGS = ("time [s]", "event", "relative speed [mm/s]", "impulse [N s]", "energy lost [J]")
"""What the rows of :func:`event_rows` hold."""
