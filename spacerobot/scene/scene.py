"""Scene: one Pinocchio model with all robots and the target."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.tables import Table
from spacerobot.common.tabular import Tabular
from spacerobot.description.read import Description
from spacerobot.elements import CollisionShape, Contact, Grasp, Reference
from spacerobot.elements.flexible.flexible_link import Number
from spacerobot.scenario import Base, Robot, Scenario, Target, Tip


@dataclass(frozen=True)
class MimicJoint:
    """A joint that mimics another one: ``q = multiplier q_leader + offset`` [rad or m].

    ``joint`` and ``leader`` are ids in the scene's model.
    """

    joint: int
    leader: int
    multiplier: float
    offset: float


@dataclass(frozen=True)
class SceneBody:
    """Robot or target: a subtree of the scene's model.

    Attributes:
        name: Prefix of its links and joints in the model, ``rpr1`` of ``rpr1/joint_1``.
        path: Dotted path in the scenario, ``robots.rpr1`` or ``target``.
        config: Its section of the scenario, with mass properties and joints filled in from the URDF and
            without locked joints.
        description: URDF with locked joints fixed.
        root_frame: Frame of the root link.
        root_joint: Joint that floats the base; 0 (the universe) for a fixed base.
        joints: Ids of its other joints, parents first.
        ties: Its mimic joints.
        owned: Ids of its joints that belong to an actuator, such as wheels, and are hidden from the arm's
            controllers.
        passive: Ids of its joints in flexible links, which nothing drives and no controller reads.
    """

    name: str
    path: str
    config: Robot | Target
    description: Description
    root_frame: int
    root_joint: int
    joints: tuple[int, ...]
    ties: tuple[MimicJoint, ...] = ()
    owned: tuple[int, ...] = ()
    passive: tuple[int, ...] = ()

    def __repr__(self) -> str:
        """Name and size, in one line."""
        return f"<SceneBody {self.name}: {self.description.path.name}, {len(self.joints)} joints>"

    @property
    def arm_joints(self) -> tuple[int, ...]:
        """Ids of its joints without those that actuators own and those of flexible links."""
        return tuple(joint for joint in self.joints if joint not in (*self.owned, *self.passive))

    @property
    def driven_joints(self) -> tuple[int, ...]:
        """Ids of its free joints that controllers drive, without those of actuators and flexible links."""
        return tuple(joint for joint in self.free_joints if joint not in (*self.owned, *self.passive))

    @property
    def free_joints(self) -> tuple[int, ...]:
        """Ids of its joints that are not mimic joints."""
        tied = {tie.joint for tie in self.ties}
        return tuple(joint for joint in self.joints if joint not in tied)

    def positions(self, driven: ca.SX) -> dict[int, ca.SX]:
        """Positions of its joints by id, those that mimic others included.

        Args:
            driven: Positions of :attr:`driven_joints` (n x 1) [rad or m].
        """
        positions = dict(zip(self.driven_joints, ca.vertsplit(driven), strict=True))
        ties = [tie for tie in self.ties if tie.leader in positions]
        return positions | {tie.joint: tie.multiplier * positions[tie.leader] + tie.offset for tie in ties}

    def joint_name(self, model: Any, joint: int) -> str:
        """Name of one of its joints in the URDF.

        Args:
            model: Pinocchio model of the scene.
            joint: Id of the joint.
        """
        return str(model.names[joint]).removeprefix(f"{self.name}/")

    @property
    def spring_constants(self) -> dict[str, tuple[float, float]]:
        """Nominal stiffness and damping of :meth:`springs`, as numbers."""

        def number(name: str, key: str) -> float:
            first, _, place = key.partition(".")
            value = getattr(self.config.flexible[name], first)
            return float(value[int(place)] if place else value)

        return self.springs(number)

    def springs(self, number: Callable[[str, str], Number]) -> dict[str, tuple[Number, Number]]:
        """Stiffness and damping of each joint of flexible links that is not locked, by its name in the URDF.

        Args:
            number: Function from the name of a flexible link and a key of its section to the number.

        Returns:
            dict: Stiffness [N m/rad or N/m] and damping [N m s/rad or N s/m].
        """
        springs_by_joint = dict[str, tuple[Number, Number]]()
        for name, flexible in self.config.flexible.items():
            springs = flexible.springs(self.description, name, functools.partial(number, name))
            springs_by_joint |= {
                joint: spring for joint, spring in springs.items() if joint in self.config.joints
            }
        return springs_by_joint

    @property
    def base(self) -> Base:
        """Connection and initial state of the base."""
        return self.config.base

    @property
    def subtree(self) -> tuple[int, ...]:
        """Ids of all its joints, the floating base included."""
        return (self.root_joint, *self.joints) if self.root_joint else self.joints


@dataclass(frozen=True)
class SceneReference:
    """Reference of a tip, in some phases or always.

    Attributes:
        path: Dotted path of its section.
        config: The section.
        from_target: Whether it belongs to the target, so that the tip's motion is derived from it.
        phases: Names of the phases in which it is active; empty if there are no phases.
    """

    path: str
    config: Reference
    from_target: bool
    phases: tuple[str, ...] = ()


@dataclass(frozen=True)
class SceneTip:
    """A frame of a robot that can hold something.

    ``references`` are its references in the order in which they become active. ``reference`` is the section
    of the first one, and ``from_target`` whether that one is derived from the target's reference.
    """

    label: str
    path: str
    body: SceneBody
    frame: int
    joint: int
    config: Tip
    references: tuple[SceneReference, ...]

    def __repr__(self) -> str:
        """Label and references, in one line."""
        led = ", ".join(reference.config.kind for reference in self.references)
        return f"<SceneTip {self.label}: {led or 'no reference'}>"

    @property
    def reference(self) -> Reference:
        """Reference that is active from the start."""
        return self.references[0].config

    @property
    def from_target(self) -> bool:
        """Whether it is derived from the target's reference."""
        return self.references[0].from_target


