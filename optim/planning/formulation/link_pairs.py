"""Pairs of links for which a plan avoids collisions: of one robot, of two, and of a robot and the target.

All links with collision shapes are paired, except pairs that touch on purpose or cannot collide:

* links that one joint joins, and links that do not move relative to each other;
* a tip's link and the link of the mating frame that it approaches or holds: approach cones and keep-out zones
  apply to these;
* links whose shapes overlap at the start, and pairs that a contact of the scenario names;
* links of bodies that stay too far apart in the longest duration. If a floating body has no driven base and
  no closed grasp, its centre of mass moves uniformly. No point of a link is farther from the centre of mass
  than the lengths between the joints allow.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from optim.planning.formulation.base_actuation import base_wrench_limits
from optim.planning.formulation.formulate import plan_section
from optim.planning.formulation.path_constraints import PREFIX
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.elements import create
from spacerobot.elements.shapes.collision_shape import wrapping_shapes
from spacerobot.scene import Scene
from spacerobot.scene.contacts import coal_distance, find_pairs
from spacerobot.scene.overlaps import Solid, overlap_depth, solids
from spacerobot.scene.reference_checks import com_from_base, joint_from_base

ALLOWED = 1e-4
"""Allowed overlap between the points of a mesh, equal to that of keep-out zones [m]."""


@dataclass(frozen=True, eq=False)
class LinkPair:
    """Two links that must not collide.

    Attributes:
        first, second: body/link.
        shapes: Collision shapes of each.
    """

    first: str
    second: str
    shapes: tuple[tuple[Solid, ...], tuple[Solid, ...]]


@dataclass(frozen=True)
class Collision:
    """Two links that overlap along a motion.

    Attributes:
        first, second: body/link.
        depth_m: Maximum depth [m].
        time_s: Instant of the maximum depth [s].
        only: Pairs of their shapes that overlap, by index as in a keep-out zone.
    """

    first: str
    second: str
    depth_m: float
    time_s: float
    only: tuple[int, ...]

    def words(self) -> str:
        """Description of the collision for messages."""
        return f"{self.first} and {self.second} overlap by {self.depth_m:.3g} m at {self.time_s:.3g} s"


def link_pairs(scene: Scene) -> list[LinkPair]:
    """Pairs of links for which a scene's plan avoids collisions; none with `collision_avoidance: false`.

    Args:
        scene: Scene with a ``plan`` section.
    """
    plans = plan_section(scene)
    if not plans.collision_avoidance:
        return []
    model, pairs = scene.model, list[LinkPair]()
    by_link: dict[str, dict[str, tuple[Solid, ...]]] = {body.name: {} for body in scene.bodies}
    for body in scene.bodies:
        body_solids = list(solids(scene, body))
        for link in body.description.links:
            link_solids = tuple(solid for solid in body_solids if solid.link == link.name)
            if link.collisions and len(link_solids) == len(link.collisions):  # all of its meshes can be read
                by_link[body.name][f"{body.name}/{link.name}"] = link_solids
    # joints whose links may touch: those of tips and of their mating frames, and those of contacts
    tips = {tip.label: tip.joint for tip in scene.tips}
    touching = {frozenset((grasp.tip.joint, grasp.joint)) for grasp in scene.grasps}
    touching |= {frozenset(shape.joint for shape in pair) for one in scene.contacts for pair in one.pairs}
    for plan in plans.by_phase.values():
        for goal in plan.goals.values():
            if goal.mating and goal.mating[0] in tips:
                tip, mating_frame = goal.mating
                frame = model.getFrameId(f"target/{mating_frame}", pin.FrameType.BODY)
                if frame < model.nframes:  # what there is not is refused where the plan is formulated
                    touching.add(frozenset((tips[tip], int(model.frames[frame].parentJoint))))
    data = model.createData()
    pin.centerOfMass(model, data, scene.q, scene.v)
    # Centre of mass of each body at the start (3,) [m], its velocity (3,) [m/s], and the maximum distance of
    # each joint's origin from it [m]. The distance is infinite if the centre of mass need not move uniformly
    # from there; a fixed base is measured from the world's origin.
    centres, reaches = dict[str, tuple[Array, Array]](), dict[str, dict[int, float]]()
    for body in scene.bodies:
        if not body.root_joint:
            reaches[body.name] = {joint: joint_from_base(scene, body, joint) for joint in (0, *body.joints)}
            centres[body.name] = np.zeros(3), np.zeros(3)
            continue
        driven = body is not scene.target and any(
            base_wrench_limits(phase.limits, body, scene.planar).largest.any()
            for phase in plans.by_phase.values()
        )
        grasped = any(
            body in (grasp.tip.body, scene.target) and (plans.phases or grasp.config.begins == "closed")
            for grasp in scene.grasps
        )
        falls = bool(np.any(model.gravity.linear))
        placed = body.name in plans.start and plans.start[body.name].places
        least = np.inf if driven or grasped or falls or placed else com_from_base(scene, body)
        place, root = data.oMi[body.root_joint], body.root_joint
        reaches[body.name] = {joint: least + joint_from_base(scene, body, joint) for joint in body.subtree}
        centres[body.name] = place.act(data.com[root]), place.rotation @ data.vcom[root]
    longest = sum(plan.duration.upper for plan in plans.by_phase.values())
    for one, other in itertools.combinations_with_replacement(scene.bodies, 2):
        if one is other:
            links = list(itertools.combinations(by_link[one.name].items(), 2))
        else:
            links = list(itertools.product(by_link[one.name].items(), by_link[other.name].items()))
        for (first, solids_of_first), (second, solids_of_second) in links:
            joints = solids_of_first[0].joint, solids_of_second[0].joint
            if joints[0] == joints[1] or frozenset(joints) in touching:
                continue
            if joints[0] == model.parents[joints[1]] or joints[1] == model.parents[joints[0]]:
                continue
            if one is not other:  # refuse those that cannot come near within the longest duration
                radii = [
                    max(reach[s.joint] + float(np.linalg.norm(s.centre)) + s.radius for s in parts)
                    for reach, parts in (
                        (reaches[one.name], solids_of_first),
                        (reaches[other.name], solids_of_second),
                    )
                ]
                away, rate = (b - a for a, b in zip(centres[one.name], centres[other.name], strict=True))
                when = np.clip(-(away @ rate) / max(float(rate @ rate), 1e-300), 0.0, longest)
                if np.linalg.norm(away + when * rate) > sum(radii):
                    continue
            places = [data.oMi[joint] for joint in joints]
            if (
                max(
                    overlap_depth(*both, *places)
                    for both in itertools.product(solids_of_first, solids_of_second)
                )
                <= 0
            ):
                pairs.append(LinkPair(first, second, (solids_of_first, solids_of_second)))
    return pairs


def unseen_steps(
    pairs: Sequence[LinkPair], model: Any, q: Array, v: Array, time: Array, depth: float
) -> npt.NDArray[np.intp]:
    """Steps between instants of a motion in which a pair may overlap by more than a depth (k,), by index.

    A distance that is a and b at two instants a time h apart, and changes by at most s in a unit of time, is
    at least (a + b - s h) / 2 between them; s is the speed of one bounding sphere's centre relative to the
    other link, and the relative spin times that sphere's radius. Bounding spheres leave few instants for
    exact distances. Shapes that overlap at an instant are known. Meshes, whose distances are not computed,
    are left out.

    Args:
        pairs, model: The pairs, and the ``pinocchio.Model`` of their scene.
        q, v, time: Configurations (n, nq), velocities (n, nv), and their times (n,) [s].
        depth: Depth [m] up to which an overlap may remain unseen.
    """
    data, joints = model.createData(), range(model.njoints)
    places, linear, angular = list[list[Any]](), list[list[Array]](), list[list[Array]]()
    for configuration, velocity in zip(q, v, strict=True):
        pin.forwardKinematics(model, data, configuration, velocity)
        places.append([place.copy() for place in data.oMi])
        twists = [pin.getVelocity(model, data, k, pin.LOCAL_WORLD_ALIGNED) for k in joints]
        linear.append([twist.linear.copy() for twist in twists])
        angular.append([twist.angular.copy() for twist in twists])
    speeds, spins, may_overlap = np.array(linear), np.array(angular), np.zeros(len(time) - 1, dtype=bool)
    rotations = np.array([[place.rotation for place in row] for row in places])
    origins = np.array([[place.translation for place in row] for row in places])
    for pair in pairs:
        for a, b in itertools.product(*pair.shapes):
            centres = [origins[:, s.joint] + rotations[:, s.joint] @ s.centre for s in (a, b)]
            gap = np.linalg.norm(centres[1] - centres[0], axis=1) - a.radius - b.radius
            small = a if a.radius < b.radius else b
            at = centres[0 if small is a else 1]
            moving = [
                speeds[:, s.joint] + np.cross(spins[:, s.joint], at - origins[:, s.joint]) for s in (a, b)
            ]
            rate = np.linalg.norm(moving[1] - moving[0], axis=1)
            rate += small.radius * np.linalg.norm(spins[:, b.joint] - spins[:, a.joint], axis=1)
            ends = np.vstack([rate[:-1], rate[1:]])
            change = (ends.max(axis=0) + np.ptp(ends, axis=0)) * np.diff(time) / 2
            steps = np.flatnonzero((gap[:-1] + gap[1:]) / 2 - change < -depth)
            if not steps.size or not (a.primitive and b.primitive):
                continue
            near = np.unique([steps, steps + 1])
            for k in near:
                gap[k] = -overlap_depth(a, b, places[k][a.joint], places[k][b.joint])
            if gap[near].min() >= -ALLOWED:
                may_overlap[steps] |= (gap[steps] + gap[steps + 1]) / 2 - change[steps] < -depth
    return np.flatnonzero(may_overlap)


def collisions(pairs: Sequence[LinkPair], model: Any, q: Array, time: Array) -> list[Collision]:
    """Pairs that overlap by more than :data:`ALLOWED` along a motion, the deepest first.

    Bounding spheres exclude most instants before exact distances are computed.

    Args:
        pairs, model: The pairs, and the ``pinocchio.Model`` of their scene.
        q, time: Configurations (n, nq) and their times (n,) [s].
    """
    data, places = model.createData(), list[list[Any]]()
    for row in q:
        pin.forwardKinematics(model, data, row)
        places.append([place.copy() for place in data.oMi])
    rotations = np.array([[place.rotation for place in row] for row in places])
    origins = np.array([[place.translation for place in row] for row in places])
    centres = {
        id(solid): origins[:, solid.joint] + rotations[:, solid.joint] @ solid.centre
        for pair in pairs
        for side in pair.shapes
        for solid in side
    }
    overlaps = []
    for pair in pairs:
        depth, when, only = 0.0, 0.0, list[int]()
        for number, (a, b) in enumerate(itertools.product(*pair.shapes)):
            apart = np.linalg.norm(centres[id(a)] - centres[id(b)], axis=1) - a.radius - b.radius
            depths = [
                (overlap_depth(a, b, places[k][a.joint], places[k][b.joint]), -float(time[k]))
                for k in np.flatnonzero(apart < -ALLOWED)
            ]
            deepest, before = max(depths, default=(0.0, 0.0))
            if deepest > ALLOWED:
                only.append(number)
                depth, when = max((depth, when), (deepest, -before), key=lambda one: one[0])
        if only:
            overlaps.append(Collision(pair.first, pair.second, depth, when, tuple(only)))
    return sorted(overlaps, key=lambda one: -one.depth_m)


def keep_apart(scene: Scene, entered: Sequence[Collision]) -> Scene:
    """Scene whose plan has a keep-out zone for the overlapping shapes of each given pair of links.

    Raises:
        ScenarioError: If a pair's shapes, or primitives around them, have no positive distance at the start.
    """
    plan = plan_section(scene)
    zones, data = dict(plan.keep_out), scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    for one in entered:
        number = next(k for k in itertools.count(1) if f"{PREFIX}_{k}" not in zones)
        between = one.first, one.second
        # around meshes and cylinders, so that the shapes of the two links are apart at the start
        for wrap in (None, *wrapping_shapes()):  # the nearest to the shape first
            try:
                pairs = find_pairs(scene, between, wrap, "plan.keep_out")
            except ScenarioError:
                continue  # a mesh without a shape around it
            placed = [(pairs[k], [data.oMf[shape.frame] for shape in pairs[k]]) for k in one.only]
            if min(coal_distance(*pair, places).min_distance for pair, places in placed) > ALLOWED:
                break
        else:
            raise scene.error(
                f"{one.words()} in the plan, and primitives around their shapes at the start, so that "
                "nothing keeps them apart; name pads in `keep_out`, or give `collision_avoidance: false`",
                "plan",
            )
        settings = {"between": between, "only": one.only, "wrap": wrap}
        zones[f"{PREFIX}_{number}"] = create("plan_limit", "keep_out", **settings)
    scenario = scene.scenario.model_copy(update={"plan": plan.model_copy(update={"keep_out": zones})})
    return dataclasses.replace(scene, scenario=scenario)
