"""Assumptions and warnings about a scene, as sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.description.bodies import odd_bodies
from spacerobot.scenario import Robot
from spacerobot.scene.checks import resolved_bodies, robot_elements, robot_facts
from spacerobot.scene.configure import initial_state
from spacerobot.scene.contacts import dome_warnings
from spacerobot.scene.envelope_checks import envelope_warnings, mating_warnings
from spacerobot.scene.grasp_closing import find_closings, has_loops, is_rigid, open_grasps
from spacerobot.scene.reference_checks import reference_warnings
from spacerobot.scene.scene import Scene, SceneBody

SLIP = 1e-9  # [m/s, rad/s, deg/s] that a described velocity may differ from the one that begins


def list_assumptions(scene: Scene) -> tuple[str, ...]:
    """Sentences on all assumptions, in the order of the scenario."""
    assumptions = (
        ["nothing can leave the x-y plane: two translations and one rotation"] if scene.planar else []
    )
    if not any(scene.scenario.gravity) and not scene.scenario.environment:
        assumptions.append("no gravity, no orbital motion: the world frame is inertial")
    for name, environment in scene.scenario.environment.items():
        assumptions += [f"environment.{name}: {assumed}" for assumed in environment.assumptions()]
    for body in scene.bodies:
        for closing in find_closings(scene.bodies, scene.grasps):
            if closing.body is body:
                placement = _base_motion(scene, body)[0]
                x, y, z = placement.translation
                turn = np.degrees(pin.rpy.matrixToRpy(placement.rotation)) + 0.0
                turned = f", turned by {_vector(turn)} deg," if closing.aligns else ""
                follows = f"; its velocity {'and spin follow' if closing.sets_spin else 'follows'}"
                assumptions.append(
                    f"{body.path}.base: placed at ({x:.4f}, {y:.4f}, {z:.4f}) m{turned} so that grasp "
                    f"{closing.grasp.name!r} closes{' aligned' if closing.aligns else ''}"
                    + (follows if closing.sets_velocity else "")
                )
        section = scene.scenario.target if body.name == "target" else scene.scenario.robots[body.name]
        locked = [name for name, joint in (section.joints if section else {}).items() if joint.locked]
        if locked:
            assumptions.append(f"{body.path}: locked where they begin: {', '.join(locked)}")
        changed = []
        for link in body.description.links:
            mass_section = body.config.links.get(link.name)
            if (
                mass_section is not None
                and mass_section.mass != link.mass
                and mass_section.inertia_at_mass is not None
            ):
                changed.append(link.name)
        if changed:
            assumptions.append(
                f"{body.path}: inertia scaled with the mass, which is not the URDF's (give `inertia` if it "
                f"shall not be): {', '.join(changed)}"
            )
        if isinstance(body.config, Robot):
            controlled = any(any(tip.config.elements()) for tip in scene.tips if tip.body is body)
            if not controlled and not any(body.config.elements()):
                assumptions.append(f"{body.path}: no controller, so its joints are passive")
            if body.config.sensors is None:
                assumptions.append(f"{body.path}: ideal sensors (a = 0, b = 1)")
            names = robot_facts(scene, body).joints
            if not any(actuator.limits(names) for _, actuator in body.config.driven_by()):
                assumptions.append(
                    f"{body.path}: torques are not limited; an actuator of kind torque_limit limits them"
                )
    for tip in scene.tips:
        place = f"{tip.path}.reference"
        if any(reference.from_target for reference in tip.references):
            assumptions.append(f"{tip.path}: reference derived from the target's, rigidly")
        elif tip.config.reference is None and tip.references[-1].path == place and any(tip.config.elements()):
            assumptions.append(f"{tip.path}: no reference given, so it holds its initial pose")
        for key, controller in tip.config.elements():
            assumptions += [f"{tip.path}.{key}: {assumed}" for assumed in controller.assumptions()]
    for _, path, element in robot_elements(scene):
        assumptions += [f"{path}: {assumed}" for assumed in element.assumptions()]
    released = {name for phase in scene.scenario.phases.values() for name in phase.releases}
    for grasp in scene.grasps:
        assumptions += [
            f"{grasp.path}: {sentence}"
            for sentence in (
                *grasp.config.assumptions(),
                grasp.config.life(released_by_phase=grasp.name in released),
            )
        ]
        if is_rigid(grasp) and grasp in open_grasps(scene):
            assumptions.append(
                f"{grasp.path}: no base can close it: positions must meet as given, initial velocities "
                "change by the impulse of closing"
            )
    for contact in scene.contacts:
        assumptions += [f"{contact.path}: {assumed}" for assumed in contact.config.assumptions()]
    if scene.contacts:
        assumptions.append(
            "no contact except in the grasps and contacts: other shapes may pass through each other"
        )
    elif scene.grasps:
        assumptions.append("no contact except in the grasps: bodies may pass through each other")
    return tuple(assumptions)


def list_warnings(scene: Scene) -> tuple[str, ...]:
    """Warnings about URDFs, postures, and sensors and references without effect."""
    warnings: list[str] = []
    for body in scene.bodies:
        warnings += [f"{body.path}: {warning}" for warning in body.description.warnings]
        bodies = resolved_bodies(body.config, body.description)
        pieces = tuple(f"{name}_" for name in body.config.flexible)
        odd = odd_bodies(bodies, floating=bool(body.root_joint), pieces=pieces)
        warnings += [f"{body.path}: {warning}" for warning in odd]
        for joint in body.description.joints:
            state = body.config.joints.get(joint.name)
            if state is None or joint.kind == "continuous":
                continue
            turns = joint.kind == "revolute"
            value = np.radians(state.angle_deg or 0.0) if turns else state.offset or 0.0
            if not joint.lower <= value <= joint.upper:
                begin, lower, upper = (
                    f"{np.degrees(x) if turns else x:.4g}" for x in (value, joint.lower, joint.upper)
                )
                unit = "deg" if turns else "m"
                warnings.append(
                    f"{body.path}.joints.{joint.name}: begins at {begin} {unit}, outside the URDF's limits "
                    f"{lower} to {upper} {unit}; limits are not enforced"
                )
        # sensor errors of a signal that no controller of the robot feeds back
        config = body.config
        if isinstance(config, Robot) and config.sensors is not None:
            read = {signal for _, controller in config.elements() for signal in controller.reads()}
            read |= {signal for estimator in config.estimators.values() for signal in estimator.reads()}
            for tip in scene.tips:
                if tip.body is body:
                    for key, controller in tip.config.elements():
                        read |= controller.reads(key, tip.config.sections)
                    for reference in tip.references:
                        read |= reference.config.reads()
            texts = {signal: field.description for signal, field in type(config.sensors).model_fields.items()}
            for signal, sensor in config.sensors:
                if signal not in read and not sensor.is_ideal:
                    warnings.append(
                        f"{body.path}.sensors.{signal}: without effect, nothing of this robot reads it "
                        f"({texts[signal]})"
                    )
    # grasps that cannot close or release before the simulation ends
    duration = scene.scenario.simulation.duration
    for grasp in scene.grasps:
        capture, release = grasp.config.capture, grasp.config.release
        for key, time, effect in (
            ("capture.at", None if capture is None else capture.at, "closes"),
            ("capture.dwell", None if capture is None else capture.dwell, "closes"),
            ("release.at", None if release is None else release.at, "releases"),
        ):
            if time is not None and time >= duration:
                warnings.append(
                    f"{grasp.path}.{key}: never {effect}, for the simulation ends after {duration:g} s"
                )
    # warnings about pads that neither a contact nor a plan names
    plan = scene.scenario.plan
    used_pads = {side for contact in scene.scenario.contacts.values() for side in contact.between}
    for _, _, limit in plan.every_limit() if plan is not None else ():
        used_pads |= set(limit.separated.between if limit.separated is not None else ())
    warnings += [
        f"pads.{name}: without effect, no contact names it"
        for name in scene.scenario.pads
        if name not in used_pads
    ]
    for body, path, element in robot_elements(scene):
        warnings += [f"{path}: {caution}" for caution in element.cautions(robot_facts(scene, body))]
    # stated positions and velocities that grasps override
    for closing in find_closings(scene.bodies, scene.grasps):
        base, path, free = closing.body.base, f"{closing.body.path}.base", range(closing.axes)
        placement, linear, spin = _base_motion(scene, closing.body)
        end = f"so that grasp {closing.grasp.name!r} begins closed"
        offset = float(np.linalg.norm((placement.translation - base.position)[free]))
        if base.close_grasp is None and offset > closing.grasp.config.max_gap:
            warnings.append(f"{path}: moved {offset:.3g} m from its `position` {end}")
        if closing.sets_velocity and _gives_way(base.velocity, linear):
            warnings.append(f"{path}: `velocity` is replaced by {_vector(linear)} m/s {end}")
        if closing.sets_spin and _gives_way(base.spin_deg, np.degrees(spin)):
            warnings.append(f"{path}: `spin_deg` is replaced by {_vector(np.degrees(spin))} deg/s {end}")
    if has_loops(scene):
        described = initial_state(scene.model, scene.bodies, scene.grasps, source=scene.source)[1]
        change = float(np.abs(scene.v - described).max())
        if change > SLIP:
            names = " and ".join(repr(grasp.name) for grasp in open_grasps(scene) if is_rigid(grasp))
            warnings.append(
                f"initial velocities changed by up to {change:.3g} m/s or rad/s so that grasp {names} "
                "begins closed"
            )
    warnings += dome_warnings(scene)
    return (*warnings, *reference_warnings(scene), *envelope_warnings(scene), *mating_warnings(scene))


def _base_motion(scene: Scene, body: SceneBody) -> tuple[pin.SE3, Array, Array]:
    """Pose of a body's root link, its velocity [m/s] and spin [rad/s] (3,), world axes."""
    data = scene.model.createData()
    pin.forwardKinematics(scene.model, data, scene.q, scene.v)
    pin.updateFramePlacements(scene.model, data)
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    motion = pin.getFrameVelocity(scene.model, data, body.root_frame, world)
    return data.oMf[body.root_frame], motion.linear, motion.angular


def _gives_way(described: Sequence[float], initial: Array) -> bool:
    """Whether a nonzero value was stated that differs from the initial one."""
    return any(described) and not np.allclose(initial, described, rtol=0, atol=SLIP)


def _vector(values: Array) -> str:
    return f"({', '.join(f'{value:.4g}' for value in values)})"
