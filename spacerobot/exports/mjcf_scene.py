"""Bodies, joints, grasps, contacts and motors of a scene in MJCF."""

from __future__ import annotations

from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin
from lxml import etree

from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.exports.mjcf_bodies import Wheels, coordinates, mjcf, motors, numbers, pose
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneShape

UNTOUCHED = 'contype="0" conaffinity="0"'
"""Attributes of geometries that collide only within explicit pairs."""
SMALLEST_INERTIA = 1e-15
"""Minimum principal inertia in MuJoCo [kg m^2]."""
PLATE = (5.0, 5.0, 0.05)
"""Half edges of the plate that replaces a half-space [m]."""


def scene_file(scene: Scene, *, visuals: bool) -> bytes:
    """Content of an indented MJCF file; see :func:`scene_mjcf`."""
    tree = etree.fromstring(scene_mjcf(scene, visuals=visuals).encode())
    etree.indent(tree)
    content: bytes = etree.tostring(tree, encoding="utf-8", xml_declaration=False)
    return content + b"\n"


def scene_mjcf(scene: Scene, *, visuals: bool = True) -> str:
    """MJCF of a scene.

    Grasps are equality constraints between sites: ``weld``, or ``connect`` if the orientation is free. They
    are active if the grasp begins closed. Contacts are ``pair`` elements of geometries. Driven joints have
    motors with the joints' torque limits. Mimic joints are ``joint`` equality constraints.

    Args:
        scene: The scene.
        visuals: Whether to include visual shapes.

    Raises:
        SpaceRobotError: If a body has no inertia about some axis, as segments of flexible links do.
    """
    joints = range(1, scene.model.njoints)
    inertias = {scene.model.names[k]: scene.model.inertias[k].inertia for k in joints}
    if thin := [name for name, one in inertias.items() if np.linalg.eigvalsh(one)[0] <= SMALLEST_INERTIA]:
        raise SpaceRobotError(
            f"MuJoCo needs an inertia about every axis; none has what moves with {', '.join(thin)}; "
            "segments of flexible links are exported with these joints locked",
            where="format mjcf",
        )
    wheels, speeds = scene_wheels(scene)
    inside: dict[int, list[str]] = {}
    assets = _visuals(scene, inside) if visuals else ""
    equality = _grasps(scene, inside) + "".join(
        f"<joint joint1={quoteattr(scene.model.names[tie.joint])} "
        f'joint2={quoteattr(scene.model.names[tie.leader])} polycoef="{tie.offset:.17g} '
        f'{tie.multiplier:.17g} 0 0 0"/>'
        for tie in scene.ties
    )
    contact = _contacts(scene, inside)
    position, velocity = coordinates(scene, scene.q, scene.v, speeds)
    step = scene.scenario.simulation.step or 0.002
    gravity = numbers(scene.model.gravity.linear)
    sections = [
        f'<option integrator="RK4" timestep="{step:.17g}" gravity="{gravity}"/>',
        f"<asset>{assets}</asset>",
        f"<equality>{equality}</equality>",
        f"<contact>{contact}</contact>",
        _actuators(scene, wheels),
        f'<keyframe><key name="initial" qpos="{numbers(position)}" qvel="{numbers(velocity)}"/></keyframe>',
    ]
    return mjcf(
        scene,
        more="".join(sections),
        inside={joint: "".join(parts) for joint, parts in inside.items()},
        wheels=wheels or None,
        joint_attributes=_joint_attributes(scene),
    )


def scene_wheels(scene: Scene) -> tuple[Wheels, dict[int, Array]]:
    """Wheels of all floating bases in space, and their speeds [rad/s], by the joint of the base."""
    wheels, speeds = dict[int, tuple[Array, float]](), dict[int, Array]()
    for body in scene.robots:
        for actuator in body.config.actuators.values():  # type: ignore[union-attr]
            storage = actuator.momentum_storage()
            if storage is not None and body.root_joint and scene.model.nvs[body.root_joint] == 6:
                wheels[body.root_joint] = storage.axes, storage.inertia
                speeds[body.root_joint] = np.array(storage.speeds)
    return wheels, speeds


def _joint_attributes(scene: Scene) -> dict[int, str]:
    """MJCF attributes of joints: range, and stiffness of flexible links' joints."""
    attributes = dict[int, str]()
    for body in scene.bodies:
        springs = body.spring_constants
        for joint in body.description.joints:
            if joint.kind == "fixed":
                continue
            index = int(scene.model.getJointId(f"{body.name}/{joint.name}"))
            text = ""
            if np.isfinite(joint.lower) and np.isfinite(joint.upper) and joint.lower < joint.upper:
                text += f' range="{numbers([joint.lower, joint.upper])}"'
            if joint.name in springs:
                text += f' stiffness="{springs[joint.name][0]:.17g}"'
            attributes[index] = text
    return attributes


