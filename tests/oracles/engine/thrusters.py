"""Thrusters, written again: what each does in world axes, shared by active sets of scipy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import lsq_linear, nnls

from spacerobot.common.arrays import Array
from spacerobot.elements.actuators.allocation import EVEN, NEAREST
from spacerobot.elements.actuators.thrusters import GRAVITY, WHOLE, Nozzle, Thrusters
from spacerobot.elements.core.clock import EARLY
from spacerobot.scene import Scene, SceneBody
from tests.oracles.engine.actuation import Delivered, Now, Push, Turn, base_columns, delivery_of
from tests.oracles.engine.kinematics import Kinematics

ROUNDING = 1e-9
"""By which parts may pass 0 and 1 before they are cut, else none might give the same wrench."""


@dataclass(frozen=True)
class Jets:
    """Thrusters of one section.

    Their state is the propellant that they have spent; where they are pulsed, also the number of the next
    decision and when each is cut off.
    """

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
        """All of them, but none where pulses are to do all that is asked."""
        return () if self._pulsed and self.config.unload is None else self.columns

    @property
    def _pulsed(self) -> bool:
        return self.config.mode == "pulsed"

    @property
    def _name(self) -> str:
        return f"{self.body.name}/{self.key.rpartition('.')[2]}"

    @property
    def state_names(self) -> tuple[str, ...]:
        """The propellant, and times."""
        name, count = self._name, len(self.config.nozzles)
        times = (f"{name}.decisions.count[0]", *(f"{name}.off_at[{i}]" for i in range(count)))
        return (f"{name}.propellant[0]", *(times if self._pulsed else ()))

    def initial(self, kinematics: Kinematics) -> Array:
        """Nothing spent, and a decision due."""
        del kinematics
        return np.zeros(2 + len(self.config.nozzles) if self._pulsed else 1)

    def deliver(self, kinematics: Kinematics, asked: Array, states: Array, now: Now) -> Delivered:
        """Forces of all nozzles; what is missing is left to the next actuator, if any."""
        frame, own = kinematics.frame(self.body.root_frame), list(self.columns)
        nozzles = list(self.config.nozzles.values())
        levers = [np.array(nozzle.position) for nozzle in nozzles]
        pushes = [self._given(n, "thrust") * _unit(n) for n in nozzles]
        rows = [0, 1, 5] if len(own) == 3 else list(range(6))
        full = np.hstack([pushes, np.cross(levers, pushes)]).T
        flows = np.array(
            [self._given(n, "thrust") / (GRAVITY * self._given(n, "specific_impulse")) for n in nozzles]
        )
        wanted = self._wanted(frame.rotation, asked[own], now)

        def shared() -> Array:
            return _shared(full[rows], flows, wanted)

        firing = [f"{self._name}.firing.{name}" in now.on for name in self.config.nozzles]
        parts = np.array(firing, float) if self._pulsed else shared()
        torque = asked.copy()
        torque[own] = asked[own] - full[rows] @ parts if self.passes_on else 0.0
        held = np.zeros((6, len(parts)))
        held[rows] = full[rows] * parts
        force, couple = frame.rotation @ held[:3].sum(1), frame.rotation @ held[3:].sum(1)
        seen = {("propellant", self.body.name): states[:1]}
        for name, lever, push, part in zip(self.config.nozzles, levers, pushes, parts, strict=True):
            label = f"{self._name}.{name}"
            seen["thruster_force", label] = frame.rotation @ push * part
            seen["thruster_position", label] = frame.position + frame.rotation @ lever
        return Delivered(
            torque,
            outside=[Push(self.body.root_joint, force, couple, frame.position)],
            rates=np.r_[flows @ parts, np.zeros(len(states) - 1)],
            taken={"thruster": float(force @ frame.velocity[:3] + couple @ frame.velocity[3:])},
            seen=seen,
            turns=list(self._turns(now.t, states, shared)) if self._pulsed else (),
        )

    def _wanted(self, rotation: Array, asked: Array, now: Now) -> Array:
        """Wrench at the base's columns that is to be shared."""
        if self.config.unload is None:
            return asked
        turning = 1 if len(asked) == 3 else 3
        over = rotation.T @ now.wheels[self.body.name] - np.array(self.config.unload.goal)
        found: Array = np.r_[asked[:-turning], -self.config.unload.rate * over[-turning:]]
        return found

    def _turns(self, t: float, states: Array, shared: Callable[[], Array]) -> Iterator[Turn]:
        """The next decision, which puts all on, and the end of each pulse."""
        names, (spent, count, *off_at) = list(self.config.nozzles), states
        due = count * self.config.period

        def decided() -> Array:
            ends = [due + self._on_time(n, part) for n, part in zip(names, shared(), strict=True)]
            return np.array([spent, count + 1, *ends])

        switches = [f"{self._name}.firing.{name}" for name in names]
        sets = dict.fromkeys(switches, True)
        yield Turn(f"{self._name}.control", "control", self._name, t - due + EARLY, sets, decided)
        for name, switch, end in zip(names, switches, off_at, strict=True):
            label = f"{self._name}.{name}"
            yield Turn(f"{label}.cut", "cut", label, t - end, {switch: False})

    def _on_time(self, name: str, part: float) -> float:
        """On-time [s] for a part of the thrust; one of the whole period outlasts it, until decided anew."""
        nozzle, wanted = self.config.nozzles[name], part * self.config.period
        shortest, step = self._given(nozzle, "minimum_on_time"), self._given(nozzle, "resolution")
        if part >= WHOLE:
            return 2 * self.config.period
        if wanted < shortest / 2:
            return 0.0
        return max(shortest, step * np.floor(wanted / step + 0.5) if step else wanted)

    def _given(self, nozzle: Nozzle, key: str) -> float:
        """A number of a nozzle, its own or the set's."""
        own = getattr(nozzle, key)
        return float(getattr(self.config, key) if own is None else own)


