"""View of one instant of a plan for its goals, costs and limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.formulation.reaction_wheels import WheelDrivenBase, wheel_driven_bases
from optim.planning.formulation.stage import Stage, spring_forces
from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.section import matching
from spacerobot.dynamics import (
    Inertias,
    centre_of_mass,
    forward_kinematics,
    kinetic_energy,
    momentum,
    rotation_log,
    total_mass,
)
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.joints import exact_directions, sparse
from spacerobot.elements.goals.goal import Goal
from spacerobot.elements.goals.plan_instant import JointCoordinate, MovingFrame
from spacerobot.elements.shapes.collision_shape import Wrap
from spacerobot.scene import Scene
from spacerobot.scene.contacts import find_pairs
from spacerobot.scene.scene import SceneBody, SceneShape
from spacerobot.shapes import Implicit, MovingShape, Shape, approach_speed, held_gap

T = TypeVar("T")
AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Force and torque axes of a driven base, in its own frame."""


class PlannedBase(NamedTuple):
    """Floating base of a robot.

    Attributes:
        frame: Frame of its root link.
        rotation: Rotation vector since the start (3x1) [rad], initial root-link axes.
        translation: Displacement since the start (3x1) [m], world axes.
        force, torque: Force [N] and torque [N m] of its actuators (3x1 each), root-link axes; structurally
            zero without actuators.
    """

    frame: MovingFrame
    rotation: ca.SX
    translation: ca.SX
    force: ca.SX
    torque: ca.SX


