"""What a campaign keeps of each rollout: a row of named numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from optim.campaign.rollouts.series import torque_unit
from optim.campaign.rollouts.trust import (
    DRIFT,
    KINDS,
    RESIDUAL,
    drift_measure,
    drift_of,
    residual_measure,
    residual_of,
)
from optim.problem.bases import attitude_peaks, jitters, propellants, wheel_peaks
from optim.problem.docking import Measured, capture_times, event_energy, impulses, nearness
from spacerobot.arrays import Array
from spacerobot.closedloop import ClosedLoop
from spacerobot.rollout import ClosedLoopFunctions, Measure, Measures, Signals, integral, peak
from spacerobot.scene import Scene

AXES = "xyz"
DERIVED: dict[str, Callable[[Array], Array]] = {
    DRIFT: drift_of,
    RESIDUAL: residual_of,
    "miss_distance": lambda nearness: -nearness,
}


@dataclass(frozen=True)
class Column:
    """One number of each rollout.

    Attributes
    ----------
    metric
        Which quantity, as the scenario names it.
    where
        Of what: a tip and an axis, a tip, a robot, a grasp, the target, or the total.
    unit
        Its unit.
    """

    metric: str
    where: str
    unit: str

    @property
    def name(self) -> str:
        """Both, for tables."""
        return f"{self.metric} {self.where}"


@dataclass(frozen=True)
class Kept:
    """Measures of a closed loop, and the columns that follow from them.

    Attributes
    ----------
    measures
        For the rollout.
    columns
        M of them.
    duration_s
        Of a rollout.
    """

    measures: Measures
    columns: tuple[Column, ...]
    duration_s: float

    def table(self, measured: Mapping[str, Array]) -> Array:
        """Values (N, M) of a batch's measures; NaN where a rollout diverged."""
        parts = []
        for name in dict.fromkeys(column.metric for column in self.columns):
            values = np.asarray(measured[name])
            if name in ("tip_error_rms", "jitter"):
                values = np.sqrt(values / self.duration_s)
            parts.append(DERIVED[name](values) if name in DERIVED else values)
        return np.column_stack(parts)


def build_kept(
    loop: ClosedLoop, scene: Scene, wanted: Sequence[str], extended: ClosedLoopFunctions | None = None
) -> Kept:
    """What is kept of rollouts of a closed loop; a metric that a scene has nothing for is left out.

    The residual of the energy is kept besides, and the drift of the momenta where they are constant: they say
    which rollouts to trust.

    Parameters
    ----------
    loop, extended
        The closed loop, and the one that is rolled out where it has states beside for what is measured.
    scene
        Its scene.
    wanted
        Metrics by the names of the scenario's campaign section.
    """
    rolled = extended or loop
    signals = Signals.of(rolled)
    duration = scene.scenario.simulation.duration
    named: dict[str, Measure] = {}
    columns: list[Column] = []
    makers: dict[str, Callable[[Signals, Scene], Made]] = {
        "tip_error_peak": _error_peaks,
        "tip_error_rms": _error_squares,
        "target_rotation_peak": lambda signals, scene: _rotations(signals, scene, target=True),
        "base_rotation_peak": lambda signals, scene: _rotations(signals, scene, target=False),
        "joint_torque_peak": _torques,
        "grip_force_peak": _grips,
        "capture_time": _measured(capture_times),
        "miss_distance": _measured(nearness),
        "impulse": _measured(impulses),
        "event_energy": _measured(event_energy),
        "attitude_error_peak": _measured(partial(attitude_peaks, rolled)),
        "wheel_momentum_peak": _measured(partial(wheel_peaks, rolled)),
        "propellant": _measured(partial(propellants, rolled)),
        "jitter": _measured(partial(jitters, rolled), "m"),
    }
    for name, make in makers.items():
        places, unit, measure = make(signals, scene)
        if name in wanted and places:
            named[name] = measure
            columns += [Column(name, place, unit) for place in places]
    if columns:
        named[RESIDUAL] = residual_measure(loop, signals)
        columns.append(Column(RESIDUAL, "total", "1"))
    if columns and not loop.outside:
        named[DRIFT] = drift_measure(loop, signals)
        columns += [Column(DRIFT, kind, "1") for kind in KINDS]
    return Kept(Measures(signals, named, costs=lambda _r, _p: {}), tuple(columns), duration)


Made = tuple[list[str], str, Measure]


def _error_peaks(signals: Signals, scene: Scene) -> Made:
    axes = scene.translation_axes
    rows = [3 * i + axis for i in range(len(scene.tips)) for axis in axes]
    places = [f"{tip.label} {AXES[axis]}" for tip in scene.tips for axis in axes]
    return places, "m", peak(ca.fabs(signals["tip_error"][rows]))


def _error_squares(signals: Signals, scene: Scene) -> Made:
    squares = [ca.sumsqr(part) for part in _threes(signals["tip_error"])]
    return [tip.label for tip in scene.tips], "m", integral(ca.vertcat(*squares))


def _rotations(signals: Signals, scene: Scene, *, target: bool) -> Made:
    rotation = _threes(signals["body_rotation"])
    chosen = [i for i, body in enumerate(scene.bodies) if (body.path == "target") == target]
    sizes = [180 / np.pi * ca.sqrt(ca.sumsqr(rotation[i])) for i in chosen]
    return [scene.bodies[i].name for i in chosen], "deg", peak(ca.vertcat(*sizes))


def _torques(signals: Signals, scene: Scene) -> Made:
    """Largest torque or force of any joint of each body that has joints."""
    joints = sorted(
        (scene.model.idx_vs[joint], body.name) for body in scene.bodies for joint in body.arm_joints
    )
    size = ca.fabs(signals["joint_torque"])
    places = [body.name for body in scene.bodies if body.arm_joints]
    if size.numel() != len(joints):
        raise ValueError("every joint has one torque")
    rows = {name: [i for i, (_, owner) in enumerate(joints) if owner == name] for name in places}
    return places, torque_unit(scene), peak(ca.vertcat(*(ca.mmax(size[rows[name]]) for name in places)))


def _grips(signals: Signals, scene: Scene) -> Made:
    sizes = [ca.sqrt(ca.sumsqr(part)) for part in _threes(signals["grasp_force"])]
    return [grasp.name for grasp in scene.grasps], "N", peak(ca.vertcat(*sizes))


def _measured(
    make: Callable[[Signals, Scene], Measured], unit: str | None = None
) -> Callable[[Signals, Scene], Made]:
    """A measure as columns; ``unit`` is that of what the table makes of it, if it does."""

    def made(signals: Signals, scene: Scene) -> Made:
        found = make(signals, scene)
        return list(found.places), unit or found.unit, found.measure

    return made


def _threes(stacked: ca.SX) -> list[ca.SX]:
    return [stacked[i : i + 3] for i in range(0, stacked.numel(), 3)]
