"""External impulse as a state, so that momentum minus impulse is constant."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from spacerobot.dynamics import Wrench
from spacerobot.dynamics.algebra import cross
from spacerobot.elements import Output, State
from spacerobot.scene import Scene
from spacerobot.symbolic import Plant

KINDS = {
    "linear": ("N s", "impulse from outside since the start"),
    "angular": ("N m s", "angular impulse from outside about the world's origin since the start"),
}


@dataclass(frozen=True)
class ExternalImpulse:
    """External impulse since the start: states and outputs, empty without external forces."""

    states: tuple[State, ...] = ()
    outputs: tuple[Output, ...] = ()


def impulse_of(plant: Plant, wrenches: Sequence[Wrench]) -> ExternalImpulse:
    """Impulse of wrenches from outside, linear and angular about the world's origin."""
    if not wrenches:
        return ExternalImpulse()
    rates = dict(zip(KINDS, _about_origin(wrenches), strict=True))
    if plant.planar:
        rates["linear"][2] = 0
        rates["angular"][:2] = 0
    states, outputs = [], []
    for kind, (unit, text) in KINDS.items():
        symbol = ca.SX.sym(f"impulse.{kind}", 3)
        states.append(State(f"impulse.{kind}", symbol, ca.SX.zeros(3), ca.densify(rates[kind])))
        outputs.append(Output(f"impulse_{kind}", symbol, unit, text))
    return ExternalImpulse(tuple(states), tuple(outputs))


def pushes_of(plant: Plant, wrenches: Sequence[Wrench], counted: Mapping[int, ca.SX]) -> tuple[State, ...]:
    """Impulses of the actuators of bases about the world's origin, as states.

    Args:
        plant, wrenches: Mechanics, and external wrenches that actuators deliver to bases.
        counted: State symbols by the base's joint, with the components in which the scene moves.
    """
    axes, states = [*plant.translation_axes, *(axis + 3 for axis in plant.rotation_axes)], []
    for joint, symbol in counted.items():
        rate = ca.vertcat(*_about_origin([wrench for wrench in wrenches if wrench.joint_id == joint]))
        none = ca.SX.zeros(symbol.numel())
        states.append(State(symbol[0].name().rpartition("_")[0], symbol, none, ca.densify(rate[axes])))
    return tuple(states)


def _about_origin(wrenches: Iterable[Wrench]) -> tuple[ca.SX, ca.SX]:
    """Force, and torque about the world's origin (3x1 each), of wrenches together."""
    force, torque = ca.SX(3, 1), ca.SX(3, 1)
    for wrench in wrenches:
        force, torque = force + wrench.force, torque + wrench.torque + cross(wrench.point, wrench.force)
    return force, torque


def base_wrenches(scene: Scene, plant: Plant, wrenches: Sequence[Wrench]) -> Iterator[Output]:
    """Forces and torques of actuators on floating bases, about the root link's origin.

    Args:
        scene, plant, wrenches: The scene, its mechanics, and external wrenches that actuators deliver to
            bases.
    """
    for body in scene.bodies:
        acting = [wrench for wrench in wrenches if wrench.joint_id == body.root_joint]
        if not acting or not body.root_joint:
            continue
        force, torque = _about_origin(acting)
        torque = torque - cross(plant.kinematics.origin[body.root_joint], force)
        into = plant.kinematics.rotation[body.root_joint].T
        for name, unit, value in (("force", "N", force), ("torque", "N m", torque)):
            text = f"{name} of actuators on floating bases, root link's axes"
            yield Output(f"base_{name}", ca.mtimes(into, value), unit, text, "body", body.name)


def on_bases(scene: Scene, plant: Plant, torque: ca.SX) -> Iterator[Wrench]:
    """Wrenches of the generalized forces (nv x 1) that are delivered to floating bases."""
    for body in scene.bodies:
        if not body.root_joint:
            continue
        first = int(plant.model.idx_vs[body.root_joint])
        wrench = ca.sparsify(torque[first : first + int(plant.model.nvs[body.root_joint])])
        if not wrench.nnz():
            continue
        rotation, none = plant.kinematics.rotation[body.root_joint], ca.SX(1, 1)
        flat = wrench.size1() == 3
        force = ca.vertcat(wrench[:2], none) if flat else wrench[:3]
        couple = ca.vertcat(none, none, wrench[2]) if flat else wrench[3:]
        yield Wrench(
            body.root_joint,
            ca.mtimes(rotation, force),
            ca.mtimes(rotation, couple),
            plant.kinematics.origin[body.root_joint],
        )


def unbooked(scene: Scene) -> tuple[str, ...]:
    """Reason why momentum is not conserved although the external impulse is accounted for."""
    causes = []
    if any(body.base.joint == "fixed" for body in scene.bodies):
        causes.append("a base is fixed")
    if any(scene.scenario.gravity):
        causes.append("gravity acts")
    return tuple(causes)
