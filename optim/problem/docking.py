"""What is measured of a docking: when grasps were captured, how far they missed, what impacts took."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from spacerobot.rollout import Measure, Signals, final, peak
from spacerobot.scene import Scene

SMALLEST_LENGTH = 1e-9  # m; keeps distances smooth where they are zero
SMALLEST_IMPULSE = 1e-12  # N s; the same for impulses


@dataclass(frozen=True)
class Measured:
    """A measure with a component for each of what it is of.

    Attributes
    ----------
    places
        What it is of: names of grasps, or ``total``; none where a scene has nothing for it.
    unit
        Its unit.
    measure
        Of as many components.
    """

    places: tuple[str, ...]
    unit: str
    measure: Measure


def capture_times(signals: Signals, scene: Scene) -> Measured:
    """Time of the last capture of each grasp that begins open; the simulation's duration if missed."""
    chosen, duration = _begin_open(scene), scene.scenario.simulation.duration
    times = [signals["grasp_captured_at"][i] for i in chosen]
    late = [ca.if_else(time < 0, duration, time) for time in times]
    return Measured(_names(scene, chosen), "s", final(ca.vertcat(ca.SX(0, 1), *late)))


def nearness(signals: Signals, scene: Scene) -> Measured:
    """Least distance of tip and mating frame of each grasp that begins open, negated."""
    chosen, gaps = _begin_open(scene), signals["grasp_gap"]
    away = [_size(gaps[3 * i : 3 * i + 3], SMALLEST_LENGTH) for i in chosen]
    return Measured(_names(scene, chosen), "m", peak(-ca.vertcat(ca.SX(0, 1), *away)))


def impulses(signals: Signals, scene: Scene) -> Measured:
    """Size of what all impacts together gave the target in each rigid grasp that begins open."""
    chosen = [i for i in _begin_open(scene) if scene.grasps[i].config.is_rigid]
    sizes = [_size(signals["grasp_impulse"][3 * i : 3 * i + 3], SMALLEST_IMPULSE) for i in chosen]
    return Measured(_names(scene, chosen), "N s", final(ca.vertcat(ca.SX(0, 1), *sizes)))


def event_energy(signals: Signals, scene: Scene) -> Measured:
    """Energy that all events together took."""
    del scene
    known = "work_event" in signals.outputs
    return Measured(("total",) * known, "J", final(signals["work_event"] if known else ca.SX(0, 1)))


def _begin_open(scene: Scene) -> list[int]:
    return [i for i, grasp in enumerate(scene.grasps) if grasp.config.begins == "open"]


def _names(scene: Scene, chosen: Sequence[int]) -> tuple[str, ...]:
    return tuple(scene.grasps[i].name for i in chosen)


def _size(vector: ca.SX, smallest: float) -> ca.SX:
    return ca.sqrt(ca.sumsqr(vector) + smallest**2)
