"""What can be observed, under the names and in the order of :mod:`spacerobot.closedloop.outputs`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.scenario import Robot
from spacerobot.scenario.sensors import Sensors
from spacerobot.scene import SceneBody, SceneTip
from tests.oracles.engine.engine import Engine, Instant
from tests.oracles.engine.joint_control import angle_of
from tests.oracles.engine.kinematics import rotation_vector
from tests.oracles.engine.outside import on_bases
from tests.oracles.engine.sensing import reading_of, sensors_of


def outputs_at(engine: Engine, t: float, x: Array, within: float | None = None) -> dict[str, Array]:
    """Named outputs, each (n,); arguments and errors as for :meth:`Engine.derivative`."""
    instant = engine.instant(t, x, within)
    found = _tips(engine, instant) | _bodies(engine, instant)
    columns = sorted(engine.model.idx_vs[joint] for body in engine.scene.bodies for joint in body.arm_joints)
    found["joint_torque"] = instant.solution.torque[columns]
    found |= _driven(engine, instant)
    found |= (
        _grasps(engine, instant)
        | _lives(engine, instant)
        | _contacts(engine, instant, x)
        | _measured(engine, instant)
        | _energies(engine, instant)
    )
    for around in instant.surroundings:
        found |= around.seen
    z, count = engine.split(x)[2], len(engine.works)
    works = z[-count:]
    if engine.impulse:
        found |= {"impulse_linear": z[-count - 6 : -count - 3], "impulse_angular": z[-count - 3 : -count]}
    found |= {f"work_{name}": works[i : i + 1] for i, name in enumerate(engine.works)}
    return found | _base_wrenches(engine, instant)


def _tips(engine: Engine, instant: Instant) -> dict[str, Array]:
    tips = [(instant.kinematics.frame(t.frame), instant.motions[t.label]) for t in engine.scene.tips]
    return {
        "tip_position": _stack(frame.position for frame, _ in tips),
        "tip_velocity": _stack(frame.velocity[:3] for frame, _ in tips),
        "tip_reference": _stack(motion.position for _, motion in tips),
        "tip_error": _stack(motion.position - frame.position for frame, motion in tips),
        "tip_orientation_error": _stack(
            rotation_vector(motion.rotation, frame.rotation) for frame, motion in tips
        ),
    }


def _bodies(engine: Engine, instant: Instant) -> dict[str, Array]:
    bodies, kinematics = engine.scene.bodies, instant.kinematics
    frames = [kinematics.frame(body.root_frame) for body in bodies]
    momenta = []
    for body in bodies:
        total = np.zeros(6)
        for joint in body.subtree:
            own = engine.model.inertias[joint] * kinematics.data.v[joint]
            total += kinematics.data.oMi[joint].act(own).vector
        momenta.append(total)
    whole = np.array(_total_momentum(kinematics.model, kinematics.q, kinematics.v))
    for stored in (part for one in instant.solution.delivered for part in one.stored):
        momenta[[body.name for body in bodies].index(stored.body)][3:] += stored.momentum
        whole[3:] += stored.momentum
    return {
        "body_position": _stack(frame.position for frame in frames),
        "body_rotation": _stack(
            rotation_vector(frame.rotation, first)
            for frame, first in zip(frames, engine.root_rotations, strict=True)
        ),
        "body_momentum_linear": _stack(momentum[:3] for momentum in momenta),
        "body_momentum_angular": _stack(momentum[3:] for momentum in momenta),
        "momentum_linear": whole[:3],
        "momentum_angular": whole[3:],
    }


def _driven(engine: Engine, instant: Instant) -> dict[str, Array]:
    """What actuators show; of those of bodies, not a number where there is none."""
    named: dict[str, dict[str, Array]] = {}
    for (name, label), value in (pair for one in instant.solution.delivered for pair in one.seen.items()):
        own = named.setdefault(name, {})
        own[label] = own.get(label, 0.0) + value
    bodies, found = [body.name for body in engine.scene.bodies], {}
    for name, values in named.items():
        none = np.full(len(next(iter(values.values()))), np.nan)
        of_bodies = set(values) <= set(bodies)
        found[name] = _stack(values.get(label, none) for label in (bodies if of_bodies else values))
    return found


def _base_wrenches(engine: Engine, instant: Instant) -> dict[str, Array]:
    """What actuators put on floating bases from outside, by Pinocchio's wrenches; else not a number."""
    given = [push for one in instant.solution.delivered for push in one.outside]
    direct = on_bases(engine.scene, instant.kinematics, instant.solution.torque)
    given += [push for push in direct if np.any(push.force) or np.any(push.torque)]
    placed, wrenches = instant.kinematics.data.oMi, dict[int, pin.Force]()
    for push in given:
        at_origin = pin.SE3(np.eye(3), push.point).act(pin.Force(push.force, push.torque))
        wrenches.setdefault(push.joint, pin.Force.Zero())
        wrenches[push.joint] += placed[push.joint].actInv(at_origin)
    own = {joint: one for joint, one in wrenches.items() if joint}
    roots, none = [body.root_joint for body in engine.scene.bodies], pin.Force(np.full(6, np.nan))
    parts = {"base_force": "linear", "base_torque": "angular"} if own else {}
    return {
        name: _stack(np.array(getattr(own.get(root, none), part)) for root in roots)
        for name, part in parts.items()
    }


