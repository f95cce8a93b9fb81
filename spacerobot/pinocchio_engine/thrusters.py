"""Throttled thrusters, written again: what each does in world axes, shared by coordinate descent in numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spacerobot.arrays import Array
from spacerobot.elements.actuators.thrusters import GRAVITY, Nozzle, Thrusters
from spacerobot.elements.allocation import SMALL
from spacerobot.errors import ScenarioError
from spacerobot.pinocchio_engine.actuation import Delivered, Push, base_columns, delivery_of
from spacerobot.pinocchio_engine.kinematics import Kinematics
from spacerobot.scene import Scene, SceneBody


@dataclass(frozen=True)
class Jets:
    """Thrusters of one section; their state is the propellant that they have spent."""

    scene: Scene
    body: SceneBody
    config: Thrusters
    key: str
    from_outside: bool = True
    works: tuple[str, ...] = ("thruster",)

    @property
    def columns(self) -> tuple[int, ...]:
        """Places in v of the base."""
        return tuple(base_columns(self.scene, self.body))

    @property
    def passes_on(self) -> tuple[int, ...]:
        """All of them."""
        return self.columns

    @property
    def _name(self) -> str:
        return f"{self.body.name}/{self.key.rpartition('.')[2]}"

    @property
    def state_names(self) -> tuple[str, ...]:
        """The propellant."""
        return (f"{self._name}.propellant[0]",)

    def initial(self, kinematics: Kinematics) -> Array:
        """Nothing spent."""
        del kinematics
        return np.zeros(1)

    def deliver(self, kinematics: Kinematics, asked: Array, states: Array, on: frozenset[str]) -> Delivered:
        """Forces of all nozzles; what is missing is left to the next actuator."""
        del on
        frame, own = kinematics.frame(self.body.root_frame), list(self.columns)
        nozzles = list(self.config.nozzles.values())
        levers = [np.array(nozzle.position) for nozzle in nozzles]
        pushes = [self._given(n, "thrust") * _unit(n) for n in nozzles]
        rows = [0, 1, 5] if len(own) == 3 else list(range(6))
        full = np.array([np.r_[push, np.cross(r, push)] for r, push in zip(levers, pushes, strict=True)]).T
        parts = _shared(full[rows], asked[own], self.config.sweeps)
        torque = asked.copy()
        torque[own] -= full[rows] @ parts
        held = np.zeros((6, len(parts)))
        held[rows] = full[rows] * parts
        force, couple = frame.rotation @ held[:3].sum(1), frame.rotation @ held[3:].sum(1)
        flow = sum(
            part * self._given(n, "thrust") / (GRAVITY * self._given(n, "specific_impulse"))
            for n, part in zip(nozzles, parts, strict=True)
        )
        seen = {("propellant", self.body.name): states}
        for name, lever, push, part in zip(self.config.nozzles, levers, pushes, parts, strict=True):
            label = f"{self._name}.{name}"
            seen["thruster_force", label] = frame.rotation @ push * part
            seen["thruster_position", label] = frame.position + frame.rotation @ lever
        return Delivered(
            torque,
            outside=[Push(self.body.root_joint, force, couple, frame.position)],
            rates=np.array([flow]),
            taken={"thruster": float(force @ frame.velocity[:3] + couple @ frame.velocity[3:])},
            seen=seen,
        )

    def _given(self, nozzle: Nozzle, key: str) -> float:
        """A number of a nozzle, its own or the set's."""
        own = getattr(nozzle, key)
        return float(getattr(self.config, key) if own is None else own)


def _unit(nozzle: Nozzle) -> Array:
    line = np.array(nozzle.direction)
    unit: Array = line / np.linalg.norm(line)
    return unit


def _shared(full: Array, asked: Array, sweeps: int) -> Array:
    """Parts of their thrust (n,), each in turn at its least squares within 0 and 1."""
    sizes = np.linalg.norm(full, axis=1)
    scales = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0)
    matrix, left = scales[:, None] * full, scales * asked
    parts = np.zeros(full.shape[1])
    for _ in range(sweeps):
        for i, column in enumerate(matrix.T):
            best = parts[i] + (column @ left - SMALL * parts[i]) / (column @ column + SMALL)
            left = left - column * (np.clip(best, 0, 1) - parts[i])
            parts[i] = np.clip(best, 0, 1)
    return parts


@delivery_of.register
def _(actuator: Thrusters, scene: Scene, body: SceneBody, key: str) -> Jets:
    for what, found in (("mode", actuator.mode == "pulsed"), ("unload", actuator.unloads)):
        if found:
            raise ScenarioError(
                f"{'pulses have' if what == 'mode' else 'has'} no second writing, so the pinocchio engine "
                "cannot check it; take `simulation.engine: casadi`",
                source=scene.source,
                where=f"{body.path}.{key}.{what}",
            )
    return Jets(scene, body, actuator, key)
