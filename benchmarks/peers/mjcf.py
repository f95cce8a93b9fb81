"""A scene's bodies in MuJoCo's description, which Basilisk and Drake read too, and its coordinates there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pinocchio as pin

from spacerobot.arrays import Array
from spacerobot.scene import Scene

PLANAR = (("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("r", "hinge", "0 0 1"))
WHEEL_MASS = 1.0
"""[kg] Of each wheel, taken from its base: only its inertia about its axis is added to the model."""


def numbers(values: object) -> str:
    """Numbers in full, separated by blanks."""
    return " ".join(f"{x:.17g}" for x in np.ravel(np.asarray(values, dtype=float)))


def mjcf(
    scene: Scene,
    *,
    more: str = "",
    inside: Mapping[int, str] | None = None,
    wheels: tuple[Array, float] | None = None,
) -> str:
    """MuJoCo's description of the bodies of a scene, joint by joint.

    Parameters
    ----------
    scene
        Whose model is written.
    more
        Further sections, XML: options, motors, equality constraints.
    inside
        Geometries and sites, XML by joint of the model.
    wheels
        Axes of wheels (3 x n) and the inertia of each about its axis [kg m^2], on the first floating base.
    """
    model = scene.model
    children: dict[int, list[int]] = {}
    for joint in range(1, model.njoints):
        children.setdefault(int(model.parents[joint]), []).append(joint)
    data = model.createData()

    def body(joint: int) -> str:
        inertia, inner = model.inertias[joint], ""
        name = model.names[joint]
        if wheels is not None and joint == children[0][0]:
            inner, inertia = _wheels(inertia, *wheels)
        damping = model.damping[model.idx_vs[joint]]
        if model.nvs[joint] == 6:
            joints = f'<freejoint name="{name}"/>'
        elif model.nvs[joint] == 3:
            joints = "".join(f'<joint name="{name}.{k}" type="{t}" axis="{axis}"/>' for k, t, axis in PLANAR)
        else:
            axis = np.asarray(data.joints[joint].S).ravel()
            kind = "hinge" if axis[3:].any() else "slide"
            way = numbers(axis[3:] if kind == "hinge" else axis[:3])
            joints = f'<joint name="{name}" type="{kind}" axis="{way}" damping="{damping:.17g}"/>'
        inner += (inside or {}).get(joint, "") + "".join(body(child) for child in children.get(joint, []))
        place = pose(model.jointPlacements[joint])
        return f'<body name="{name}" {place}>{_inertial(inertia)}{joints}{inner}</body>'

    bodies = "".join(body(joint) for joint in children[0])
    return f'<mujoco model="scene"><compiler angle="radian"/><worldbody>{bodies}</worldbody>{more}</mujoco>'


def motors(names: Iterable[str]) -> str:
    """Motors of joints, each of the joint's name."""
    return f"<actuator>{''.join(f'<motor name={n!r} joint={n!r}/>' for n in names)}</actuator>"


def pose(placement: pin.SE3) -> str:
    """Attributes of a body or a site."""
    quat = pin.Quaternion(placement.rotation).coeffs()
    return f'pos="{numbers(placement.translation)}" quat="{numbers(np.roll(quat, 1))}"'


def _inertial(inertia: pin.Inertia) -> str:
    own = inertia.inertia
    full = [own[0, 0], own[1, 1], own[2, 2], own[0, 1], own[0, 2], own[1, 2]]
    place = f'mass="{inertia.mass:.17g}" pos="{numbers(inertia.lever)}"'
    return f'<inertial {place} fullinertia="{numbers(full)}"/>'


def _wheels(inertia: pin.Inertia, axes: Array, spin: float) -> tuple[str, pin.Inertia]:
    """Wheels as bodies on hinges; their mass and inertia across their axes are taken from the base."""
    across, texts, rest = 0.6 * spin, "", np.array(inertia.inertia)
    for i, axis in enumerate(axes.T):
        own = across * np.eye(3) + (spin - across) * np.outer(axis, axis)
        rest -= across * (np.eye(3) - np.outer(axis, axis))
        texts += (
            f'<body name="wheel_{i}" pos="{numbers(inertia.lever)}">'
            f"{_inertial(pin.Inertia(WHEEL_MASS, np.zeros(3), own))}"
            f'<joint name="wheel_{i}" type="hinge" axis="{numbers(axis)}"/></body>'
        )
    return texts, pin.Inertia(inertia.mass - WHEEL_MASS * axes.shape[1], inertia.lever, rest)


def coordinates(scene: Scene, q: Array, v: Array) -> tuple[Array, Array]:
    """MuJoCo's positions and velocities: linear ones of bases in world axes, angular in their own."""
    position: list[float] = []
    velocity: list[float] = []
    for joint in scene.model.joints[1:]:
        own, rate = q[joint.idx_q : joint.idx_q + joint.nq], v[joint.idx_v : joint.idx_v + joint.nv]
        if joint.nv == 6:
            turned = pin.Quaternion(*own[[6, 3, 4, 5]]).toRotationMatrix()
            position += [*own[[0, 1, 2, 6, 3, 4, 5]]]
            velocity += [*(turned @ rate[:3]), *rate[3:]]
        elif joint.nv == 3:
            c, s = own[2:]
            position += [own[0], own[1], np.arctan2(s, c)]
            velocity += [c * rate[0] - s * rate[1], s * rate[0] + c * rate[1], rate[2]]
        else:
            position.append(own[0] if joint.nq == 1 else np.arctan2(own[1], own[0]))
            velocity.append(rate[0])
    return np.array(position), np.array(velocity)