def _total_momentum(model: pin.Model, q: Array, v: Array) -> Array:
    """Linear momentum, and angular momentum about the world's origin (6,), by Pinocchio's centroidal one."""
    data = model.createData()
    momentum = pin.computeCentroidalMomentum(model, data, q, v)
    linear = np.array(momentum.linear)
    return np.concatenate([linear, momentum.angular + np.cross(data.com[0], linear)])


def _grasps(engine: Engine, instant: Instant) -> dict[str, Array]:
    none = np.zeros(3), np.zeros(3)
    rigid = {grasp.name: (force, torque) for grasp, _, force, torque in instant.solution.wrenches}
    compliant = iter(instant.couplings)
    wrenches = []
    for grasp in engine.scene.grasps:
        if grasp.name in rigid or not engine.is_closed(grasp.name):
            wrenches.append(rigid.get(grasp.name, none))
        else:
            coupling = next(compliant)
            wrenches.append((coupling.force, coupling.torque))
    return {
        "grasp_force": _stack(force for force, _ in wrenches),
        "grasp_torque": _stack(torque for _, torque in wrenches),
        "grasp_gap": _stack(relative.apart for relative in instant.relatives),
    }


def _lives(engine: Engine, instant: Instant) -> dict[str, Array]:
    """States of grasps and what is remembered of captures, not a number where a grasp has none; the phase."""
    lives, found = engine.mode.lives, dict[str, Array]()
    if engine.mode.phase:
        found["phase"] = np.array([float(list(engine.laws).index(engine.mode.phase))])
    caught = {grasp.name for grasp in engine.scene.grasps if grasp.config.capture is not None}
    struck = {grasp.name for grasp in engine.scene.grasps if grasp.config.is_rigid}
    turned = {g.name: r.turned for g, r in zip(engine.scene.grasps, instant.relatives, strict=True)}
    shown: dict[str, tuple[set[str], Callable[[str], Any]]] = {
        "grasp_state": (set(lives), lambda name: lives[name].state),
        "grasp_misalignment": (set(lives), lambda name: turned[name]),
        "grasp_captured_at": (caught, lambda name: lives[name].captured_at),
        "grasp_capture_gap": (caught, lambda name: lives[name].gap),
        "grasp_capture_velocity": (caught, lambda name: lives[name].velocity),
        "grasp_capture_spin": (caught, lambda name: lives[name].spin),
        "grasp_impulse": (struck, lambda name: lives[name].impulse),
        "grasp_impulse_couple": (struck, lambda name: lives[name].couple),
    }
    for key, (declaring, value) in shown.items():
        if declaring & set(lives):
            size = 1 if key in ("grasp_state", "grasp_captured_at") else 3
            found[key] = _stack(
                np.atleast_1d(value(g.name)).astype(float)
                if g.name in declaring & set(lives)
                else np.full(size, np.nan)
                for g in engine.scene.grasps
            )
    return found