@dataclass(frozen=True)
class SceneGrasp:
    """A tip and a mating frame of the target, joined."""

    name: str
    path: str
    tip: SceneTip
    frame: int
    joint: int
    config: Grasp

    def __repr__(self) -> str:
        """Name, kind, tip and mating frame, in one line."""
        return f"<SceneGrasp {self.name}: {self.config.kind}, {self.tip.label} and {self.config.frame}>"


@dataclass(frozen=True, eq=False)
class SceneShape:
    """Shape for contact, fixed to a link.

    Attributes:
        label: Name of the pad, or body/link.
        path: Dotted path of the pad; None for a collision shape of a URDF, whose numbers are fixed.
        config: Kind and measures [m]; without a pose for a shape of a URDF.
        frame, joint: Frame and joint of the link in the model.
        placement: Pose of the shape in the link's frame (4, 4) [m].
    """

    label: str
    path: str | None
    config: CollisionShape
    frame: int
    joint: int
    placement: Array


@dataclass(frozen=True)
class SceneContact:
    """Pairs of shapes that may touch: every first shape with every second one."""

    name: str
    path: str
    config: Contact
    pairs: tuple[tuple[SceneShape, SceneShape], ...]


@dataclass(frozen=True)
class Scene(Tabular):
    """All bodies, grasps and contacts of a scenario, and the initial state.

    Attributes:
        scenario: The resolved scenario: mass properties and joints filled in from the URDFs.
        source: File of the scenario, if any.
        model: ``pinocchio.Model`` of the whole scene; links and joints are named ``body/name``.
        bodies: Robots in the scenario's order, then the target.
        planar: Whether all motion stays in the x-y plane; tips and grasps then have two translations and one
            rotation.
        q, v: Initial configuration and velocity in Pinocchio's coordinates (nq,), (nv,).
        assumptions, warnings: Assumed values where the scenario states none, and warnings for the user.
        contacts: Contacts between shapes.
        changes: Changes with which the scenario's file was loaded, by dotted path.
    """

    scenario: Scenario
    source: Path | None
    model: Any
    bodies: tuple[SceneBody, ...]
    tips: tuple[SceneTip, ...]
    grasps: tuple[SceneGrasp, ...]
    planar: bool
    q: Array
    v: Array
    assumptions: tuple[str, ...]
    warnings: tuple[str, ...]
    contacts: tuple[SceneContact, ...] = ()
    changes: tuple[tuple[str, Any], ...] = ()

    def __repr__(self) -> str:
        """Name, size, bodies, tips and grasps in one line."""
        kind = "planar" if self.planar else "spatial"
        tips, grasps = ", ".join(tip.label for tip in self.tips), ", ".join(g.name for g in self.grasps)
        bodies = ", ".join(body.name for body in self.bodies)
        return (
            f"<Scene {self.scenario.name}: {kind}, {self.model.nv} velocities; bodies {bodies}; "
            f"tips {tips or 'none'}; grasps {grasps or 'none'}>"
        )

    def content(self) -> list[Table]:
        """Table of the bodies with their bases and joints, of the tips, grasps and warnings."""
        rows = [(b.name, f"{b.config.base.joint} base, {len(b.joints)} joints") for b in self.bodies]
        rows += [("tips", ", ".join(tip.label for tip in self.tips))]
        rows += [("grasps", ", ".join(f"{g.name} ({g.tip.label})" for g in self.grasps))]
        rows += [("warning", warning) for warning in self.warnings]
        return [Table.of_pairs(f"Scene {self.scenario.name}", rows)]

    def error(self, message: str, where: str | None = None) -> ScenarioError:
        """Error that names the scenario's file.

        Args:
            message: Value that was found, allowed values, and remedy.
            where: Dotted path in the scenario; None for the scenario as a whole.
        """
        return ScenarioError(message, source=self.source, where=where)

    @property
    def robots(self) -> tuple[SceneBody, ...]:
        """The bodies that are robots."""
        return tuple(body for body in self.bodies if isinstance(body.config, Robot))

    @property
    def target(self) -> SceneBody | None:
        """The held object."""
        return next((body for body in self.bodies if isinstance(body.config, Target)), None)

    @property
    def ties(self) -> tuple[MimicJoint, ...]:
        """Joints that mimic another one."""
        return tuple(tie for body in self.bodies for tie in body.ties)

    @property
    def spread(self) -> Array:
        """Velocities of all joints from those of the free ones (nv, nv).

        The identity except for mimic joints: their columns are zero, and their row has the multiplier in the
        column of the joint they follow. The transpose maps their torques to that joint.
        """
        spread = np.eye(self.model.nv)
        for tie in self.ties:
            row, column = self.model.idx_vs[tie.joint], self.model.idx_vs[tie.leader]
            spread[row, row], spread[row, column] = 0.0, tie.multiplier
        return spread

    @property
    def stiffness(self) -> Array:
        """Stiffness of the springs in flexible links, by the component of v (nv,) [N m/rad or N/m]."""
        stiffnesses = np.zeros(self.model.nv)
        for body in self.bodies:
            for name, (stiffness, _) in body.spring_constants.items():
                stiffnesses[self.model.joints[self.model.getJointId(f"{body.name}/{name}")].idx_v] = stiffness
        return stiffnesses

    @property
    def joint_kinds(self) -> dict[str, str]:
        """Kind of each joint of the URDFs, such as ``revolute`` or ``prismatic``, by ``body/joint``."""
        return {
            f"{body.name}/{joint.name}": str(joint.kind)
            for body in self.bodies
            for joint in body.description.joints
        }

    @property
    def translation_axes(self) -> tuple[int, ...]:
        """World axes of translation: x and y in a planar scene."""
        return (0, 1) if self.planar else (0, 1, 2)

    @property
    def rotation_axes(self) -> tuple[int, ...]:
        """World axes of rotation: z in a planar scene."""
        return (2,) if self.planar else (0, 1, 2)

    def joint_positions(self, joints: Sequence[int], q: Array) -> Array:
        """Positions of joints over time, without jumps of unbounded joints.

        Args:
            joints: Ids of n joints of one degree of freedom.
            q: Configurations (nt, nq).

        Returns:
            numpy.ndarray: Positions (nt, n) [rad or m].
        """
        positions = np.empty((len(q), len(joints)))
        for k, joint in enumerate(joints):
            at, unbounded = self.model.idx_qs[joint], self.model.nqs[joint] == 2
            positions[:, k] = np.unwrap(np.arctan2(q[:, at + 1], q[:, at])) if unbounded else q[:, at]
        return positions

    def body(self, name: str) -> SceneBody:
        """Body by name.

        Raises:
            ScenarioError: If it does not exist; similar names are listed.
        """
        by_name: Mapping[str, SceneBody] = {body.name: body for body in self.bodies}
        if name not in by_name:
            raise ScenarioError(f"no body {name!r}; {near_names(name, by_name)}", source=self.source)
        return by_name[name]
