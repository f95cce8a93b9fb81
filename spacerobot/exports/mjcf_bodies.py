"""MJCF of a scene's bodies, for MuJoCo, Basilisk and Drake, and conversion of coordinates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.scene import Scene

PLANAR = (("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("r", "hinge", "0 0 1"))
"""Joints of a planar base: suffix, type and axis."""
WHEEL_MASS = 1.0
"""Mass of each wheel [kg], subtracted from its base: only the axial inertia is added to the model."""
Wheels = Mapping[int, tuple[Array, float]]
"""Axes of wheels (3 x n) and their axial inertia [kg m^2], by the joint of the base."""


def numbers(values: object) -> str:
    """Text of numbers in full precision, separated by spaces."""
    return " ".join(f"{x:.17g}" for x in np.ravel(np.asarray(values, dtype=float)))


def mjcf(
    scene: Scene,
    *,
    more: str = "",
    inside: Mapping[int, str] | None = None,
    wheels: Wheels | None = None,
    joint_attributes: Mapping[int, str] | None = None,
) -> str:
    """MJCF of the bodies of a scene, one body for each joint of the model.

    Links joined by fixed joints are one body with the inertia in the model.

    Args:
        scene: The scene.
        more: XML of further sections: options, motors, equality constraints.
        inside: XML of geometries and sites by joint of the model; 0 for the world.
        wheels: Wheels of bases.
        joint_attributes: XML of further attributes of scalar joints, such as ranges, by joint of the model.
    """
    model, inside = scene.model, inside or {}
    children: dict[int, list[int]] = {}
    for joint in range(1, model.njoints):
        children.setdefault(int(model.parents[joint]), []).append(joint)
    data = model.createData()

    def body(joint: int) -> str:
        """MJCF of the body that a joint of the model moves, including its child bodies."""
        inertia, inner = model.inertias[joint], ""
        name = quoteattr(model.names[joint])
        if wheels is not None and joint in wheels:
            prefix = "" if len(wheels) == 1 else f"{model.names[joint].partition('/')[0]}/"
            inner, inertia = _wheels(inertia, *wheels[joint], prefix)
        damping = model.damping[model.idx_vs[joint]]
        if model.nvs[joint] == 6:
            joints = f"<freejoint name={name}/>"
        elif model.nvs[joint] == 3:
            joints = "".join(
                f'<joint name={quoteattr(f"{model.names[joint]}.{k}")} type="{t}" axis="{axis}"/>'
                for k, t, axis in PLANAR
            )
        else:
            axis = np.asarray(data.joints[joint].S).ravel()
            kind = "hinge" if axis[3:].any() else "slide"
            way = numbers(axis[3:] if kind == "hinge" else axis[:3])
            more_of_it = (joint_attributes or {}).get(joint, "")
            joints = f'<joint name={name} type="{kind}" axis="{way}" damping="{damping:.17g}"{more_of_it}/>'
        inner += inside.get(joint, "") + "".join(body(child) for child in children.get(joint, []))
        place = pose(model.jointPlacements[joint])
        return f"<body name={name} {place}>{_inertial(inertia)}{joints}{inner}</body>"

    bodies = inside.get(0, "") + "".join(body(joint) for joint in children[0])
    # angles in radians; all inertias are explicit, none is derived from geometries
    head = '<compiler angle="radian" autolimits="true" inertiafromgeom="false"/>'
    return f'<mujoco model="scene">{head}<worldbody>{bodies}</worldbody>{more}</mujoco>'


def motors(names: Iterable[str]) -> str:
    """MJCF of motors of joints, with the joints' names."""
    return f"<actuator>{''.join(f'<motor name={n!r} joint={n!r}/>' for n in names)}</actuator>"


def pose(placement: pin.SE3) -> str:
    """MJCF attributes ``pos`` and ``quat`` of a placement."""
    quat = pin.Quaternion(placement.rotation).coeffs()
    return f'pos="{numbers(placement.translation)}" quat="{numbers(np.roll(quat, 1))}"'


