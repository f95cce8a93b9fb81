"""What a tip sees of a mating frame, written again: now, or when a sensor measured last."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.elements.sensors.sampled import Sampled
from spacerobot.scene import Scene, SceneTip
from spacerobot.scene.scene import SceneReference
from tests.oracles.engine.kinematics import Kinematics
from tests.oracles.engine.sensing import reading_of, sensors_of

SIGNALS = {"target_position", "target_velocity", "target_spin"}
"""What is seen of a mating frame."""


@dataclass(frozen=True)
class Held:
    """What a sensor showed when it measured last (3,), and when it measures again [s]."""

    shown: Array
    due: float


@dataclass(frozen=True)
class Sight:
    """What a tip with a reference sees.

    Attributes:
        scene, tip: With the numbers of the present phase.
        frame: Of the mating frame in the model.
        name: Of the tip and its reference.
        held: What sensors measured last, by tip, reference and signal.
    """

    scene: Scene
    tip: SceneTip
    frame: int
    name: str
    held: Mapping[str, Held]

    def read(self, signal: str, kinematics: Kinematics) -> Array:
        """What is known of a position, velocity or spin (3,) in the world."""
        held = self.held.get(f"{self.name}.{signal}")
        return self.shown(signal, kinematics) if held is None else held.shown

    def shown(self, signal: str, kinematics: Kinematics) -> Array:
        """What its sensor shows of it now."""
        mate, sensor = kinematics.frame(self.frame), reading_of(sensors_of(self.tip.body)[signal])
        place = kinematics.frame(self.tip.frame).position
        seen, known = {
            "target_position": (mate.position - place, mate.position),
            "target_velocity": (mate.velocity[:3], mate.velocity[:3]),
            "target_spin": (mate.velocity[3:], mate.velocity[3:]),
        }[signal]
        axes = np.zeros(3)
        axes[list(self.scene.rotation_axes if signal == "target_spin" else self.scene.translation_axes)] = 1
        return np.asarray(known + axes * (sensor.offset + (sensor.scale - 1) * seen))


def sight_of(scene: Scene, tip: SceneTip, reference: SceneReference, held: Mapping[str, Held]) -> Sight:
    """What a tip with a reference sees of the mating frame that it follows, if it does."""
    frame = int(scene.model.getFrameId(f"target/{reference.config.follows}", pin.FrameType.BODY))
    return Sight(scene, tip, frame, f"{tip.label}.{reference.path}", held)


@dataclass(frozen=True)
class Holding:
    """A sensor that holds what it measures of a signal, for one reference.

    Attributes:
        sight, signal: What it sees.
        period: Time between two measurements [s].
    """

    sight: Sight
    signal: str
    period: float

    @property
    def name(self) -> str:
        """Of tip, reference and signal."""
        return f"{self.sight.name}.{self.signal}"

    def measured(self, now: Kinematics, before: Mapping[str, Held]) -> Held:
        """What it shows from now on."""
        last = before[self.name].due if before else 0.0
        return Held(self.sight.shown(self.signal, now), last + self.period)


def holding(scene: Scene) -> Iterator[Holding]:
    """Sensors that hold what they measure."""
    return (one for one in seen_by_references(scene) if one.period)


def seen_by_references(scene: Scene) -> Iterator[Holding]:
    """Sensors with errors that references read; the period of a continuous one is zero."""
    for tip in scene.tips:
        for reference in tip.references:
            for signal in sorted(SIGNALS & reference.config.reads()):
                sensor = sensors_of(tip.body)[signal]
                if not sensor.is_ideal:
                    period = sensor.period if isinstance(sensor, Sampled) else 0.0
                    yield Holding(sight_of(scene, tip, reference, {}), signal, period)