@dataclass(frozen=True, eq=False)
class InstantView:
    """Instant of a plan as one section of the scenario reads it, for its goals, limits and costs.

    Implements :class:`spacerobot.elements.goals.plan_instant.PlanInstant`.

    Attributes:
        stage: The instant.
        where: Dotted path of the section, for messages.
        goals: Goals of the plan, by name.
    """

    stage: Stage
    where: str
    goals: Mapping[str, Goal] = field(default_factory=dict)

    def signal(self, name: str) -> dict[str, ca.SX]:
        """Columns of a signal, by label."""
        if name not in SIGNALS:
            raise self.fault(
                f"no signal {name!r} at an instant of a plan; {near_names(name, SIGNALS)}", "kind"
            )
        return SIGNALS[name](self)

    @property
    def axes(self) -> Sequence[int]:
        """Indices of the axes of translation: x and y in a plane, x, y and z in space."""
        return self.stage.scene.translation_axes

    @property
    def turns(self) -> Sequence[int]:
        """Indices of the axes of rotation: z in a plane, x, y and z in space."""
        return self.stage.scene.rotation_axes

    def tip(self, label: str, key: str = "tip") -> MovingFrame:
        """Frame of a tip, by robot/tip."""
        tips = {tip.label: tip for tip in self.stage.scene.tips}
        return self._frame(self._named(tips, f"tip {label!r}", label, key).frame)

    def mating(self, link: str, key: str = "frame") -> MovingFrame:
        """Frame of a link of the target."""
        scene = self.stage.scene
        if scene.target is None:
            raise self.fault("there is no target", key)
        links = {one.name: f"target/{one.name}" for one in scene.target.description.links}
        label = self._named(links, f"link {link!r} in the target's URDF", link, key)
        return self._frame(int(scene.model.getFrameId(label, pin.FrameType.BODY)))

    def root(self, body: str, key: str) -> tuple[ca.SX, ca.SX]:
        """Linear and angular velocity of a floating root link, its own axes (3x1 each) [m/s, rad/s]."""
        model, bodies = self.stage.scene.model, {one.name: one for one in self.stage.scene.bodies}
        joint = self._named(bodies, f"body {body!r}", body, key).root_joint
        if not joint:
            raise self.fault(f"the base of {body!r} is fixed, so it is always at rest", key)
        first, size = int(model.idx_vs[joint]), int(model.nvs[joint])
        middle = first + size - (3 if size == 6 else 1)
        return self.stage.v[first:middle], self.stage.v[middle : first + size]

    def joined(self, body: str, key: str) -> Sequence[str]:
        """Names of the body and of the bodies that closed grasps join with it."""
        scene = self.stage.scene
        self._named({one.name: one for one in scene.bodies}, f"body {body!r}", body, key)
        holding = [grasp.tip.body.name for grasp in (*self.stage.grips, *self.stage.springs)]
        group = [scene.target.name, *holding] if scene.target is not None and holding else []
        return [*dict.fromkeys((body, *group))] if body in group else [body]

    def base(self, robot: str, key: str) -> MovingFrame:
        """Frame of a robot's floating root link."""
        body = find_robot(self.stage.scene, robot, f"{self.where}.{key}")
        if not body.root_joint:
            raise self.fault(
                f"the base of {robot!r} is fixed, so its attitude never changes; give it `joint: free_flyer` "
                "or `planar`",
                key,
            )
        return self._frame(body.root_frame)

    def joints(self, robot: str, given: Mapping[str, T], key: str) -> Iterator[tuple[JointCoordinate, T]]:
        """Joints of a robot that match patterns, each with the value of its pattern."""
        scene = self.stage.scene
        body = find_robot(scene, robot, f"{self.where}.robot")
        for name, joint, each in joints_named(scene, body, given, f"{self.where}.{key}"):
            yield self._joint(name, joint), each

    def turned(self, desired: ca.SX, actual: ca.SX) -> ca.SX:
        """Rotation vector (3x1) [rad] from one orientation to another."""
        relative = ca.mtimes(desired.T, actual)
        if self.stage.scene.planar:
            return ca.atan2(relative[1, 0], relative[0, 0])
        return rotation_log(relative)

    def fault(self, message: str, key: str) -> ScenarioError:
        """Error located at a key of the section."""
        return self.stage.scene.error(message, f"{self.where}.{key}")

    def link(self, label: str, key: str = "link") -> MovingFrame:
        """Frame of a robot's link, by robot/link."""
        scene, (robot, _, link) = self.stage.scene, label.partition("/")
        body = find_robot(scene, robot, f"{self.where}.{key}")
        self._named({one.name: one for one in body.description.links}, f"link {link!r}", link, key)
        return self._frame(int(scene.model.getFrameId(label, pin.FrameType.BODY)))

    def flexible(self, body: str, key: str) -> dict[str, tuple[ca.SX, ca.SX]]:
        """Position and rate of each joint of a body's flexible links."""
        model, bodies = self.stage.scene.model, {one.name: one.passive for one in self.stage.scene.bodies}
        flexible = {name: passive for name, passive in bodies.items() if passive}
        selected_joints = self._named(flexible, f"flexible links of {body!r}", body, key)
        joints = {model.names[joint]: model.joints[joint] for joint in selected_joints}
        return {name: (self.stage.q[one.idx_q], self.stage.v[one.idx_v]) for name, one in joints.items()}

    def bases(self) -> dict[str, PlannedBase]:
        """Floating bases, by robot."""
        stage, planned_bases = self.stage, {}
        scene, moving = stage.scene, stage.kinematics
        still = forward_kinematics(scene.model, ca.SX(np.asarray(scene.q)))
        for body in scene.robots:
            root = body.root_joint
            if not root:
                continue
            wrench, turn = ca.SX(6, 1), ca.SX(3, 1)
            for name, value in zip(stage.driven.names, ca.vertsplit(stage.u), strict=True):
                base, _, axis = name.rpartition(".")
                if base == f"{body.name}/base":
                    wrench[AXES.index(axis)] = value
            began = exact_directions(np.array(ca.DM(still.rotation[root])))
            turn[list(self.turns)] = self.turned(began, moving.rotation[root])
            shift = moving.origin[root] - ca.SX(ca.DM(still.origin[root]))
            frame = self._frame(body.root_frame)
            planned_bases[body.name] = PlannedBase(frame, turn, shift, wrench[:3], wrench[3:])
        return planned_bases

    def base_reactions(self) -> dict[str, tuple[ca.SX, ca.SX]]:
        """Wrenches of the robots' arms on their bases, by robot, along and about the scene's world axes.

        Force [N], and torque [N m] about the root link's origin; on a fixed base with the opposite sign. On a
        floating base it is the rate of momentum of the root link and its wheels, minus gravity and the base's
        actuation; on a fixed base the same balance is taken for the arm. Grasp forces act at their tips.
        """
        stage, scene, model = self.stage, self.stage.scene, self.stage.scene.model
        if scene.scenario.environment:
            raise self.fault("reactions of arms are not available with an environment; leave it out", "kind")
        moving = stage.kinematics
        inertias, reactions = Inertias.from_model(model), {}
        state, rate = ca.vertcat(stage.q, stage.v), ca.vertcat(stage.rate, stage.a)
        for body in scene.robots:
            # flexible panels of the base belong to the base, flexible booms to the arm
            arm_joints = set(body.driven_joints)
            panels = [j for j in body.passive if arm_joints.isdisjoint(model.supports[j])]
            floating = (body.root_joint, *body.owned, *panels)
            joints = floating if body.root_joint else body.joints
            # rate of momentum minus gravity and grasp forces, about the root link's origin
            momenta = ca.vertcat(*momentum(model, moving, inertias, joints))
            momentum_rate = ca.jtimes(momenta, state, rate)
            force, torque = momentum_rate[:3], momentum_rate[3:]
            weight = total_mass(model, inertias, joints) * sparse(np.asarray(model.gravity.linear))
            acting = [(weight, centre_of_mass(model, moving, inertias, joints))] if weight.nnz() else []
            for grip in (*stage.grips, *stage.springs):
                if int(model.frames[grip.tip.frame].parentJoint) in joints:
                    pull, twist = ca.SX(3, 1), ca.SX(3, 1)
                    pull[list(scene.translation_axes)], turn = stage.wrench(grip)
                    if turn.numel():
                        twist[list(scene.rotation_axes)] = turn
                    acting.append((pull, stage.placement(grip.tip.frame)[1]))
                    torque -= twist
            for pull, place in acting:
                force, torque = force - pull, torque - cross(place, pull)
            rotation, origin = stage.placement(body.root_frame)
            wrench = ca.vertcat(force, torque - cross(origin, force))
            for name, drive in zip(stage.driven.names, ca.vertsplit(stage.u), strict=True):
                base, _, axis = name.rpartition(".")
                if base == f"{body.name}/base":
                    first = 0 if axis[0] == "f" else 3
                    wrench[first : first + 3] -= rotation[:, "xyz".index(axis[1])] * drive
            about = [3 + axis for axis in self.turns]
            reactions[body.name] = wrench[list(self.axes)], wrench[about]
        return reactions

    def grips(self) -> dict[str, tuple[ca.SX, ca.SX]]:
        """Force [N] and torque [N m] of each closed grasp on its tip, by grasp."""
        return {grip.name: self.stage.wrench(grip) for grip in (*self.stage.grips, *self.stage.springs)}

    def wheels(self) -> dict[str, WheelDrivenBase]:
        """Reaction wheels of each base that only wheels drive, by robot."""
        driven_bases = wheel_driven_bases(self.stage)
        if not driven_bases:
            raise self.stage.scene.error(
                "no robot's base is turned by one set of `reaction_wheels` alone, so that momentum is not "
                "conserved or there is none; leave it out, or `base_force` and other actuators of the base",
                self.where,
            )
        return driven_bases

    def gaps(
        self, between: tuple[str, str], wrap: Wrap | None
    ) -> Iterator[tuple[str, ca.SX, Implicit, ca.SX]]:
        """Distances [m] of pairs of shapes, with name, inner iteration and maximum rate of change [m/s]."""
        for pair in find_pairs(self.stage.scene, between, wrap, self.where):
            first, second = (self._moving_shape(shape) for shape in pair)
            gap, about = held_gap(first.shape, second.shape)
            yield f"{pair[0].label} to {pair[1].label}", gap, about, approach_speed([first, second])

    def _named(self, there: Mapping[str, T], words: str, name: str, key: str) -> T:
        if name not in there:
            raise self.fault(f"no {words}; {near_names(name, there)}", key)
        return there[name]

    def _joint(self, name: str, joint: int) -> JointCoordinate:
        joint_model, stage = self.stage.scene.model.joints[joint], self.stage
        place = slice(joint_model.idx_q, joint_model.idx_q + joint_model.nq)
        model, bounded = stage.scene.model, joint_model.nq == joint_model.nv
        lower = float(model.lowerPositionLimit[joint_model.idx_q]) if bounded else -np.inf
        upper = float(model.upperPositionLimit[joint_model.idx_q]) if bounded else np.inf
        return JointCoordinate(name, stage.q[place], stage.v[joint_model.idx_v], lower, upper)

    def _frame(self, frame: int) -> MovingFrame:
        return MovingFrame(*self.stage.placement(frame), *self.stage.velocity(frame))

    def _moving_shape(self, shape: SceneShape) -> MovingShape:
        """A shape that moves with its link."""
        rotation, origin = self.stage.placement(shape.frame)
        velocity, spin = self.stage.velocity(shape.frame)
        arm = ca.mtimes(rotation, sparse(shape.placement[:3, 3]))
        placed = Shape(
            type(shape.config),
            ca.mtimes(rotation, exact_directions(shape.placement[:3, :3])),
            origin + arm,
            shape.config.measures(),
        )
        return MovingShape(placed, velocity + cross(spin, arm), spin)


