"""Poses of all visible bodies over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.description import Geometry
from spacerobot.dynamics.joints import JointModel, read_joints
from spacerobot.result import Result
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneShape
from viz.drawing.geometry import corners
from viz.drawing.placements import JointPlacements, joint_placements, quaternions

Rows = np.ndarray[tuple[int], np.dtype[np.int64]]
"""Indices of rows of a result's data."""

GREY = np.array([0.6, 0.6, 0.6, 1.0])
"""Colour of shapes without a colour in the URDF."""

PAD = np.array([0.85, 0.45, 0.1, 1.0])
"""Colour of pads."""

_FARTHEST = 3.0
"""Diagonals of the initial box by which a diverged motion may exceed it in pictures."""


FINISHES = {
    "foil": ("foil", "mli", "gold", "kapton"),
    "solar": ("solar", "panel", "cell"),
    "metal": ("metal", "silver", "alumin", "steel", "chrome", "titan"),
}
"""Surface finishes, and the words in a URDF material's name that select them; the default is paint."""


def finish_of(material: str) -> str:
    """Finish of a surface, from the name of its material in the URDF."""
    name = material.lower()
    return next((f for f, words in FINISHES.items() if any(word in name for word in words)), "paint")


@dataclass(frozen=True, eq=False)
class DrawnSolid:
    """A shape fixed to a node.

    Attributes:
        placement: Pose of the shape in the node's frame, homogeneous matrix (4, 4) [m].
        geometry: The shape.
        rgba: Colour and opacity (4,), 0 to 1.
        finish: Name of its surface finish; see :data:`FINISHES`.
    """

    placement: Array
    geometry: Geometry
    rgba: Array
    finish: str = "paint"