def _actuators(scene: Scene, wheels: Wheels) -> str:
    """MJCF of the motors of driven joints, with names and torque limits of the joints, and of wheels."""
    text = ""
    for body in scene.bodies:
        for joint in body.driven_joints:
            name = quoteattr(scene.model.names[joint])
            limit = body.config.joints[body.joint_name(scene.model, joint)].torque_limit
            bounds = f' ctrlrange="{numbers([-limit, limit])}"' if limit is not None else ""
            text += f"<motor name={name} joint={name}{bounds}/>"
    names = [
        f"{'' if len(wheels) == 1 else scene.model.names[joint].partition('/')[0] + '/'}wheel_{i}"
        for joint, (axes, _) in wheels.items()
        for i in range(axes.shape[1])
    ]
    more = motors(names).removeprefix("<actuator>").removesuffix("</actuator>")
    return f"<actuator>{text}{more}</actuator>"


def _grasps(scene: Scene, inside: dict[int, list[str]]) -> str:
    """MJCF of the constraints of grasps; the sites are added to ``inside``.

    The site on the target is the mating frame for an open grasp. For a closed one it is the initial pose of
    the tip, so that the constraint preserves the initial relative pose.
    """
    data, text = scene.model.createData(), ""
    pin.framesForwardKinematics(scene.model, data, scene.q)
    for grasp in scene.grasps:
        tip, mate = (scene.model.frames[frame] for frame in (grasp.tip.frame, grasp.frame))
        closed = grasp.config.begins == "closed"
        at_mate = data.oMi[mate.parentJoint].actInv(data.oMf[grasp.tip.frame]) if closed else mate.placement
        names = [quoteattr(f"{grasp.name}/{end}") for end in ("tip", "mate")]
        for name, joint, placement in (
            (names[0], tip.parentJoint, tip.placement),
            (names[1], mate.parentJoint, at_mate),
        ):
            inside.setdefault(int(joint), []).append(f"<site name={name} {pose(placement)}/>")
        kind = "weld" if grasp.config.fixes_orientation or not grasp.config.fixes_position else "connect"
        active = "true" if closed else "false"
        text += (
            f"<{kind} name={quoteattr(grasp.name)} site1={names[0]} site2={names[1]} "
            f'active="{active}" solimp="0.9999 0.9999 0.001"/>'
        )
    return text


def _contacts(scene: Scene, inside: dict[int, list[str]]) -> str:
    """MJCF of pairs of geometries in contacts; the geometries are added to ``inside``."""
    text, names = "", dict[SceneShape, str]()
    for contact in scene.contacts:
        friction = getattr(contact.config, "friction", None) or 0.0
        for pair in contact.pairs:
            for shape in pair:
                if shape not in names:
                    names[shape] = f"contact_{len(names)}:{shape.label}"
                    geometry = _geometry(shape, names[shape])
                    inside.setdefault(shape.joint, []).append(geometry)
            first, second = (quoteattr(names[shape]) for shape in pair)
            condim, slide = (3, f"{friction:.17g}") if friction else (1, "0")
            text += (
                f'<pair geom1={first} geom2={second} condim="{condim}" '
                f'friction="{slide} {slide} 0.005 0.0001 0.0001"/>'
            )
    return text


def _geometry(shape: SceneShape, name: str) -> str:
    """MJCF geometry of a contact shape in the frame of its joint."""
    placement = pin.SE3(shape.placement)
    config: Any = shape.config
    if config.is_halfspace:
        # MuJoCo's planes are fixed to the world; a plate below the plane can move with a body
        placement = placement * pin.SE3(np.eye(3), np.array([0.0, 0.0, -PLATE[2]]))
        size = f'type="box" size="{numbers(PLATE)}"'
    else:
        first, *ends = config.drawing(1.0)
        size = _primitive(first.geometry.kind, first.geometry.size)
        if ends:  # a cylinder with two spheres is a capsule
            size = size.replace("cylinder", "capsule")
    return f'<geom name={quoteattr(name)} {size} {pose(placement)} {UNTOUCHED} group="3"/>'


def _primitive(kind: str, size: Array) -> str:
    """MJCF type and size of a box, cylinder or sphere, with half lengths."""
    halves = size / 2 if kind == "box" else [size[0], *(length / 2 for length in size[1:])]
    return f'type="{kind}" size="{numbers(halves)}"'


def _visuals(scene: Scene, inside: dict[int, list[str]]) -> str:
    """MJCF of the assets of meshes; the visual shapes are added to ``inside``."""
    from viz.drawing.meshes import mesh_file, shown_meshes
    from viz.drawing.motion import scene_nodes

    nodes = scene_nodes(scene)
    files = [mesh_file(s.geometry) for node in nodes for s in node.solids if s.geometry.kind == "mesh"]
    meshes, assets = shown_meshes(files), ""
    for k, mesh in enumerate(meshes.values()):
        corners, faces = numbers(mesh.vertices.astype("f4")), " ".join(map(str, mesh.triangles.ravel()))
        # a shell has an inertia even if the mesh is not closed
        assets += f'<mesh name="mesh_{k}" inertia="shell" vertex="{corners}" face="{faces}"/>'
    places = {file: k for k, file in enumerate(meshes)}
    for node in nodes:
        for solid in node.solids:
            if solid.geometry.kind == "mesh":
                size = f'type="mesh" mesh="mesh_{places[mesh_file(solid.geometry)]}"'
            else:
                size = _primitive(solid.geometry.kind, solid.geometry.size)
            inside.setdefault(node.joint, []).append(
                f"<geom {size} {pose(pin.SE3(solid.placement))} {UNTOUCHED} "
                f'group="2" rgba="{numbers(solid.rgba)}"/>'
            )
    return assets