def find_robot(scene: Scene, name: str, where: str) -> SceneBody:
    """Robot of a given name.

    Raises:
        ScenarioError: If there is none; the message lists similar names.
    """
    robots = {body.name: body for body in scene.robots}
    if name not in robots:
        raise scene.error(f"no robot {name!r}; {near_names(name, robots)}", where)
    return robots[name]


def joints_named(
    scene: Scene, body: SceneBody, values: Mapping[str, T], where: str
) -> Iterator[tuple[str, int, T]]:
    """Name, number and pattern value of each joint of a body that a pattern matches.

    Raises:
        ScenarioError: If a pattern matches no joint.
    """
    ids = {body.joint_name(scene.model, j): j for j in body.driven_joints}
    for pattern, each in values.items():
        names = matching(ids, pattern)
        if not names:
            raise scene.error(f"no joint {pattern!r}; {near_names(pattern, ids)}", where)
        for name in names:
            yield name, ids[name], each


def _by_joint(stage: Stage, values: Sequence[ca.SX]) -> dict[str, ca.SX]:
    """Values of the driven joints, without those of bases, by robot/joint."""
    return dict(zip(stage.driven.names[: len(stage.driven.joints)], values, strict=False))


def _vectors(wrenches: Mapping[str, tuple[ca.SX, ca.SX]], part: int, axes: Sequence[int]) -> dict[str, ca.SX]:
    """Forces (part 0) or torques (part 1) of wrenches as vectors (3x1).

    Wrenches without the part are left out.
    """
    vectors = {label: ca.SX(3, 1) for label, wrench in wrenches.items() if wrench[part].numel()}
    for label, vector in vectors.items():
        vector[list(axes)] = wrenches[label][part]
    return vectors


