"""Outputs of the closed loop: of tips, bodies, joints, the whole system, and of its elements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import casadi as ca

from spacerobot.closedloop.closed_loop import OutputVariable
from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.closedloop.loop_parts import Sample
from spacerobot.dynamics import momentum
from spacerobot.elements import Output, StoredMomentum
from spacerobot.elements.grasps.grasp import OBSERVED
from spacerobot.elements.sensors.signals import MEASURED, SIGNALS
from spacerobot.scene import Scene

VECTORS: dict[str, tuple[str, str, str]] = {
    "tip_position": ("tip", "m", "position of tips"),
    "tip_velocity": ("tip", "m/s", "velocity of tips"),
    "tip_reference": ("tip", "m", "reference position of tips"),
    "tip_error": ("tip", "m", "reference minus position of tips"),
    "tip_orientation_error": ("tip", "rad", "rotation vector from tips to their references"),
    "body_position": ("body", "m", "position of bodies' root links"),
    "body_rotation": ("body", "rad", "rotation vector of bodies' root links since the start"),
    "body_momentum_linear": ("body", "N s", "linear momentum of bodies"),
    "body_momentum_angular": ("body", "N m s", "angular momentum of bodies about the world's origin"),
}
"""Vectors in world axes that every result has, even without labels."""


def core_outputs(builder: LoopBuilder, torque: ca.SX, stored: Sequence[StoredMomentum]) -> Iterator[Output]:
    """Outputs of tips, bodies, joints and the whole system.

    Args:
        builder: Builder of the closed loop.
        torque: Generalized forces of the joints (nv x 1).
        stored: Momenta in addition to those of the links.
    """
    for name, (dimension, unit, text) in VECTORS.items():
        yield Output(name, ca.SX(3, 1), unit, text, dimension)
    values: dict[tuple[str, str], ca.SX] = {}
    plant = builder.plant
    for tip in builder.scene.tips:
        rotation, origin = plant.placement(tip.frame)
        motion = builder.motions[tip.label]
        values |= {
            ("tip_position", tip.label): origin,
            ("tip_velocity", tip.label): plant.velocity(tip.frame)[0],
            ("tip_reference", tip.label): motion.position,
            ("tip_error", tip.label): motion.position - origin,
            ("tip_orientation_error", tip.label): plant.orientation_error(motion.rotation, rotation),
        }
    for body in builder.scene.bodies:
        rotation, origin = plant.placement(body.root_frame)
        p, h = momentum(plant.model, plant.kinematics, plant.inertias, joints=body.subtree, about=ca.SX(3, 1))
        values |= {
            ("body_position", body.name): origin,
            ("body_rotation", body.name): plant.orientation_error(
                rotation, builder.first_rotations[body.name]
            ),
            ("body_momentum_linear", body.name): p,
            ("body_momentum_angular", body.name): h,
        }
    for part in stored:
        values["body_momentum_angular", part.body] += part.angular
    for (name, label), value in values.items():
        dimension, unit, text = VECTORS[name]
        yield Output(name, value, unit, text, dimension, label)
    total = {
        kind: sum((values[f"body_momentum_{kind}", body.name] for body in builder.scene.bodies), ca.SX(3, 1))
        for kind in ("linear", "angular")
    }
    yield Output("momentum_linear", total["linear"], "N s", "linear momentum of everything")
    about = "angular momentum of everything about the world's origin"
    yield Output("momentum_angular", total["angular"], "N m s", about)
    model = builder.plant.model
    columns = sorted(int(model.idx_vs[joint]) for body in builder.scene.bodies for joint in body.arm_joints)
    yield Output("joint_torque", torque[columns], "N m or N", "actuator torques", "joint")
    for name, (unit, text) in OBSERVED.items():
        yield Output(name, ca.SX(3, 1), unit, text, "grasp")


def measured_outputs(builder: LoopBuilder) -> Iterator[Output]:
    """Outputs ``measured_SIGNAL`` of each signal that a sensor with errors measures, in the order of SIGNALS.

    They are the last samples of sampling sensors, and the present readings of continuous ones. References and
    estimators sample a signal separately from controllers. If several of them sample it for one robot or tip,
    the output has the controllers' samples, otherwise those of the first estimator.

    Args:
        builder: Builder of the closed loop whose elements are all built.
    """
    of_tips = {
        (signal, label): Sample(signal, "tip", label, value)
        for label, lead in builder.leads.items()
        for signal, value in lead.measured.items()
    }
    order = list(SIGNALS)
    for sample in sorted((of_tips | builder.samples).values(), key=lambda one: order.index(one.signal)):
        value = sample.value
        if sample.body and value.size2() == 3:
            value = builder.plant.orientation_error(value, builder.first_rotations[sample.body])
        unit, text = SIGNALS[sample.signal]
        name, text = f"{MEASURED}{sample.signal}", f"measured {text}"
        yield Output(name, ca.densify(value), unit, text, sample.dimension, sample.label)


def added_up(outputs: Iterable[Output]) -> list[Output]:
    """Outputs in which those with the same name and label are added."""
    sums: dict[tuple[str, str], Output] = {}
    for output in outputs:
        key = (output.name, output.label)
        earlier = sums.get(key)
        sums[key] = output if earlier is None else replace(earlier, value=earlier.value + output.value)
    return list(sums.values())


def combine(scene: Scene, outputs: Iterable[Output]) -> tuple[tuple[OutputVariable, ...], dict[str, ca.SX]]:
    """Variables of the result, and their expressions: outputs of one name stacked in the scene's order.

    Outputs that other elements of a dimension declare are NaN for an element that does not.
    """
    labels = {
        "tip": [tip.label for tip in scene.tips],
        "body": [body.name for body in scene.bodies],
        "grasp": [grasp.name for grasp in scene.grasps],
        "contact": [contact.name for contact in scene.contacts],
    }
    outputs_by_name: dict[str, list[Output]] = {}
    for output in outputs:
        outputs_by_name.setdefault(output.name, []).append(output)
        if output.dimension and output.dimension != "joint":
            names = labels.setdefault(output.dimension, [])
            names += [output.label] * (bool(output.label) and output.label not in names)
    variables, expressions = [], {}
    for name, parts in outputs_by_name.items():
        first = parts[0]
        size, axes = first.value.size1(), (first.dimension,) if first.dimension else ()
        names = labels.get(first.dimension or "", [])
        if first.dimension in labels:
            by_label = {part.label: part.value for part in parts}
            missing = ca.SX.nan(size, 1)
            stacked = [by_label.get(label, missing) for label in names]
            expressions[name] = ca.densify(ca.vertcat(*stacked)) if stacked else ca.SX(0, 1)
        else:
            expressions[name] = ca.densify(first.value)
        if first.dimension != "joint" and size == 3:
            axes = (*axes, "axis")
        variables.append(OutputVariable(name, axes, first.unit, first.text, tuple(names), first.plotted))
    return tuple(variables), expressions