def _unit(nozzle: Nozzle) -> Array:
    line = np.array(nozzle.direction)
    unit: Array = line / np.linalg.norm(line)
    return unit


def _shared(full: Array, flows: Array, asked: Array) -> Array:
    """Parts of their thrust (n,): nearest wrench, then least propellant, as one bounded least squares."""
    sizes = np.linalg.norm(full, axis=1)
    scales = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0)
    costs = NEAREST * flows / flows.mean()
    matrix = np.vstack([scales[:, None] * full, np.diag(np.sqrt(EVEN * costs))])
    goal = np.r_[scales * asked, -np.sqrt(costs / EVEN)]
    found = lsq_linear(matrix, goal, (0, 1), "bvls", tol=1e-15, max_iter=1000).x
    return _evened(scales[:, None] * full, flows / flows.mean(), found)


def _evened(matrix: Array, costs: Array, parts: Array) -> Array:
    """Of all parts (n,) of the same wrench the cheapest, which the first solve tells by e alone.

    That is the least distance to ``-1/d``, within 0 and 1: least distance programming by Lawson and Hanson.
    """
    none = null_space(matrix, rcond=1e-9)
    if not none.size:
        return parts
    basis, triangle = np.linalg.qr(np.sqrt(costs)[:, None] * none)
    along = np.linalg.solve(triangle.T, none.T).T
    best = parts - along @ basis.T @ (np.sqrt(costs) * (parts + 1 / EVEN))
    rows, least = np.vstack([along, -along]), np.r_[-best, best - 1] - ROUNDING
    factors, _ = nnls(np.vstack([rows.T, least]), np.r_[np.zeros(none.shape[1]), 1.0])
    residual = np.vstack([rows.T, least]) @ factors - np.r_[np.zeros(none.shape[1]), 1.0]
    found: Array = best - along @ (residual[:-1] / residual[-1])
    return np.where(found < 10 * ROUNDING, 0.0, np.where(found > 1 - 10 * ROUNDING, 1.0, found))


@delivery_of.register
def _(actuator: Thrusters, scene: Scene, body: SceneBody, key: str) -> Jets:
    return Jets(scene, body, actuator, key)
