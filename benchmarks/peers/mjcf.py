"""A scene's bodies in MuJoCo's description, which Basilisk and Drake read too, and its coordinates there."""

from __future__ import annotations

from collections.abc import Mapping

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
    option: str = "",
    sites: Mapping[str, int] | None = None,
    more: Mapping[str, str] | None = None,
    geoms: Mapping[int, str] | None = None,
    wheels: tuple[Array, float] | None = None,
) -> str:
    """MuJoCo's description of the bodies of a scene, without gravity.

    Parameters
    ----------
    scene
        Whose model is written, joint by joint.
    option
        Of MuJoCo, an XML element.
    sites
        From a site's name to the frame of the model that it marks.
    more
        XML by section, ``actuator`` or ``equality``.
    geoms
        XML of geometries by joint of the model.
    wheels
        Axes of wheels (3 x n) and the inertia of each about its axis [kg m^2], on the first floating base.

    Returns
    -------
    str
        The XML text.
    """
    model = scene.model
    children: dict[int, list[int]] = {}
    for joint in range(1, model.njoints):
        children.setdefault(int(model.parents[joint]), []).append(joint)
    data = model.createData()
    marks: dict[int, list[str]] = {}
    for name, frame in (sites or {}).items():
        at = model.frames[frame]
        marks.setdefault(int(at.parentJoint), []).append(f'<site name="{name}" {_pose(at.placement)}/>')

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
        inner += "".join(marks.get(joint, [])) + (geoms or {}).get(joint, "")
        inner += "".join(body(child) for child in children.get(joint, []))
        place = _pose(model.jointPlacements[joint])
        return f'<body name="{name}" {place}>{_inertial(inertia)}{joints}{inner}</body>'

    bodies = "".join(body(joint) for joint in children[0])
    sections = "".join(f"<{key}>{text}</{key}>" for key, text in (more or {}).items())
    return (
        '<mujoco model="scene"><compiler angle="radian" autolimits="true"/>'
        f"{option}<worldbody>{bodies}</worldbody>{sections}</mujoco>"
    )


def _pose(placement: pin.SE3) -> str:
    quat = pin.Quaternion(placement.rotation).coeffs()
    return f'pos="{numbers(placement.translation)}" quat="{numbers(np.roll(quat, 1))}"'


def _inertial(inertia: pin.Inertia) -> str:
    own = inertia.inertia
    full = [own[0, 0], own[1, 1], own[2, 2], own[0, 1], own[0, 2], own[1, 2]]
    place = f'mass="{inertia.mass:.17g}" pos="{numbers(inertia.lever)}"'
    return f'<inertial {place} fullinertia="{numbers(full)}"/>'


def _wheels(inertia: pin.Inertia, axes: Array, spin: float) -> tuple[str, pin.Inertia]:
    """Wheels at the centre of mass as bodies on hinges, and what remains of the base that carries them.

    A body needs inertia across its axis as well; it is taken from the base, as is the mass. Both together are
    the base of the scenario, to which wheels add inertia about their axes alone.
    """
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
    """Positions and velocities as MuJoCo has them.

    Planar bases have x, y, angle; free bodies a quaternion with the real part first. Their linear velocities
    are in world axes, the angular ones of free bodies in their own.
    """
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
            position.append(own[0])
            velocity.append(rate[0])
    return np.array(position), np.array(velocity)
