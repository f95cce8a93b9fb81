"""Builder of a scene's elements, each from its own context."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from spacerobot.closedloop.estimator_view import EstimatorView
from spacerobot.closedloop.forward_dynamics import ForwardDynamicsResult
from spacerobot.closedloop.loop_parts import LoopParts
from spacerobot.closedloop.references import TipGuidance
from spacerobot.closedloop.robot_sensors import HeldReader, RobotSensors
from spacerobot.closedloop.tip_wrench import TipWrench, with_solved
from spacerobot.dynamics.joints import sparse
from spacerobot.dynamics.rotations import rotation_from_rpy
from spacerobot.elements import (
    ContactContext,
    Contribution,
    DesiredMotion,
    EnvironmentContext,
    FlexibleContext,
    RobotContext,
    RobotController,
    TipContext,
    TipController,
    either,
    negated,
)
from spacerobot.elements.actuators.joint_lock import known_lock
from spacerobot.elements.core.context import ContactSurface
from spacerobot.elements.core.contribution import concatenate, gated
from spacerobot.elements.core.registry import create
from spacerobot.elements.core.sampling import periodic
from spacerobot.elements.estimators.estimator import HELD_INERTIA
from spacerobot.elements.references.reference import DEGREE
from spacerobot.elements.sensors.sensor import Flange
from spacerobot.elements.sensors.signals import WRENCHES
from spacerobot.scenario import Robot
from spacerobot.scene import SceneBody, SceneTip
from spacerobot.scene.scene import SceneContact, SceneShape
from spacerobot.shapes import Shape


class LoopBuilder(LoopParts):
    """Builder of the elements of one closed loop: contexts, and the resulting contributions."""

    @functools.cached_property
    def wrenches(self) -> dict[tuple[str, Flange], TipWrench]:
        """Wrenches that force-torque sensors measure, by the tip's label and the place of the sensor."""
        return {}

    @functools.cached_property
    def leads(self) -> Mapping[str, TipGuidance]:
        """The references of each tip, by the tip's label."""
        return {
            tip.label: TipGuidance(
                tip,
                self.context,
                self.plant,
                self.start,
                self.scene.target,
                functools.partial(RobotSensors(self, tip.body).reading, tip.frame),
                RobotSensors(self, tip.body).measure,
                RobotSensors(self, tip.body).is_exact,
                self.estimators.get(tip.body.name, Contribution()),
            )
            for tip in self.scene.tips
        }

    @functools.cached_property
    def motions(self) -> Mapping[str, DesiredMotion]:
        """Desired motion of each tip, by the tip's label."""
        return {label: lead.motion for label, lead in self.leads.items()}

    @functools.cached_property
    def controllers(self) -> list[Contribution]:
        """Contributions of the controllers of tips, then of robots, in the scene's order."""
        return self.scenario_controllers()

    def scenario_controllers(self) -> list[Contribution]:
        """Contributions of the controllers that the scenario has, in the order of :attr:`controllers`."""
        contributions = [
            self._acting(f"{tip.path}.{key}", f"{tip.label}/{key}", controller, self._tip(tip, key))
            for tip in self.scene.tips
            for key, controller in tip.config.elements()
        ]
        for body in self.scene.robots:
            if isinstance(body.config, Robot):
                contributions += [
                    self._acting(
                        f"{body.path}.{key}", f"{body.name}/{key}", controller, self._robot(body, key)
                    )
                    for key, controller in body.config.elements()
                ]
        return contributions

    def contributions(self) -> list[Contribution]:
        """Contributions of all elements: controllers and estimators first, environments last."""
        contributions = [*self.controllers, *self.estimators.values()]
        contributions += [
            Contribution(states=measurement.states, events=measurement.events)
            for measurement in self.measurements.values()
        ]
        contributions += self.grasps
        contributions += self.contacts
        for body in self.scene.robots:
            if isinstance(body.config, Robot):
                contributions += self.actuators(body)
        for body in self.scene.bodies:
            for name, flexible in body.config.flexible.items():
                context = FlexibleContext(self.plant, body.description, body.name, name)
                contributions.append(flexible.build(context))
        roots = {body.name: body.root_frame for body in self.scene.bodies}
        for name, element in self.scene.scenario.environment.items():
            section = self.context.at(f"environment.{name}")
            contributions.append(element.build(EnvironmentContext(section, self.plant, roots)))
        return contributions

    @functools.cached_property
    def contacts(self) -> list[Contribution]:
        """Contributions of the contacts, in the scene's order."""
        return [contact.config.build(self.contact(contact)) for contact in self.scene.contacts]

    def tip_wrench(self, tip: SceneTip) -> tuple[ca.SX, ca.SX]:
        """Force and torque (3x1 each) on a tip, about its origin, through its robot's force-torque sensors.

        Raises:
            ScenarioError: If a continuous sensor would need the accelerations, or if no such joint carries
                the tip.
        """
        config, parts = tip.body.config, []
        sections = config.sensors if isinstance(config, Robot) else None
        for k, signal in enumerate(WRENCHES):
            sensor = create("sensor", "linear") if sections is None else sections[signal]
            key = tip.label, sensor.flange
            if key not in self.wrenches:
                grasps = list(zip(self.scene.grasps, self.grasps, strict=True))
                place = tip, sensor.flange
                self.wrenches[key] = TipWrench.of(self.scene, self.plant, place, grasps, self.contacts)
            wrench = self.wrenches[key]
            if wrench.unsolved is not None and sensor.errors is None and not sensor.holds:
                raise self.scene.error(
                    "found a continuous sensor of what depends on accelerations (rigid grasp, links beyond "
                    "the sensor); allowed: one that samples, as by `{kind: force_torque}` or with `errors`",
                    f"{tip.body.path}.sensors.{signal}",
                )
            parts.append(wrench.value[3 * k : 3 * k + 3])
        return parts[0], parts[1]

    def with_tip_wrenches(self, acting: Contribution, solution: ForwardDynamicsResult) -> Contribution:
        """Contribution whose sensors measure the solved wrenches.

        Args:
            acting, solution: All contributions, and the solved accelerations and reactions.
        """
        wrenches = [(one, one.unsolved) for one in self.wrenches.values() if one.unsolved is not None]
        grasps = list(zip(self.scene.grasps, self.grasps, strict=True))
        values = [one.solved(self.plant, self.context, acting, solution, grasps) for one, _ in wrenches]
        return with_solved(acting, [symbols for _, symbols in wrenches], values)

    def _acting(
        self, path: str, name: str, controller: TipController | RobotController, context: Any
    ) -> Contribution:
        """Contribution of a controller, continuous or evaluated periodically."""
        contribution = self._resting(path, controller.build(context))
        if controller.sampled is None:
            return contribution
        return periodic(controller.sampled, self.context.at(f"{path}.sampled"), name, contribution)

    def _resting(self, path: str, contribution: Contribution) -> Contribution:
        """Contribution of a controller that rests in some phases."""
        rests = [
            switch
            for name, switch in self.context.phases.items()
            if _is_null(self.scene.scenario.phases[name].changes, path.split("."))
        ]
        return gated(contribution, negated(either(*rests))) if rests else contribution

    @functools.cached_property
    def estimators(self) -> Mapping[str, Contribution]:
        """Contributions of the estimators of each robot, by its name."""
        contributions = {}
        for body in self.scene.robots:
            if isinstance(body.config, Robot) and body.config.estimators:
                earlier_estimators = Contribution()
                for key, estimator in body.config.estimators.items():
                    view = EstimatorView(RobotSensors(self, body), key, earlier_estimators)
                    earlier_estimators = concatenate([earlier_estimators, estimator.build(view)])
                contributions[body.name] = earlier_estimators
        return contributions

    def estimates(self, body: SceneBody) -> Mapping[str, Callable[[ca.SX], ca.SX]]:
        """Estimates of a robot's filters by signal, each a function of the true value."""
        return dict(self.estimators[body.name].estimates) if body.name in self.estimators else {}

    def _reader(self, body: SceneBody, owner: str, frame: int, columns: Sequence[int]) -> HeldReader:
        """Reader of sampled and estimated signals, with all estimates of the body."""
        return HeldReader(RobotSensors(self, body), owner, frame, columns, self.estimates(body))

    @functools.cached_property
    def first_rotations(self) -> Mapping[str, ca.SX]:
        """Attitude of each body's root link at the start (3x3), by the body's name."""
        return {
            body.name: self.context.at(body.path).once(
                "start.rotation", self.start.placement(body.root_frame)[0]
            )
            for body in self.scene.bodies
        }

    def _tip(self, tip: SceneTip, key: str) -> TipContext:
        columns = tuple(int(self.plant.model.idx_vs[joint]) for joint in tip.body.arm_joints)
        return TipContext(
            self.context.at(f"{tip.path}.{key}"),
            self.plant,
            label=tip.label,
            path=tip.path,
            key=key,
            robot=tip.body.name,
            columns=columns,
            frame=tip.frame,
            base_frame=tip.body.root_frame,
            motion=self.motions[tip.label],
            sensors=RobotSensors(self, tip.body).affine,
            held=self._reader(tip.body, tip.label, tip.frame, columns),
            siblings=tip.config.sections,
            held_inertia=self._held_inertia(tip),
            wrench=functools.partial(self.tip_wrench, tip),
            controlled=frozenset(
                motion for name, one in tip.config.elements() if (motion := one.controls(name)) is not None
            ),
            peers=lambda: tuple(
                self._tip(other, "")
                for other in self.scene.tips
                if other.body.name == tip.body.name and other.label != tip.label
            ),
        )

    def _held_inertia(self, tip: SceneTip) -> ca.SX | None:
        """Estimated inertial parameters (10x1) of the object that a tip holds; None without an estimator."""
        estimators = tip.body.config.estimators.values() if isinstance(tip.body.config, Robot) else ()
        name = tip.label.rpartition("/")[2]
        if not any(HELD_INERTIA in one.makes and (one.frames() or ("",))[0] == name for one in estimators):
            return None
        return self.estimates(tip.body)[HELD_INERTIA](ca.SX(10, 1))

    def _robot(self, body: SceneBody, key: str) -> RobotContext:
        columns = tuple(int(self.plant.model.idx_vs[joint]) for joint in body.driven_joints)
        names = tuple(body.joint_name(self.plant.model, joint) for joint in body.driven_joints)
        assert isinstance(body.config, Robot)
        lockable = {name for _, one in body.config.driven_by() for name in one.locks(names)}
        locked = ca.SX(len(names), 1)
        for i in (i for i, name in enumerate(names) if name in lockable):
            locked[i] = known_lock(self.context.constants, body.name, names[i])
        return RobotContext(
            self.context.at(f"{body.path}.{key}"),
            self.plant,
            self.start,
            name=body.name,
            joints=body.driven_joints,
            columns=columns,
            joint_names=names,
            positions=body.positions,
            phase_time=self.phase_time,
            sensors=RobotSensors(self, body).affine,
            held=self._reader(body, body.name, body.root_frame, columns),
            base_frame=body.root_frame,
            arm=tuple(int(self.plant.model.idx_vs[joint]) for joint in body.arm_joints),
            tips=tuple(self._tip(tip, "") for tip in self.scene.tips if tip.body.name == body.name),
            locked=locked,
        )

    def contact(self, contact: SceneContact) -> ContactContext:
        """Context from which a contact is built."""
        surfaces = {shape: self._surface(shape) for pair in contact.pairs for shape in pair}
        pairs = tuple((surfaces[first], surfaces[second]) for first, second in contact.pairs)
        return ContactContext(self.context.at(contact.path), self.plant, contact.name, pairs)

    def _surface(self, shape: SceneShape) -> ContactSurface:
        """Contact surface of a shape at its present pose; a pad's numbers are parameters."""
        rotation, origin = self.plant.placement(shape.frame)
        if shape.path is None:
            measures = shape.config.measures()
            turn, position = sparse(shape.placement[:3, :3]), sparse(shape.placement[:3, 3])
        else:
            context = self.context.at(shape.path)
            measures, position = shape.config.measures(context), context.vector("position")
            angles = context.parameters.sparse_vector(f"{context.path}.rotation_deg") * DEGREE
            turn = context.once("turn", rotation_from_rpy(angles))
        shape_rotation, place = ca.mtimes(rotation, turn), origin + ca.mtimes(rotation, position)
        return ContactSurface(
            Shape(type(shape.config), shape_rotation, place, measures), shape.frame, shape.joint
        )


def _is_null(changes: Any, keys: Sequence[str]) -> bool:
    """Whether changes set the section at these keys to null."""
    for key in keys:
        if not isinstance(changes, dict) or key not in changes:
            return False
        changes = changes[key]
    return changes is None
