"""Wrenches that force-torque sensors measure: external loads beyond a joint of an arm.

Compliant grasps and contacts follow from the state. Reactions of rigid grasps and inertial forces of links
depend on the accelerations, which depend on the controllers' torques: they are symbols until the
accelerations are solved for, and are known only at sample instants.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.closedloop.forward_dynamics import ForwardDynamicsResult
from spacerobot.closedloop.plant import link_moments
from spacerobot.dynamics import Wrench
from spacerobot.dynamics.algebra import cross
from spacerobot.dynamics.inertial_parameters import inertial_wrench, parameters_about_origin
from spacerobot.elements import Contribution, SectionContext
from spacerobot.elements.sensors.sensor import Flange
from spacerobot.scene import Scene, SceneGrasp, SceneTip
from spacerobot.symbolic import Plant


@dataclass(frozen=True)
class TipWrench:
    """Wrench through a flange, about the origin of a tip, world axes.

    Attributes:
        tip: The tip.
        flange: Location of the sensor.
        joints: Ids of the joints whose bodies are beyond it.
        links: Names of the links beyond it; empty if they are compensated.
        value: Force and torque (6x1) [N, N m], including ``unsolved`` for the part that depends on
            accelerations.
        unsolved: Symbols (6x1); None if no part depends on accelerations.
    """

    tip: SceneTip
    flange: Flange
    joints: tuple[int, ...]
    links: tuple[str, ...]
    value: ca.SX
    unsolved: ca.SX | None

    @classmethod
    def of(
        cls,
        scene: Scene,
        plant: Plant,
        place: tuple[SceneTip, Flange],
        grasps: Sequence[tuple[SceneGrasp, Contribution]],
        contacts: Iterable[Contribution],
    ) -> TipWrench:
        """Wrench of closed grasps and contacts.

        Args:
            scene, plant: The scene, and its mechanics.
            place: Tip, and location of the sensor.
            grasps: Grasps and their contributions.
            contacts: Contributions of the contacts.

        Raises:
            ScenarioError: If the joint does not exist or does not carry the tip.
        """
        tip, flange = place
        joint, links = _beyond(scene, tip, flange)
        joints = tuple(int(each) for each in plant.model.subtrees[joint])
        parts = [*(part for _, part in grasps), *contacts]
        origin = plant.placement(tip.frame)[1]
        value = _about(
            origin, (wrench for part in parts for wrench in part.wrenches if wrench.joint_id in joints)
        )
        links = () if flange.compensated else links
        rigid = any(part.constraints and grasp.tip.joint in joints for grasp, part in grasps)
        if not rigid and not links:
            return cls(tip, flange, joints, links, value, None)
        unsolved = ca.SX.sym(f"{tip.label}.{flange.joint}.{flange.compensated}.wrench", 6)
        return cls(tip, flange, joints, links, value + unsolved, unsolved)

    def solved(
        self,
        plant: Plant,
        context: SectionContext,
        acting: Contribution,
        solution: ForwardDynamicsResult,
        grasps: Sequence[tuple[SceneGrasp, Contribution]],
    ) -> ca.SX:
        """Reactions of rigid grasps minus the inertial wrench of the links beyond the sensor (6x1).

        Args:
            plant, context: Mechanics, and the scenario's numbers.
            acting, solution: All contributions, and the solved accelerations and reactions.
            grasps: Grasps and their contributions.
        """
        origin, reactions = plant.placement(self.tip.frame)[1], []
        for grasp, part in grasps:
            if grasp.tip.joint not in self.joints:
                continue
            point = plant.placement(grasp.tip.frame)[1]
            for constraint, (force, torque) in zip(acting.constraints, solution.wrenches, strict=True):
                if any(constraint is other for other in part.constraints):
                    reactions.append(Wrench(grasp.tip.joint, -force, -torque, point))
        for name in self.links:
            reactions.append(self._inertia_force(plant, context, acting.outside, solution.acceleration, name))
        return _about(origin, reactions)

    def _inertia_force(
        self, plant: Plant, context: SectionContext, outside: Sequence[Wrench], acceleration: ca.SX, name: str
    ) -> Wrench:
        """Wrench of a link's weight and inertia on its carrier."""
        body, model = self.tip.body, plant.model
        frame = int(model.getFrameId(f"{body.name}/{name}", pin.FrameType.BODY))
        joint = int(model.frames[frame].parentJoint)
        path = f"{body.path}.links.{name}"
        moments = link_moments(context.parameters, path, pin.SE3.Identity())
        inertial = context.at(path).once("inertial_parameters", parameters_about_origin(*moments))
        rotation, point = plant.placement(frame)
        motion = ca.mtimes(plant.jacobian(frame), acceleration) + ca.vertcat(*plant.drift(frame))
        gravity = ca.SX(ca.DM(np.array(model.gravity.linear)))
        for wrench in outside:
            if wrench.joint_id == joint:
                gravity = gravity + wrench.force / plant.inertias.mass[joint]
        force, torque = inertial_wrench(
            inertial,
            *(
                ca.mtimes(rotation.T, part)
                for part in (motion[:3] - gravity, plant.velocity(frame)[1], motion[3:])
            ),
        )
        return Wrench(joint, -ca.mtimes(rotation, force), -ca.mtimes(rotation, torque), point)