def _arrivals(view: InstantView) -> dict[str, ca.SX]:
    """Linear and angular velocity of tips relative to the mating frames of their goals, by goal."""
    velocities = dict[str, ca.SX]()
    for name, goal in view.goals.items():
        arrival = goal.arrival(InstantView(view.stage, f"plan.goals.{name}"))
        if arrival is not None:
            velocities |= {f"{name} velocity": arrival[0], f"{name} spin": arrival[1]}
    return velocities


def _vibration_energy(view: InstantView) -> dict[str, ca.SX]:
    """Elastic energy of flexible links plus kinetic energy of their elastic motion alone [J]."""
    stage, model = view.stage, view.stage.scene.model
    rates, elastic = ca.SX(model.nv, 1), ca.SX(0)
    springs = spring_forces(stage.scene, stage.q)
    for joint in (model.joints[j] for body in stage.scene.bodies for j in body.passive):
        rates[joint.idx_v] = stage.v[joint.idx_v]
        elastic += springs[joint.idx_v] * stage.q[joint.idx_q] / 2
    moving = forward_kinematics(model, stage.q, rates)
    return {"total": elastic + kinetic_energy(model, moving, Inertias.from_model(model))}


SIGNALS: Mapping[str, Callable[[InstantView], dict[str, ca.SX]]] = {
    "joint_torque": lambda view: _by_joint(view.stage, ca.vertsplit(view.stage.u)),
    "joint_rate": lambda view: _by_joint(view.stage, [view.stage.v[k] for k in view.stage.driven.columns]),
    "joint_acceleration": lambda view: _by_joint(
        view.stage, [view.stage.a[k] for k in view.stage.driven.columns]
    ),
    "tip_position": lambda view: {tip.label: view.tip(tip.label).origin for tip in view.stage.scene.tips},
    "tip_velocity": lambda view: {tip.label: view.tip(tip.label).velocity for tip in view.stage.scene.tips},
    "base_force": lambda view: {name: base.force for name, base in view.bases().items()},
    "base_torque": lambda view: {name: base.torque for name, base in view.bases().items()},
    "base_rotation": lambda view: {name: base.rotation for name, base in view.bases().items()},
    "base_velocity": lambda view: {name: base.frame.velocity for name, base in view.bases().items()},
    "base_spin": lambda view: {name: base.frame.spin for name, base in view.bases().items()},
    "base_translation": lambda view: {name: base.translation for name, base in view.bases().items()},
    "reaction_force": lambda view: _vectors(view.base_reactions(), 0, view.axes),
    "reaction_torque": lambda view: _vectors(view.base_reactions(), 1, view.turns),
    "grasp_force": lambda view: _vectors(view.grips(), 0, view.axes),
    "grasp_torque": lambda view: _vectors(view.grips(), 1, view.turns),
    "single_wheel_momentum": lambda view: {
        f"{name} wheel {k}": momentum
        for name, wheels in view.wheels().items()
        for k, momentum in enumerate(ca.vertsplit(wheels.momenta))
    },
    "vibration_energy": _vibration_energy,
    "arrival": _arrivals,
}
"""Functions for the signals of an instant, by name; registered quantities are expressions of signals."""