def _inertial(inertia: pin.Inertia) -> str:
    tensor = inertia.inertia
    full = [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
    place = f'mass="{inertia.mass:.17g}" pos="{numbers(inertia.lever)}"'
    return f'<inertial {place} fullinertia="{numbers(full)}"/>'


def _wheels(inertia: pin.Inertia, axes: Array, spin: float, prefix: str) -> tuple[str, pin.Inertia]:
    """MJCF of wheels as bodies on hinges, and the inertia of the base without them.

    The wheels' masses and transverse inertias are subtracted from the base, so that the totals are unchanged.
    The transverse inertia is 0.6 times the axial one: more than half of it, as MuJoCo requires.
    """
    across, texts, rest = 0.6 * spin, "", np.array(inertia.inertia)
    for i, axis in enumerate(axes.T):
        tensor = across * np.eye(3) + (spin - across) * np.outer(axis, axis)
        rest -= across * (np.eye(3) - np.outer(axis, axis))
        name = f"{prefix}wheel_{i}"
        texts += (
            f'<body name="{name}" pos="{numbers(inertia.lever)}">'
            f"{_inertial(pin.Inertia(WHEEL_MASS, np.zeros(3), tensor))}"
            f'<joint name="{name}" type="hinge" axis="{numbers(axis)}"/></body>'
        )
    return texts, pin.Inertia(inertia.mass - WHEEL_MASS * axes.shape[1], inertia.lever, rest)


def coordinates(
    scene: Scene, q: Array, v: Array, wheel_speeds: Mapping[int, Array] | None = None
) -> tuple[Array, Array]:
    """Convert configuration and velocity to MuJoCo's ``qpos`` and ``qvel``.

    MuJoCo's linear velocities of bases are in world axes, and its angular velocities in body axes.

    Args:
        scene: The scene.
        q, v: Configuration (nq,) and velocity (nv,) in Pinocchio's coordinates.
        wheel_speeds: Speeds of wheels relative to their base [rad/s] by the joint of the base; None without
            wheels. Wheel angles are zero.

    Returns:
        tuple: Positions and velocities.
    """
    position: list[float] = []
    velocity: list[float] = []
    for index, joint in enumerate(scene.model.joints[1:], start=1):
        place, rate = q[joint.idx_q : joint.idx_q + joint.nq], v[joint.idx_v : joint.idx_v + joint.nv]
        if joint.nv == 6:
            rotation = pin.Quaternion(*place[[6, 3, 4, 5]]).toRotationMatrix()
            position += [*place[[0, 1, 2, 6, 3, 4, 5]]]
            velocity += [*(rotation @ rate[:3]), *rate[3:]]
        elif joint.nv == 3:
            c, s = place[2:]
            position += [place[0], place[1], np.arctan2(s, c)]
            velocity += [c * rate[0] - s * rate[1], s * rate[0] + c * rate[1], rate[2]]
        else:
            position.append(place[0] if joint.nq == 1 else np.arctan2(place[1], place[0]))
            velocity.append(rate[0])
        speeds = (wheel_speeds or {}).get(index, np.zeros(0))
        position += [0.0] * len(speeds)
        velocity += [*speeds]
    return np.array(position), np.array(velocity)


def model_coordinates(
    scene: Scene, position: Array, velocity: Array, wheels: Mapping[int, int] | None = None
) -> tuple[Array, Array, dict[int, Array]]:
    """Convert MuJoCo's coordinates to Pinocchio's, the inverse of :func:`coordinates`.

    Args:
        scene: The scene.
        position, velocity: MuJoCo's ``qpos`` and ``qvel``.
        wheels: Number of wheels by the joint of their base; None without wheels.

    Returns:
        tuple: Configuration (nq,), velocity (nv,), and speeds of wheels [rad/s] by the joint of their base.
    """
    q, v, speeds = np.zeros(scene.model.nq), np.zeros(scene.model.nv), dict[int, Array]()
    at, to = 0, 0  # in position and velocity
    for index, joint in enumerate(scene.model.joints[1:], start=1):
        place, rate = position[at:], velocity[to:]
        rows_q = slice(joint.idx_q, joint.idx_q + joint.nq)
        rows_v = slice(joint.idx_v, joint.idx_v + joint.nv)
        if joint.nv == 6:
            q[rows_q] = place[[0, 1, 2, 4, 5, 6, 3]]
            rotation = pin.Quaternion(*place[3:7]).normalized().toRotationMatrix()
            v[rows_v] = [*(rotation.T @ rate[:3]), *rate[3:6]]
        elif joint.nv == 3:
            c, s = np.cos(place[2]), np.sin(place[2])
            q[rows_q] = [place[0], place[1], c, s]
            v[rows_v] = [c * rate[0] + s * rate[1], c * rate[1] - s * rate[0], rate[2]]
        else:
            q[rows_q] = place[0] if joint.nq == 1 else [np.cos(place[0]), np.sin(place[0])]
            v[rows_v] = rate[0]
        at, to = at + (7 if joint.nv == 6 else joint.nv), to + joint.nv
        if count := (wheels or {}).get(index, 0):
            speeds[index] = velocity[to : to + count]
            at, to = at + count, to + count
    return q, v, speeds
