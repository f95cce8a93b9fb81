"""Signals that a campaign records over time: names, time grid and size."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.quantities.joint_torque import torque_unit
from spacerobot.scenario import Campaign
from spacerobot.scene import Scene

AXES = "xyz"
MOST_BYTES = 20_000_000_000  # of all series of a campaign, before they are packed
BYTES_EACH = 8  # double precision, so that bits compare


@dataclass(frozen=True)
class RecordedSignal:
    """A signal that is kept over time.

    Attributes:
        name: Name among the closed loop's outputs.
        components: Label of each of its c numbers: a tip and an axis, a joint, ...; empty for a single
            number.
        unit: Unit of the numbers.
    """

    name: str
    components: tuple[str, ...]
    unit: str


@dataclass(frozen=True)
class SignalRecording:
    """Signals that a campaign records over time.

    Attributes:
        series: The signals.
        time: Times of recording (nt,) [s].
    """

    series: tuple[RecordedSignal, ...]
    time: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the signals."""
        return tuple(one.name for one in self.series)

    @property
    def width(self) -> int:
        """Numbers at each time, all signals together."""
        return sum(len(one.components) for one in self.series)

    @property
    def bytes_per_rollout(self) -> int:
        """Memory of one rollout under one set of gains [bytes]."""
        return BYTES_EACH * len(self.time) * self.width


def series_step(campaign: Campaign, duration_s: float) -> float | None:
    """Longest time between two values [s]; None where nothing is kept."""
    if not campaign.series:
        return None
    return campaign.series_step or duration_s / 100


def build_recording(loop: ClosedLoop, scene: Scene, names: Sequence[str], time_s: Array) -> SignalRecording:
    """Recording of signals of a closed loop's rollouts over time.

    Args:
        loop: The closed loop.
        scene: Scene of the closed loop.
        names: Names of its outputs.
        time_s: Times of recording (nt,) [s].

    Raises:
        ScenarioError: If there is no such output, or it has no components in this scene.
    """
    sizes = {name: loop.outputs.numel_out(name) for name in loop.outputs.name_out()}
    variables = {variable.name: variable for variable in loop.variables}
    joints = sorted(joint for body in scene.bodies for joint in body.arm_joints)
    joint_names = [str(scene.model.names[joint]) for joint in joints]
    labels: Mapping[str, Sequence[str]] = {"joint": joint_names, "axis": AXES}
    recorded_signals = []
    for name in names:
        if name not in sizes:
            raise ScenarioError(f"no signal {name!r}; {near_names(name, sizes)}", where="campaign.series")
        if not sizes[name]:
            raise ScenarioError(f"{name}: this scene has nothing that it is of", where="campaign.series")
        variable = variables[name]
        parts = itertools.product(*(labels.get(dimension, variable.labels) for dimension in variable.dims))
        components = [" ".join(part) for part in parts]
        unit = torque_unit(scene) if name == "joint_torque" else variable.unit
        if len(components) != sizes[name]:
            raise ValueError(f"{name} has {sizes[name]} components, {len(components)} are named")
        recorded_signals.append(RecordedSignal(name, tuple(components), unit))
    return SignalRecording(tuple(recorded_signals), time_s)


def check_size(recording: SignalRecording, samples: int, sets: int) -> None:
    """Refuse series that would be too large to keep.

    Raises:
        ScenarioError: If they are too large; the message states the sizes.
    """
    size_bytes = samples * sets * recording.bytes_per_rollout
    if size_bytes > MOST_BYTES:
        factors = (
            f"{samples} samples x {sets} sets of gains x {len(recording.time)} times x {recording.width}"
        )
        raise ScenarioError(
            f"would take {size_bytes / 1e9:.3g} GB ({factors} numbers x {BYTES_EACH} bytes), allowed: "
            f"{MOST_BYTES / 1e9:g} GB; keep fewer signals or raise series_step",
            where="campaign.series",
        )
