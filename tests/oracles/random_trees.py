"""Random kinematic trees of every supported joint, as Pinocchio models, for property-based tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from hypothesis import strategies as st

ALIGNED = {
    "RX": pin.JointModelRX,
    "RY": pin.JointModelRY,
    "RZ": pin.JointModelRZ,
    "RUBX": pin.JointModelRUBX,
    "RUBY": pin.JointModelRUBY,
    "RUBZ": pin.JointModelRUBZ,
    "PX": pin.JointModelPX,
    "PY": pin.JointModelPY,
    "PZ": pin.JointModelPZ,
    "Planar": pin.JointModelPlanar,
    "FreeFlyer": pin.JointModelFreeFlyer,
}
UNALIGNED = {
    "RevoluteUnaligned": pin.JointModelRevoluteUnaligned,
    "RevoluteUnboundedUnaligned": None,
    "PrismaticUnaligned": pin.JointModelPrismaticUnaligned,
}
JOINTS = (*ALIGNED, *UNALIGNED)
AXES = ((0, 0, -1), (0, -1, 0), (-1, 0, 0), (0.6, 0, 0.8), (1, 2, -3))

_CONTINUOUS = """<robot name="one"><link name="a"/><link name="b"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="continuous"><parent link="a"/><child link="b"/><axis xyz="{} {} {}"/>
<limit effort="1" velocity="1"/></joint></robot>"""


@dataclass(frozen=True)
class State:
    """A model with a configuration, a velocity, a generalised force and a wrench to try."""

    model: pin.Model
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    wrench: np.ndarray

    def __repr__(self) -> str:
        """Joint types and parents, which is what a failure depends on."""
        kinds = [joint.shortname().removeprefix("JointModel") for joint in self.model.joints]
        return f"State({kinds}, parents={list(self.model.parents)}, q={self.q!r}, v={self.v!r})"


def joint_model(kind: str, axis: tuple[float, float, float]) -> object:
    """One Pinocchio joint; ``axis`` counts for the unaligned kinds alone."""
    if kind in ALIGNED:
        return ALIGNED[kind]()
    unit = np.array(axis, dtype=float) / np.linalg.norm(axis)
    if kind == "RevoluteUnboundedUnaligned":  # its Python constructor takes no axis; the URDF reader's does
        return pin.buildModelFromXML(_CONTINUOUS.format(0.6, 0, 0.8)).joints[1]
    return UNALIGNED[kind](unit)


def random_inertia(rng: np.random.Generator) -> pin.Inertia:
    """Well-conditioned inertia of an ellipsoid somewhere near the joint."""
    body = pin.Inertia.FromEllipsoid(rng.uniform(0.5, 5), *rng.uniform(0.2, 0.8, 3))
    return random_placement(rng, 0.3).act(body)


def random_placement(rng: np.random.Generator, reach: float) -> pin.SE3:
    """Any rotation, and an offset of up to ``reach`` along each axis."""
    quaternion = rng.normal(size=4)
    rotation = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).toRotationMatrix()
    return pin.SE3(rotation, rng.uniform(-reach, reach, 3))


def right_angled_placement(rng: np.random.Generator) -> pin.SE3:
    """Quarter turns with the usual rounding noise, and an offset along one axis."""
    rotation = pin.rpy.rpyToMatrix(*(0.5 * np.pi * rng.integers(-1, 3, 3)))
    return pin.SE3(rotation, np.eye(3)[rng.integers(3)] * rng.uniform(0.1, 0.5))


@st.composite
def random_states(draw: st.DrawFn, max_joints: int = 6, armature: bool = False) -> State:
    """Models of up to ``max_joints`` joints in depth-first order (Pinocchio's ``crba`` needs it)."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    model, path = pin.Model(), [0]
    kinds = draw(st.lists(st.sampled_from(JOINTS), min_size=1, max_size=max_joints))
    for number, kind in enumerate(kinds):
        parent = draw(st.sampled_from(path[::-1]))
        square = draw(st.booleans())
        placement = right_angled_placement(rng) if square else random_placement(rng, 0.5)
        joint = joint_model(kind, draw(st.sampled_from(AXES)))
        index = model.addJoint(parent, joint, placement, f"joint {number}")
        model.appendBodyToJoint(index, random_inertia(rng), pin.SE3.Identity())
        frame = pin.Frame(f"tip {number}", index, random_placement(rng, 0.5), pin.FrameType.OP_FRAME)
        model.addFrame(frame)
        path = [*path[: path.index(parent) + 1], index]
    if not draw(st.booleans()):
        model.gravity = pin.Motion.Zero()
    if armature:
        model.armature = rng.uniform(0.1, 1.0, model.nv)
    return random_state(model, rng)


def random_state(model: pin.Model, rng: np.random.Generator) -> State:
    """A configuration on the manifold, and velocity, effort and wrench of order one."""
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    v, tau = rng.normal(size=model.nv), rng.normal(size=model.nv)
    return State(model, q, v, tau, rng.normal(size=6))
