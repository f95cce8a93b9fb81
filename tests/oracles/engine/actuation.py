"""What actuators deliver of the generalized forces that controllers ask for."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.elements import Actuator
from spacerobot.elements.actuators.joint_failure import JointFailure
from spacerobot.elements.actuators.momentum_observer import MomentumObserver
from spacerobot.elements.actuators.torque_limit import TorqueLimit
from spacerobot.scenario import Robot
from spacerobot.scene import Scene, SceneBody
from tests.oracles.engine.kinematics import Kinematics
from tests.oracles.engine.laws import refusal


@dataclass(frozen=True)
class Push:
    """Force [N] at a point [m] and torque [N m] on a joint's body (3,) each, world axes."""

    joint: int
    force: Array
    torque: Array
    point: Array


@dataclass(frozen=True)
class Turn:
    """An event that turns switches of an actuator; armed while one has not its value, or it sets states.

    Attributes:
        name, kind, who: As the other engine calls it.
        guard: Above zero it happens.
        sets: Whether switches are on afterwards, by name.
        states: The actuator's states (n,) afterwards, if they jump; only asked for when it happens.
    """

    name: str
    kind: str
    who: str
    guard: float
    sets: Mapping[str, bool]
    states: Callable[[], Array] | None = None


@dataclass(frozen=True)
class Now:
    """What an actuator knows beside its states and what it is asked for.

    Attributes:
        t: Time [s].
        on: Names of the switches that are on.
        wheels: Angular momentum (3,) [N m s] of each robot's wheels about their axes, world axes, by its
            name.
    """

    t: float
    on: frozenset[str]
    wheels: Mapping[str, Array]


@dataclass(frozen=True)
class Stored:
    """Angular momentum (3,) [N m s], world axes, and energy [J] beside those of a body's links."""

    body: str
    momentum: Array
    energy: float


@dataclass(frozen=True)
class Delivered:
    """What an actuator makes of what it is asked for.

    Attributes:
        torque: Generalized forces that are delivered, or left to the next one (nv,).
        inner, outside: Wrenches against what it stores, and from outside.
        rates: Of its states.
        power: Put in beside that of the generalized forces [W].
        taken: Powers by the name of their work [W].
        stored: What it holds.
        seen: Outputs by name and label.
        turns: What may happen to its switches.
    """

    torque: Array
    inner: Sequence[Push] = ()
    outside: Sequence[Push] = ()
    rates: Array = field(default_factory=lambda: np.empty(0))
    power: float = 0.0
    taken: Mapping[str, float] = field(default_factory=dict)
    stored: Sequence[Stored] = ()
    seen: Mapping[tuple[str, str], Array] = field(default_factory=dict)
    turns: Sequence[Turn] = ()


class Delivery(Protocol):
    """An actuator of one robot."""

    @property
    def from_outside(self) -> bool:
        """Whether what it delivers to a base, or beside it, comes from outside."""

    @property
    def columns(self) -> Sequence[int]:
        """Places in v that it takes over."""

    @property
    def passes_on(self) -> Sequence[int]:
        """Those of them at which it leaves what it does not deliver to the next one."""

    @property
    def works(self) -> Sequence[str]:
        """Names of works that it books beside those that there always are."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of its states."""

    def initial(self, kinematics: Kinematics) -> Array:
        """Its states at the start."""

    def deliver(self, kinematics: Kinematics, asked: Array, states: Array, now: Now) -> Delivered:
        """What it makes of the generalized forces (nv,) that it is asked for."""


@runtime_checkable
class Spinning(Protocol):
    """An actuator with wheels."""

    @property
    def body(self) -> SceneBody:
        """The robot."""

    def momentum(self, kinematics: Kinematics, states: Array) -> Array:
        """Angular momentum (3,) [N m s] of its wheels about their axes, world axes."""


@dataclass(frozen=True)
class Clip:
    """An actuator without states that bounds forces, (nv,), infinite where it has no part."""

    limits: Array
    columns: tuple[int, ...]
    passes_on: tuple[int, ...] = ()
    works: tuple[str, ...] = ()
    from_outside: bool = False
    state_names: tuple[str, ...] = ()

    def initial(self, kinematics: Kinematics) -> Array:
        """None."""
        del kinematics
        return np.empty(0)

    def deliver(self, kinematics: Kinematics, asked: Array, states: Array, now: Now) -> Delivered:
        """What is asked for, clipped."""
        del kinematics, states, now
        return Delivered(np.clip(asked, -self.limits, self.limits))


@dataclass(frozen=True)
class Failing:
    """A motor that gives a part of its torque from a time on; a brake is not written here."""

    config: JointFailure
    name: str
    columns: tuple[int, ...]
    passes_on: tuple[int, ...] = ()
    works: tuple[str, ...] = ()
    from_outside: bool = False
    state_names: tuple[str, ...] = ()

    def initial(self, kinematics: Kinematics) -> Array:
        """None."""
        del kinematics
        return np.empty(0)

    def deliver(self, kinematics: Kinematics, asked: Array, states: Array, now: Now) -> Delivered:
        """What is asked for, of one joint what is left of it."""
        del kinematics, states
        torque = asked.copy()
        if self.name in now.on:
            if self.config.mode == "locked":
                raise refusal(self.config)
            torque[list(self.columns)] *= self.config.remaining if self.config.mode == "weak" else 0.0
        turn = Turn(self.name, "failed", self.name, now.t - self.config.at, {self.name: True})
        return Delivered(torque, turns=(turn,))


@functools.singledispatch
def delivery_of(actuator: Actuator, scene: Scene, body: SceneBody, key: str) -> Delivery:
    """What an actuator delivers, of each kind; ``key`` is its place in the robot's section."""
    del scene, body, key
    raise refusal(actuator)


@delivery_of.register
def _(actuator: TorqueLimit, scene: Scene, body: SceneBody, key: str) -> Delivery:
    del key
    found = np.full(scene.model.nv, np.inf)
    by_name = {body.joint_name(scene.model, joint): joint for joint in body.driven_joints}
    for name in actuator.limits(tuple(by_name)):
        most = body.config.joints[name].torque_limit if actuator.limit is None else actuator.limit
        found[scene.model.idx_vs[by_name[name]]] = np.inf if most is None else most
    return Clip(found, tuple(map(int, np.flatnonzero(np.isfinite(found)))))


@delivery_of.register
def _(actuator: JointFailure, scene: Scene, body: SceneBody, key: str) -> Delivery:
    del key
    joint = scene.model.joints[scene.model.getJointId(f"{body.name}/{actuator.joint}")]
    return Failing(actuator, f"{body.name}/{actuator.joint}.failed", (int(joint.idx_v),))


@delivery_of.register
def _(actuator: MomentumObserver, scene: Scene, body: SceneBody, key: str) -> Delivery:
    """All of it; what it observes is held to closed forms in ``tests/elements/test_momentum_observer.py``."""
    del actuator, key
    columns = tuple(int(scene.model.idx_vs[joint]) for joint in body.arm_joints)
    return Clip(np.full(scene.model.nv, np.inf), columns)


def base_columns(scene: Scene, body: SceneBody) -> list[int]:
    """Places of a body's floating base in v."""
    joint = scene.model.joints[body.root_joint]
    return list(range(joint.idx_v, joint.idx_v + joint.nv)) if body.root_joint else []


def deliveries(scene: Scene) -> tuple[Delivery, ...]:
    """Actuators of all robots, in the order in which they act."""
    return tuple(
        delivery_of(actuator, scene, body, key)
        for body in scene.robots
        if isinstance(body.config, Robot)
        for key, actuator in body.config.driven_by()
    )
