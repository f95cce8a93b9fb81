"""Summary of a result, as in ``summary.json``."""

from __future__ import annotations

import functools
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any, cast

from spacerobot.common.version import __version__
from spacerobot.elements.core.registry import plugin_records
from spacerobot.result.events import outcome_of
from spacerobot.result.ledger import build_ledger
from spacerobot.result.limits import beyond_limits, limit_warnings
from spacerobot.result.metrics import (
    attitude_errors,
    body_motion,
    fastest_joint,
    fastest_wheel,
    greatest_contact,
    greatest_grip,
    greatest_torque,
    propellant,
    tip_errors,
)
from spacerobot.result.missed_captures import missed_captures
from spacerobot.result.store import FORMAT
from spacerobot.result.summary_types import Summary
from spacerobot.result.trust import advise, check_trust, deep_contacts, warning
from spacerobot.rollout import Trajectory
from spacerobot.scene import Scene

if TYPE_CHECKING:
    import xarray as xr


def build_summary(
    scene: Scene,
    data: xr.Dataset,
    trajectory: Trajectory,
    timing: Mapping[str, float],
    notes: Mapping[str, str],
    events: Sequence[Mapping[str, Any]],
) -> Summary:
    """Build the summary of a simulation: status, headline numbers, ledger, timing, assumptions and versions.

    Args:
        scene: The scene.
        data: Dataset at every step.
        trajectory: Trajectory of the rollout.
        timing: Wall times [s].
        notes: Notes on the engine: its compiler, and the error of the step.
        events: Events, from :func:`spacerobot.result.events.build_events`.
    """
    bodies, ledger, fastest = body_motion(data), build_ledger(data, scene.scenario), fastest_joint(data)
    engine = {
        "name": scene.scenario.simulation.engine,
        "backend": trajectory.backend,
        "step_s": trajectory.step_s if trajectory.steps else None,
        "steps": trajectory.steps,
        **notes,
    }
    advice = advise(engine, scene.scenario.simulation.tolerance, fastest)
    # a diverged rollout violates every limit, which explains nothing
    beyond = beyond_limits(scene, data) if trajectory.status == "completed" else []
    ended = trajectory.ended_at_s
    trust = check_trust(trajectory.status == "completed", ledger, advice, deep_contacts(scene.contacts, data))
    if trajectory.status == "diverged":
        trust["advice"] = advice
    trust_warning = warning(trust)
    status = {
        "state": trajectory.status,
        "reached_s": float(trajectory.time[-1]) if ended is None else ended,
        "diverged_at_s": trajectory.diverged_at_s,
        "cause": trajectory.cause or None,
    }
    summary = {
        "format": FORMAT,
        "name": scene.scenario.name,
        "status": status | trust,
        "outcome": outcome_of(scene, events),
        **({"missed": missed} if (missed := missed_captures(scene, data, events)) else {}),
        "events": list(events),
        "tip_error": tip_errors(data),
        **({"unled_tips": unled} if (unled := unled_tips(scene)) else {}),
        "target": bodies.get("target"),
        "bases": {body.name: bodies[body.name] for body in scene.robots},
        "greatest_torque": greatest_torque(data),
        "greatest_grip": greatest_grip(data),
        **({"greatest_contact": greatest_contact(data)} if scene.contacts else {}),
        **({"attitude_error": attitude_errors(data)} if "base_attitude_error" in data else {}),
        **({"propellant_kg": propellant(data)} if "propellant" in data else {}),
        "fastest_joint": fastest,
        **({"beyond_limits": beyond} if beyond else {}),
        **({"fastest_wheel": fastest_wheel(data)} if "wheel" in data.dims else {}),
        "ledger": ledger,
        "engine": engine,
        "timing_s": dict(timing),
        "assumptions": list(scene.assumptions),
        "warnings": [*scene.warnings, *limit_warnings(beyond), *([trust_warning] if trust_warning else [])],
        "urdf_sha256": {body.name: body.description.sha256 for body in scene.bodies},
        **({"plugins": plugins} if (plugins := plugin_records()) else {}),
        "versions": dict(_versions()),
    }
    return cast("Summary", summary)  # its keys and types are compared in a test


def unled_tips(scene: Scene) -> list[str]:
    """Labels of the tips without a reference or controller of their own, whose error has no meaning."""
    return [
        tip.label
        for tip in scene.tips
        if len(tip.references) == 1
        and not tip.from_target
        and tip.config.reference is None
        and not list(tip.config.elements())
    ]


@functools.cache
def _versions() -> Mapping[str, str]:
    versions = {"spacerobot": __version__, "python": platform.python_version()}
    for package in ("pin", "casadi", "numpy", "yourdfpy"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "unknown"
    return versions