def with_solved(acting: Contribution, unsolved: Sequence[ca.SX], solved: Sequence[ca.SX]) -> Contribution:
    """Contribution in which sampled sensors measure the solved wrenches; zero in initial values.

    Args:
        acting: All contributions.
        unsolved, solved: Symbols, and the expressions that replace them (6x1 each).
    """
    if not unsolved:
        return acting
    symbols, values = ca.vertcat(*unsolved), ca.densify(ca.vertcat(*solved))
    zeros = ca.SX.zeros(symbols.size1())

    def substituted(expressions: Iterable[ca.SX], by: ca.SX) -> list[ca.SX]:
        return [ca.SX(one) for one in ca.substitute(list(expressions), [symbols], [by])]

    events = tuple(
        replace(
            event, updates=dict(zip(event.updates, substituted(event.updates.values(), values), strict=True))
        )
        for event in acting.events
    )
    starts = substituted((state.initial for state in acting.states), zeros)
    states = tuple(replace(state, initial=first) for state, first in zip(acting.states, starts, strict=True))
    return replace(acting, events=events, states=states)


def _about(origin: ca.SX, wrenches: Iterable[Wrench]) -> ca.SX:
    """Sum of wrenches about a point (6x1)."""
    force, torque = ca.SX(3, 1), ca.SX(3, 1)
    for wrench in wrenches:
        force, torque = (
            force + wrench.force,
            torque + wrench.torque + cross(wrench.point - origin, wrench.force),
        )
    return ca.vertcat(force, torque)


def _beyond(scene: Scene, tip: SceneTip, flange: Flange) -> tuple[int, tuple[str, ...]]:
    """Joint in the model whose subtree is beyond a flange, and the URDF's links there."""
    if flange.joint is None:
        return tip.joint, ()
    parents = {joint.child: joint for joint in tip.body.description.joints}
    link, carrying = _link_of(scene.model, tip), dict[str, Any]()
    while link in parents:
        carrying[parents[link].name] = parents[link]
        link = parents[link].parent
    if flange.joint not in carrying:
        raise scene.error(
            f"found {flange.joint!r}, allowed: joints that carry {tip.label}: {', '.join(carrying)}",
            f"{tip.body.path}.sensors",
        )
    links = [carrying[flange.joint].child]
    for each in links:  # grows while it is read
        links += [joint.child for joint in tip.body.description.joints if joint.parent == each]
    frame = scene.model.getFrameId(f"{tip.body.name}/{links[0]}", pin.FrameType.BODY)
    heavy = [each for each in links if each in tip.body.config.links]
    return int(scene.model.frames[frame].parentJoint), tuple(heavy)


def _link_of(model: Any, tip: SceneTip) -> str:
    """Name of a tip's link in the URDF."""
    return str(model.frames[tip.frame].name).removeprefix(f"{tip.body.name}/")