def _measured(engine: Engine, instant: Instant) -> dict[str, Array]:
    """Signals that sensors with errors measure; not a number where nothing reads them."""
    signals: dict[str, dict[str, Array]] = {signal: {} for signal in Sensors.model_fields}
    for tip in engine.scene.tips:
        reads = {name for key, one in tip.config.elements() for name in one.reads(key, tip.config.sections)}
        _read(engine, instant, (tip.body, tip, reads), signals)
    for body in engine.scene.robots:
        if isinstance(body.config, Robot):
            reads = {name for _, one in body.config.elements() for name in one.reads()}
            for tip in engine.scene.tips:
                if tip.body is body:
                    _read(engine, instant, (body, tip, {n for n in reads if n.startswith("tip_")}), signals)
            _read(engine, instant, (body, None, {n for n in reads if n.startswith("joint_")}), signals)
    joints = dict.fromkeys(label for name in ("joint_position", "joint_rate") for label in signals[name])
    labels = {True: list(joints), False: [tip.label for tip in engine.scene.tips]}
    return {
        f"measured_{name}": _stack(
            values.get(label, np.full(1 if label in joints else 3, np.nan))
            for label in labels[name.startswith("joint_")]
        )
        for name, values in signals.items()
        if values
    }


def _read(
    engine: Engine,
    instant: Instant,
    reader: tuple[SceneBody, SceneTip | None, set[str]],
    signals: dict[str, dict[str, Array]],
) -> None:
    """Add the readings of continuous sensors with errors, which a reader reads, to the signals."""
    body, tip, reads = reader
    kinematics, model = instant.kinematics, engine.model
    true: dict[str, dict[str, Array]] = {}
    joints = body.driven_joints if tip is None else body.arm_joints
    names = {joint: f"{body.name}/{body.joint_name(model, joint)}" for joint in joints}
    true["joint_position"] = {
        name: np.atleast_1d(angle_of(model.joints[j], kinematics.q)) for j, name in names.items()
    }
    true["joint_rate"] = {name: kinematics.v[[model.joints[j].idx_v]] for j, name in names.items()}
    if tip is not None:
        frame, wanted = kinematics.frame(tip.frame), instant.motions[tip.label].rotation
        felt = kinematics.felt.get(tip.label, np.zeros(6))
        values = {
            "tip_position": frame.position,
            "tip_orientation": rotation_vector(frame.rotation, wanted),
            "tip_velocity": frame.velocity[:3],
            "tip_angular_velocity": frame.velocity[3:],
            "tip_force": felt[:3],
            "tip_torque": felt[3:],
        }
        true |= {name: {tip.label: value} for name, value in values.items()}
    for name in reads & set(true):
        sensor = sensors_of(body)[name]
        if not sensor.is_ideal:
            read = reading_of(sensor)
            signals[name] |= {key: read.offset + read.scale * value for key, value in true[name].items()}


def _contacts(engine: Engine, instant: Instant, x: Array) -> dict[str, Array]:
    """Whole forces, what they amount to, and the nearest pair of shapes of each contact."""
    found = list(instant.pressures.values())
    if not found:
        return {}
    since = engine.split(x)[2][engine.touched].reshape(-1, 4)
    nearest = [min((p.touch for p in several), key=lambda touch: touch.gap) for several in found]
    return {
        "contact_force": np.concatenate([sum(p.force for p in several) for several in found]),
        "contact_normal_force": np.array([sum(p.normal_force for p in several) for several in found]),
        "contact_gap": np.array([touch.gap for touch in nearest]),
        "contact_point": _stack(touch.point for touch in nearest),
        "contact_velocity": _stack(touch.velocity for touch in nearest),
        "contact_impulse": since[:, :3].ravel(),
        "contact_loss": since[:, 3],
    }


def _energies(engine: Engine, instant: Instant) -> dict[str, Array]:
    model, kinematics = engine.model, instant.kinematics
    data = model.createData()
    held = sum(part.energy for one in instant.solution.delivered for part in one.stored)
    return {
        "energy_kinetic": np.array(
            [pin.computeKineticEnergy(model, data, kinematics.q, kinematics.v) + held]
        ),
        "energy_spring": np.array(
            [
                sum(coupling.energy for coupling in instant.couplings)
                + sum(p.energy for several in instant.pressures.values() for p in several)
            ]
        ),
        "energy_potential": np.array([pin.computePotentialEnergy(model, data, kinematics.q)]),
    }


def _stack(vectors: Iterable[Array]) -> Array:
    return np.concatenate([np.empty(0), *vectors])
