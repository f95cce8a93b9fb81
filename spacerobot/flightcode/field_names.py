"""Fields of samples and of true motion: names, units, frames and descriptions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import pinocchio as pin

from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.common.arrays import Array
from spacerobot.elements.sensors.signals import BODY_AXES, SIGNALS
from spacerobot.flightcode.onboard import Field
from spacerobot.scene import Scene

PLANT_STATES = {
    "momentum": ("N m s", "angular momentum of each wheel about its axis, inertia (speed + a . spin)"),
    "propellant": ("kg", "propellant spent"),
    "captured_at": ("s", "time of the capture"),
    "rest_gap": ("m", "gap of the grasp at the capture"),
    "rest_turn": ("rad", "rotation vector of the grasp at the capture"),
    "draw_time": ("s", "time in which the grasp draws in"),
    "velocity": ("m/s", "relative velocity at the capture"),
    "spin": ("rad/s", "relative spin at the capture"),
}
"""Units and descriptions of states of the plant, by the last word of their names."""

EVENT_TEXTS = {
    "measured": "sample of a residual of momenta",
    "control": "decision on pulses",
    "sampled": "law of a controller",
    "acts": "a command that was delayed takes effect",
    "estimated": "update of an estimator",
    "reference": "a reference reaches its next piece",
    "detected": "test of a detection",
}
"""Descriptions of the software's events by kind."""


@dataclass(frozen=True)
class SampleNames:
    """Samples of sensors among the states, and their descriptions."""

    measured: Mapping[str, str]
    counted: Mapping[str, str]
    periods: Mapping[str, float]
    signals: set[str]
    stamped: set[str]

    def __call__(self, candidate: Field) -> Field:
        """Field with role, text and unit of a sample, if it is one."""
        name = self.measured.get(candidate.path, self.counted.get(candidate.path))
        if name is None:
            return candidate
        signal = next((signal for signal in SIGNALS if signal in name.split(".")), name)
        unit, text = SIGNALS.get(signal, ("1", signal))
        period = self.periods.get(candidate.path, 0.0)
        if candidate.path in self.counted:
            text = f"number of samples that were taken of: {signal}"
            return replace(candidate, role="count", text=text, period_s=period)
        frame = "world axes" if "world axes" in text else "joint axes"
        head, _, tail = name.rpartition(".")
        name = head if tail.isdigit() else name
        if f"{signal}{BODY_AXES}" in self.signals:
            frame, text = "axes of the link that carries the sensor", text.replace(", world axes", "")
        if candidate.path in self.stamped:
            content = "vector"
            if "orientation" in signal:
                content = "attitude as quaternion (x, y, z, w)" if candidate.size == 5 else "cosine and sine"
                unit = "1"
            text = f"{text}: {content}, last the time of the sample [s], below zero for none"
        return replace(
            candidate, name=name, role="sample", text=text, unit=unit, frame=frame, period_s=period
        )


def column_names(model: pin.Model) -> list[str]:
    """Name of each component of v."""
    names = [""] * model.nv
    for joint in range(1, model.njoints):
        first, size = int(model.idx_vs[joint]), int(model.nvs[joint])
        for i in range(size):
            names[first + i] = str(model.names[joint]) + (f"[{i}]" if size > 1 else "")
    return names


def true_motion(scene: Scene, builder: LoopBuilder, x0: Array) -> Iterator[Field]:
    """Poses and joint positions of each body with their rates."""
    model, plant = scene.model, builder.plant
    groups: dict[tuple[str, bool], list[int]] = {}
    for joint in range(1, model.njoints):
        body = str(model.names[joint]).partition("/")[0]
        root = str(model.names[joint]) == f"{body}/root"
        groups.setdefault((body, root), []).append(joint)
    for (body, root), joints in groups.items():
        q = [int(model.idx_qs[j]) + i for j in joints for i in range(int(model.nqs[j]))]
        v = [int(model.idx_vs[j]) + i for j in joints for i in range(int(model.nvs[j]))]
        names = ", ".join(str(model.names[j]).partition("/")[2] for j in joints)
        if root:
            text = "true pose of the root link: position, quaternion (x, y, z, w)"
            if len(q) == 4:
                text = "true pose of the root link: x, y, cosine and sine of its angle"
            rates, units = "true velocity and spin of the root link", ("m and 1", "m/s and rad/s")
            frames, kinds = ("world axes", "axes of the root link"), ("pose", "twist")
        else:
            text, rates = f"true positions of joints {names}", f"true rates of joints {names}"
            units, frames, kinds = (
                ("rad or m", "rad/s or m/s"),
                ("joint axes", "joint axes"),
                ("angles", "rates"),
            )
        at = [model.nq + i for i in v]
        path = f"true.{body}"
        yield Field(
            f"true_{body}_{kinds[0]}",
            f"{path}.{kinds[0]}",
            "truth",
            plant.q[q],
            x0[q],
            text,
            units[0],
            frames[0],
            places=tuple(q),
        )
        yield Field(
            f"true_{body}_{kinds[1]}",
            f"{path}.{kinds[1]}",
            "truth",
            plant.v[v],
            x0[at],
            rates,
            units[1],
            frames[1],
            places=tuple(at),
        )
