"""The elements of a scene, each built from what it may see."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import casadi as ca

from spacerobot.closedloop.references import TipGuidance
from spacerobot.dynamics.joints import sparse
from spacerobot.dynamics.rotations import rotation_from_rpy
from spacerobot.elements import (
    Actuator,
    ActuatorContext,
    ContactContext,
    Contribution,
    DesiredMotion,
    EnvironmentContext,
    FlexibleContext,
    GraspContext,
    RobotContext,
    RobotController,
    SectionContext,
    State,
    TipContext,
    TipController,
    either,
    memory,
    negated,
)
from spacerobot.elements.actuators.joint_lock import known_lock
from spacerobot.elements.core.context import Affine, ContactSurface, Held, unbroken
from spacerobot.elements.core.contribution import concatenate, gated
from spacerobot.elements.core.sampling import periodic
from spacerobot.elements.estimators.estimator import HELD_INERTIA, EstimatorContext
from spacerobot.elements.grasps.capture_release import living
from spacerobot.elements.references.reference import DEGREE
from spacerobot.elements.sensors.measurement import Measurement, Observation, changing, filled
from spacerobot.elements.sensors.sensor import ideal, measured
from spacerobot.scenario import Robot
from spacerobot.scenario.sensors import Sensors
from spacerobot.scene import Scene, SceneBody, SceneGrasp, SceneTip
from spacerobot.scene.scene import SceneContact, SceneShape
from spacerobot.scene.target_model import target_model
from spacerobot.shapes import Shape
from spacerobot.symbolic import InitialState, Plant


@dataclass(frozen=True)
class LoopBuilder:
    """Builder of the elements of one closed loop, with the data that they share.

    Attributes
    ----------
    scene
        The scene.
    context
        Time, and the scenario's numbers.
    plant, start
        Mechanics now, and where everything begins.
    remembered
        What is remembered of phases, by a short name.
    measurements
        What controllers read at instants, by name.
    driven
        What actuators of a robot contribute, by its name, as far as they are built.
    pushed
        Impulses of the actuators of bases that estimators count (2 or 3 linear, 1 or 3 angular components),
        by the base's joint.
    affine
        Offset and scale of the sensors that are read, by path.
    break_point
        As of :class:`~spacerobot.elements.ActuatorContext`; None unless the loop is linearised.
    """

    scene: Scene
    context: SectionContext
    plant: Plant
    start: InitialState
    remembered: dict[str, State] = field(default_factory=dict)
    measurements: dict[str, Measurement] = field(default_factory=dict)
    driven: dict[str, list[Contribution]] = field(default_factory=dict)
    pushed: dict[int, ca.SX] = field(default_factory=dict)
    affine: dict[str, Affine] = field(default_factory=dict)
    break_point: Callable[[str, Sequence[str], ca.SX], ca.SX] | None = None

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
                functools.partial(self._shown, tip.body, tip.frame),
                self._measure(tip.body),
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
        """Of the controllers of tips and those of robots, in the scene's order."""
        found = [
            self._acting(f"{tip.path}.{key}", f"{tip.label}/{key}", controller, self._tip(tip, key))
            for tip in self.scene.tips
            for key, controller in tip.config.elements()
        ]
        for body in self.scene.robots:
            if isinstance(body.config, Robot):
                found += [
                    self._acting(
                        f"{body.path}.{key}", f"{body.name}/{key}", controller, self._robot(body, key)
                    )
                    for key, controller in body.config.elements()
                ]
        return found

    def contributions(self) -> list[Contribution]:
        """Of controllers, grasps, contacts, actuators and environments, in the scene's order."""
        found = [*self.controllers, *self.estimators.values()]
        found += [Contribution(states=one.states, events=one.events) for one in self.measurements.values()]
        found += self.grasps
        found += [contact.config.build(self.contact(contact)) for contact in self.scene.contacts]
        for body in self.scene.robots:
            if isinstance(body.config, Robot):
                found += self._actuators(body)
        for body in self.scene.bodies:
            for name, flexible in body.config.flexible.items():
                seen = FlexibleContext(self.plant, body.description, body.name, name)
                found.append(flexible.build(seen))
        roots = {body.name: body.root_frame for body in self.scene.bodies}
        for name, element in self.scene.scenario.environment.items():
            context = self.context.at(f"environment.{name}")
            found.append(element.build(EnvironmentContext(context, self.plant, roots)))
        return found

    @functools.cached_property
    def grasps(self) -> list[Contribution]:
        """Of the grasps, in the scene's order."""
        return [living(grasp.config, self._grasp(grasp)) for grasp in self.scene.grasps]

    def grasp_switch(self, name: str, kind: Literal["closed", "released"]) -> ca.SX:
        """Whether a grasp is closed, or released (1x1)."""
        constants, path = self.context.constants, f"grasps.{name}.{kind}"
        return constants.switch(path) if path in constants.switches else ca.SX(kind == "closed")

    def memory(self, name: str) -> State:
        """Scalar state of the phases that is stored under a name; created on first use."""
        if name not in self.remembered:
            self.remembered[name] = memory(f"phase.{name}", ca.SX.zeros(1))
        return self.remembered[name]

    def passed(self) -> ca.SX:
        """Time since the present phase began (1x1) [s], since the start where there are no phases."""
        time = self.context.time
        return time - self.memory("began_at").symbol if self.context.phases else time

    def _acting(
        self, path: str, name: str, controller: TipController | RobotController, seen: Any
    ) -> Contribution:
        """Contribution of a controller, continuous or evaluated periodically."""
        found = self._resting(path, controller.build(seen))
        if controller.sampled is None:
            return found
        return periodic(controller.sampled, self.context.at(f"{path}.sampled"), name, found)

    def _resting(self, path: str, contribution: Contribution) -> Contribution:
        """Contribution of a controller that rests in some phases."""
        rests = [
            switch
            for name, switch in self.context.phases.items()
            if _is_null(self.scene.scenario.phases[name].changes, path.split("."))
        ]
        return gated(contribution, negated(either(*rests))) if rests else contribution

    def _sensors(self, body: SceneBody) -> Callable[[str], Affine]:
        sensors = body.config.sensors if isinstance(body.config, Robot) else None
        if sensors is None:
            return ideal
        return lambda signal: self._affine(body, sensors, signal)

    def _affine(self, body: SceneBody, sensors: Sensors, signal: str) -> Affine:
        """Offset and scale of a sensor, with one pair of constants however often it is read."""
        path = f"{body.path}.sensors.{signal}"
        if path not in self.affine:
            self.affine[path] = sensors[signal].affine(self.context.at(path))
        return self.affine[path]

    def _measure(self, body: SceneBody) -> Callable[[str, str, Observation], Measurement | None]:
        sensors = body.config.sensors if isinstance(body.config, Robot) else None

        def measure(signal: str, name: str, observed: Observation) -> Measurement | None:
            if sensors is None:
                return None
            context = self.context.at(f"{body.path}.sensors.{signal}")
            return sensors[signal].measurement(name, context, observed)

        return measure

    def _shown(self, body: SceneBody, frame: int, signal: str, value: ca.SX) -> ca.SX | None:
        """Vector in world axes (3x1) as shown by a sensor that a frame carries; None without sensors."""
        sensors = body.config.sensors if isinstance(body.config, Robot) else None
        if sensors is None:
            return None
        context, axes = self.context.at(f"{body.path}.sensors.{signal}"), self.plant.placement(frame)[0]
        if not signal.startswith("joint_"):
            value = sensors[signal].aligned(context, value, axes)
        return measured(self._affine(body, sensors, signal), value)

    def _held(
        self,
        body: SceneBody,
        owner: str,
        frame: int,
        columns: Sequence[int],
        made: Mapping[str, Callable[[ca.SX], ca.SX]] | None = None,
    ) -> Held:
        """Reader of signals that are measured at instants; all that read one see the same.

        ``made`` are the estimates that are there, all of the body's if None.
        """
        measure, estimates = self._measure(body), self.estimates(body) if made is None else made
        sensors = body.config.sensors if isinstance(body.config, Robot) else None

        def held(
            signal: str, value: ca.SX, world: ca.SX | None = None, point: ca.SX | None = None
        ) -> ca.SX | None:
            """Estimate, or held value, of a signal; None where it is read continuously at what it is of."""
            at_motors = sensors is not None and sensors[signal].reads_motors
            if at_motors:
                value = self._at_motors(body, columns, signal, value)
            own = signal.startswith(("tip_", "target_"))
            whose, away = f"{owner if own else body.name}.{signal}", None
            name, found = f"{whose}.{value.size1()}", None
            shown = self._shown(body, frame, signal, value)
            if world is not None and shown is not None:
                shown = world + shown - value
            if signal.startswith("target_") and self.scene.target is not None:
                places = (self.plant.placement(each)[1] for each in (self.scene.target.root_frame, frame))
                away = ca.norm_2(ca.densify(next(places) - next(places)))
            if signal in estimates and signal == "target_velocity":
                assert self.scene.target is not None, "scenes without a target are refused"
                root, true = self.scene.target.root_frame, value
                if point is None:
                    point, true = self.plant.placement(root)[1], self.plant.velocity(root)[0]
                found = estimates[signal](point) + value - true
            elif signal in estimates:
                origin = self.plant.placement(frame)[1] if signal == "target_position" else ca.SX(0)
                found = estimates[signal](value + origin) - origin
                found = found if world is None else world + found - value
            elif shown is not None:
                if name not in self.measurements:
                    sampled = measure(signal, name, Observation(changing(shown), away))
                    if sampled is not None:
                        self.measurements[name] = sampled
                if name in self.measurements:
                    found = filled(shown, self.measurements[name].known)
            if at_motors and found is None:
                found = shown
            if self.break_point is None:
                return found
            known = value if shown is None else shown
            known = known if found is None else found
            entries = changing(known)
            names = [f"{whose}[{i}]" for i in range(entries.size1())]
            return filled(known, self.break_point("measurement", names, entries))

        return held

    @functools.cached_property
    def estimators(self) -> Mapping[str, Contribution]:
        """Of the estimators of each robot, by its name."""
        found = {}
        for body in self.scene.robots:
            if isinstance(body.config, Robot) and body.config.estimators:
                built = Contribution()
                for key, estimator in body.config.estimators.items():
                    own = estimator.build(self._estimator(body, key, built))
                    built = concatenate([built, own])
                found[body.name] = built
        return found

    def estimates(self, body: SceneBody) -> Mapping[str, Callable[[ca.SX], ca.SX]]:
        """From true values to those that filters of a body estimate, by signal."""
        return dict(self.estimators[body.name].estimates) if body.name in self.estimators else {}

    def _estimator(self, body: SceneBody, key: str, above: Contribution) -> EstimatorContext:
        """Context of an estimator: it has samples of its own, or reads what controllers read."""
        assert isinstance(body.config, Robot)
        path, sensors, made = body.path, body.config.sensors or Sensors(), dict(above.estimates)
        monitors = {(name, one.rejects()) for name, one in body.config.estimators.items()}
        columns = tuple(int(self.plant.model.idx_vs[joint]) for joint in body.driven_joints)
        held = self._held(body, body.name, body.root_frame, columns, made)
        affine = self._sensors(body)

        def read(signal: str, value: ca.SX) -> ca.SX:
            """Last estimate or sample of a signal, or what its sensor shows now."""
            last = held(signal, value)
            return measured(affine(signal), value) if last is None else last

        def late(signal: str) -> float:
            """Delay of a signal that is not estimated [s]."""
            errors = sensors[signal].errors
            return 0.0 if errors is None or signal in made else errors.delay

        def closed(tip: str, frame: str) -> ca.SX:
            """Whether one of the grasps of a tip and a link of the target is closed."""
            _ = self.grasps  # which make the switches
            label = f"{body.name}/{tip}"
            held = [g for g in self.scene.grasps if g.tip.label == label and g.config.frame == frame]
            return either(*(self.grasp_switch(grasp.name, "closed") for grasp in held))

        def stored() -> ca.SX:
            """Angular momentum of the robot's wheels."""
            parts = [one.stored for one in self._actuators(body)]
            return sum((wheel.angular for part in parts for wheel in part), ca.SX(3, 1))

        def rejected(signal: str) -> ca.SX:
            """Whether a monitor of this estimator found that the signal's sensor has failed."""
            own = sorted(name for name, rejects in monitors if rejects == (key, signal))
            switch = self.context.constants.switch
            return either(*(switch(f"{path}.estimators.{name}.detected") for name in own))

        def pushed() -> ca.SX:
            """Impulse of the actuators of its base."""
            assert isinstance(body.config, Robot)
            found = ca.SX(6, 1)
            if any(actuator.base_wrench for _, actuator in body.config.driven_by()):
                axes = [*self.plant.translation_axes, *(axis + 3 for axis in self.plant.rotation_axes)]
                symbol = ca.SX.sym(f"{body.name}.pushed", len(axes))
                found[axes] = self.pushed.setdefault(body.root_joint, symbol)
            return found

        def sample(
            signal: str,
            value: ca.SX,
            axes: tuple[int, ...],
            carrier: ca.SX | None = None,
            away: tuple[ca.SX, ca.SX] | None = None,
        ) -> Measurement:
            """Samples of one signal, with the errors of its sensor."""
            context = self.context.at(f"{path}.sensors.{signal}")
            own, attitude = sensors[signal], None
            value = own.aligned(context, value, carrier)
            if value.size2() == 3:
                value, attitude = ca.SX(3, 1), value
            shown = measured(own.affine(context), value)
            if away is not None and attitude is None:
                shown = shown + away[0]
            shown = ca.densify(shown[list(axes)])
            observed = Observation(shown, away[1] if away else None, attitude, stamped=True)
            name = f"{body.name}/{key}.{signal}"
            found = own.measurement(name, context, observed)
            assert found is not None, "scenes are refused whose filters lack a measurement"
            self.measurements[name] = found
            return found

        return EstimatorContext(
            self.context.at(f"{path}.estimators.{key}"),
            self.plant,
            f"{body.name}/{key}",
            body.name,
            body.root_frame,
            lambda signal: self.context.at(f"{path}.sensors.{signal}.errors"),
            sample,
            {tip.label.rpartition("/")[2]: tip.frame for tip in self.scene.tips if tip.body is body},
            target_model(self.scene),
            body.driven_joints,
            functools.partial(_positions, body),
            self.start.placement(body.root_frame)[0],
            read,
            late,
            closed,
            stored,
            lambda name: [one for one in above.innovations if one.filter == f"{body.name}/{name}"],
            rejected,
            pushed,
        )

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
            sensors=self._sensors(tip.body),
            held=self._held(tip.body, tip.label, tip.frame, columns),
            siblings=tip.config.sections,
            held_inertia=self._held_inertia(tip),
        )

    def _held_inertia(self, tip: SceneTip) -> ca.SX | None:
        """Inertial parameters (10x1) of what a tip holds, as an estimator of its robot estimates them."""
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
            positions=functools.partial(_positions, body),
            passed=self.passed,
            sensors=self._sensors(body),
            held=self._held(body, body.name, body.root_frame, columns),
            base_frame=body.root_frame,
            arm=tuple(int(self.plant.model.idx_vs[joint]) for joint in body.arm_joints),
            tips=tuple(self._tip(tip, "") for tip in self.scene.tips if tip.body.name == body.name),
            locked=locked,
        )

    def _actuators(self, body: SceneBody) -> list[Contribution]:
        """Of a robot's actuators, in their order; some see the momentum of the others' wheels."""
        if body.name in self.driven:
            return self.driven[body.name]
        assert isinstance(body.config, Robot)
        own = dict(body.config.driven_by())
        built = {
            key: one.build(self._actuator(body, key, one)) for key, one in own.items() if not one.sees_wheels
        }
        wheels = sum((momentum for part in built.values() for momentum in part.wheels), ca.SX(3, 1))
        stored = sum((one.angular for part in built.values() for one in part.stored), ca.SX(3, 1))
        for key, one in own.items():
            if one.sees_wheels:
                seen = replace(self._actuator(body, key, one), wheels=wheels, stored=stored)
                built[key] = one.build(seen)
        self.driven[body.name] = [built[key] for key in own]
        return self.driven[body.name]

    def _at_motors(self, body: SceneBody, columns: Sequence[int], signal: str, value: ca.SX) -> ca.SX:
        """Positions or rates of joints (n x 1) as their motors move, where they have any of their own."""
        motors = {motor.column: motor for part in self._actuators(body) for motor in part.motors}
        found = ca.SX(value)
        for i, motor in ((i, motors[column]) for i, column in enumerate(columns) if column in motors):
            found[i] = found[i] + motor.ahead if signal == "joint_position" else motor.rate
        return found

    def _actuator(self, body: SceneBody, key: str, actuator: Actuator) -> ActuatorContext:
        model = self.plant.model
        columns = {body.joint_name(model, joint): int(model.idx_vs[joint]) for joint in body.free_joints}
        own = actuator.owns(tuple(columns))
        others = {body.joint_name(model, joint) for joint in body.owned}.difference(own)
        others |= {body.joint_name(model, joint) for joint in body.passive}
        first = int(model.idx_vs[body.root_joint])
        return ActuatorContext(
            self.context.at(f"{body.path}.{key}"),
            self.plant,
            self.start,
            robot=body.name,
            path=body.path,
            columns={name: column for name, column in columns.items() if name not in others},
            base_frame=body.root_frame,
            base_columns=tuple(range(first, first + int(model.nvs[body.root_joint])))
            if body.root_joint
            else (),
            break_point=self.break_point or unbroken,
        )

    def _grasp(self, grasp: SceneGrasp) -> GraspContext:
        return GraspContext(
            self.context.at(grasp.path),
            self.plant,
            self.start,
            grasp.name,
            grasp.tip.frame,
            grasp.frame,
            *self._may(grasp.name),
        )

    def _may(self, name: str) -> tuple[ca.SX, ca.SX]:
        """Whether the phase lets a grasp close, and has it let go (1x1 each)."""
        sections, switches = self.scene.scenario.phases, self.context.phases
        closes = [phase.captures is None or name in phase.captures for phase in sections.values()]
        opens = [name in phase.releases for phase in sections.values()]
        may = either(*(switch for switch, closing in zip(switches.values(), closes, strict=True) if closing))
        told = [switch for switch, opening in zip(switches.values(), opens, strict=True) if opening]
        return ca.SX(1) if all(closes) else may, either(*told) if told else ca.SX(0)

    def contact(self, contact: SceneContact) -> ContactContext:
        """Context from which a contact is built."""
        surfaces = {shape: self._surface(shape) for pair in contact.pairs for shape in pair}
        pairs = tuple((surfaces[first], surfaces[second]) for first, second in contact.pairs)
        return ContactContext(self.context.at(contact.path), self.plant, contact.name, pairs)

    def _surface(self, shape: SceneShape) -> ContactSurface:
        """A shape where it is now; a pad's numbers can be varied."""
        rotation, origin = self.plant.placement(shape.frame)
        if shape.path is None:
            measures = shape.config.measures()
            turn, position = sparse(shape.placement[:3, :3]), sparse(shape.placement[:3, 3])
        else:
            context = self.context.at(shape.path)
            measures, position = shape.config.measures(context), context.vector("position")
            angles = context.parameters.sparse_vector(f"{context.path}.rotation_deg") * DEGREE
            turn = context.once("turn", rotation_from_rpy(angles))
        turned, place = ca.mtimes(rotation, turn), origin + ca.mtimes(rotation, position)
        return ContactSurface(Shape(type(shape.config), turned, place, measures), shape.frame, shape.joint)


def _positions(body: SceneBody, free: ca.SX) -> dict[int, ca.SX]:
    """Positions of all joints of a body by id, from those of its free joints (n x 1)."""
    found = dict(zip(body.driven_joints, ca.vertsplit(free), strict=True))
    ties = [tie for tie in body.ties if tie.leader in found]
    return found | {tie.joint: tie.multiplier * found[tie.leader] + tie.offset for tie in ties}


def _is_null(changes: Any, keys: Sequence[str]) -> bool:
    """Whether changes give null for what stands at these keys."""
    for key in keys:
        if not isinstance(changes, dict) or key not in changes:
            return False
        changes = changes[key]
    return changes is None