@dataclass(frozen=True, eq=False)
class Node:
    """Shapes that move together: those of all links fixed to one joint.

    Attributes:
        joint: Id of the joint in the scene's model; 0 for static shapes.
        body: Name of its robot, or ``target``.
        label: Displayed name of the body.
        is_base: Whether it is the body's root.
        solids: Its shapes.
    """

    joint: int
    body: str
    label: str
    is_base: bool
    solids: tuple[DrawnSolid, ...]


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Placements of all nodes at sampled times.

    Attributes:
        nodes: Visible nodes.
        rows: Sampled rows of the result's data (nt,).
        time: Times (nt,) [s].
        position: Origins of the nodes' frames in the world (nt, nodes, 3) [m].
        quaternion: Rotations from node to world (nt, nodes, 4), x y z w, without sign jumps over time.
        mates: Mating frames of the grasps in the world (nt, grasps, 3) [m].
        joints: Placements of all joints' frames.
    """

    nodes: tuple[Node, ...]
    rows: Rows
    time: Array
    position: Array
    quaternion: Array
    mates: Array
    joints: JointPlacements

    def placements(self, frame: int) -> list[Array]:
        """Node to world at a frame, homogeneous (4, 4) each."""
        frame_placements = []
        for position, quaternion in zip(self.position[frame], self.quaternion[frame], strict=True):
            placement = np.eye(4)
            placement[:3, :3] = pin.Quaternion(quaternion).toRotationMatrix()
            placement[:3, 3] = position
            frame_placements.append(placement)
        return frame_placements


def scene_nodes(scene: Scene) -> tuple[Node, ...]:
    """Visible nodes of a scene: visuals of the URDFs, or else collision shapes, and pads.

    A body's root is a node even without shapes; for a body without any shapes, all joints are nodes.
    """
    nodes = []
    # Pads of contacts: the body and joint that carry each, and its drawn solids.
    pairs = [pair for contact in scene.contacts for pair in contact.pairs]
    pads = []
    for pad in dict.fromkeys(shape for pair in pairs for shape in pair if shape.path is not None):
        owner = scene.model.frames[pad.frame].name.partition("/")[0]
        pads += [(owner, pad.joint, solid) for solid in pad_solids(scene, pad, pairs)]
    for body in scene.bodies:
        links = body.description.links
        has_visuals = any(link.visuals for link in links)
        by_joint: dict[int, list[DrawnSolid]] = {}
        for link in links:
            frame = scene.model.frames[scene.model.getFrameId(f"{body.name}/{link.name}", pin.FrameType.BODY)]
            for shape in link.visuals if has_visuals else link.collisions:
                placement = frame.placement.homogeneous @ shape.placement
                rgba = GREY if shape.rgba is None else shape.rgba
                solid = DrawnSolid(placement, shape.geometry, rgba, finish_of(shape.material))
                by_joint.setdefault(int(frame.parentJoint), []).append(solid)
        for carrier, joint, solid in pads:
            if carrier == body.name:
                by_joint.setdefault(joint, []).append(solid)
        root = int(scene.model.frames[body.root_frame].parentJoint)
        for joint in {root} if by_joint else {root, *body.joints}:
            by_joint.setdefault(int(joint), [])
        label = scene.scenario.body_label(body.name)
        nodes += [
            Node(j, body.name, label, j == root, tuple(solids)) for j, solids in sorted(by_joint.items())
        ]
    return tuple(nodes)


def pad_solids(
    scene: Scene, shape: SceneShape, pairs: Sequence[tuple[SceneShape, SceneShape]]
) -> list[DrawnSolid]:
    """Drawn solids of a pad, in the frame of the joint that carries it."""
    placement = scene.model.frames[shape.frame].placement.homogeneous @ shape.placement
    # distance across its z axis from its origin to the farthest of the others at the start [m]
    data, reach = scene.model.createData(), 0.0
    pin.framesForwardKinematics(scene.model, data, scene.q)
    pad_placement = data.oMf[shape.frame] * pin.SE3(shape.placement)
    for other in {other for pair in pairs if shape in pair for other in pair if other is not shape}:
        other_placement = data.oMf[other.frame] * pin.SE3(other.placement)
        away = float(np.linalg.norm(pad_placement.actInv(other_placement.translation)[:2]))
        reach = max(reach, away + other.config.extent()[1])
    pad = []
    for part in shape.config.drawing(reach):
        part_placement = placement.copy()
        part_placement[:3, 3] += part.along * placement[:3, 2]
        pad.append(DrawnSolid(part_placement, part.geometry, np.array([*PAD[:3], part.opacity])))
    return pad


def only(motion: BodyMotion, body: str) -> BodyMotion:
    """Motion reduced to the nodes of one body."""
    places = [k for k, node in enumerate(motion.nodes) if node.body == body]
    nodes = tuple(motion.nodes[k] for k in places)
    return replace(
        motion, nodes=nodes, position=motion.position[:, places], quaternion=motion.quaternion[:, places]
    )


def pick_rows(time: Array, *, rate_hz: float, most: int) -> Rows:
    """Rows nearest to an even spacing in time: at most ``rate_hz`` and ``most``, first and last included."""
    count = min(most, len(time), max(2, round((time[-1] - time[0]) * rate_hz) + 1))
    instants = np.linspace(time[0], time[-1], count)
    after = np.clip(np.searchsorted(time, instants), 0, len(time) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.where(instants - time[before] < time[after] - instants, before, after)
    return np.unique(nearer)


@dataclass(frozen=True, eq=False)
class SceneGeometry:
    """Geometry of a scene, read once and placed many times: nodes and joints.

    Attributes:
        nodes: Visible nodes.
        joints: Joints of the scene's model, without the universe.
    """

    nodes: tuple[Node, ...]
    joints: tuple[JointModel, ...]

    @classmethod
    def of(cls, scene: Scene) -> SceneGeometry:
        """Geometry of a scene."""
        return cls(scene_nodes(scene), read_joints(scene.model))


def sample_motion(
    result: Result,
    scene: Scene,
    rows: Sequence[int] | Rows,
    stage: SceneGeometry | None = None,
    enlarged: float = 1.0,
) -> BodyMotion:
    """Placements at rows of a result's data.

    Args:
        result, scene, rows: The result, its scene, and the rows.
        stage: Geometry of the scene; built if None.
        enlarged: Factor of the deflections of flexible links.
    """
    rows = np.asarray(rows, dtype=np.int64)
    q, time = result.array("q")[rows], result.array("time")[rows]
    q[:, passive_positions(scene)] *= enlarged
    return replace(place(scene, stage or SceneGeometry.of(scene), q, time), rows=rows)


def passive_positions(scene: Scene) -> list[int]:
    """Indices in q of the joints of flexible links."""
    return [int(scene.model.idx_qs[joint]) for body in scene.bodies for joint in body.passive]


def initial_motion(scene: Scene) -> BodyMotion:
    """Placements of a scene that has not been simulated yet: one frame at 0 s."""
    return place(scene, SceneGeometry.of(scene), scene.q[None], np.zeros(1))


def place(scene: Scene, stage: SceneGeometry, q: Array, time: Array) -> BodyMotion:
    """Placements of a scene at configurations q (nt, nq) and times (nt,) [s]."""
    nodes, joints = stage.nodes, joint_placements(scene, stage.joints, q)
    moving = [node.joint for node in nodes]
    quaternion = quaternions(joints.rotation[:, moving])
    signs = np.cumprod(np.where(np.sum(quaternion[1:] * quaternion[:-1], axis=-1) < 0, -1.0, 1.0), axis=0)
    quaternion[1:] *= signs[..., None]
    mates = [scene.model.frames[grasp.frame] for grasp in scene.grasps]
    points = [joints.points(frame.parentJoint, frame.placement.translation) for frame in mates]
    places = np.stack(points, axis=1) if points else np.zeros((len(q), 0, 3))
    rows = np.arange(len(q), dtype=np.int64)
    return BodyMotion(nodes, rows, time, joints.origin[:, moving], quaternion, places, joints)


def bounds(motion: BodyMotion, *, diverged: bool = False) -> tuple[Array, Array]:
    """Lower and upper corner (3,) [m] of a box around all visible points at all times.

    A rollout that diverged may move bodies far away: the box then exceeds the initial one by at most
    ``_FARTHEST`` times its diagonal.
    """
    points = _seen_points(motion)
    low, high = points.min(axis=1), points.max(axis=1)
    margin = _FARTHEST * float(np.linalg.norm(high[0] - low[0])) if diverged else np.inf
    return np.maximum(low.min(axis=0), low[0] - margin), np.minimum(high.max(axis=0), high[0] + margin)


def greatest_force(result: Result) -> float:
    """Maximum force of a grasp or contact [N]; of a diverged rollout over its first 80 % of samples."""
    rows = len(result.data.time)
    count = rows if result.completed else max(1, int(0.8 * rows))
    force_arrays = [
        result.array(name)[:count] for name in ("grasp_force", "contact_force") if name in result.data
    ]
    return max(
        (float(np.linalg.norm(forces, axis=-1).max(initial=0.0)) for forces in force_arrays), default=0.0
    )


def extremes(motion: BodyMotion, low: Array, high: Array) -> Array:
    """Extreme points (k, 3) [m] of the visible bodies in 98 directions, clipped to a box."""
    points = np.clip(_seen_points(motion).reshape(-1, 3), low, high)
    steps = np.arange(-2, 3)
    grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    grid = grid[np.abs(grid).max(axis=1) == 2]
    farthest = {int((points @ direction).argmax()) for direction in grid}
    return np.unique(points[sorted(farthest)], axis=0)


def _seen_points(motion: BodyMotion) -> Array:
    """Corners of boxes around all solids at all times (nt, corners, 3), m, world."""
    boxes, frames = [], []
    for node in motion.nodes:
        placed = [(corners(s.geometry), s.placement) for s in node.solids] or [(np.zeros((1, 3)), np.eye(4))]
        boxes.append(
            np.concatenate([local_corners @ at[:3, :3].T + at[:3, 3] for local_corners, at in placed])
        )
    for i in range(len(motion.time)):
        at_frame = zip(motion.placements(i), boxes, strict=True)
        frames.append(np.concatenate([box @ node[:3, :3].T + node[:3, 3] for node, box in at_frame]))
    return np.stack(frames)
