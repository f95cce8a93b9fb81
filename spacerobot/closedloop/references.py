"""Desired motions from the references of a tip, each from the instant at which it becomes active."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace

import casadi as ca
import pinocchio as pin

from spacerobot.dynamics import forward_kinematics, frame_velocity
from spacerobot.dynamics.rotations import rotation_exp
from spacerobot.elements import (
    Contribution,
    DesiredMotion,
    Event,
    InitialMotion,
    SectionContext,
    StartInstant,
    State,
    either,
    memory,
)
from spacerobot.elements.core.context import ReferenceContext
from spacerobot.elements.sensors.measurement import Measurement, Observation, changing, filled
from spacerobot.scene import SceneBody, SceneReference, SceneTip
from spacerobot.symbolic import InitialState, Plant


@dataclass(frozen=True)
class TipGuidance:
    """Tip with its references.

    Attributes:
        tip: The tip.
        context, plant, start: Time and the scenario's numbers, mechanics at present and at the initial state.
        target: The target, None if there is no target.
        reading_of: Function from signal and value (3x1) to the reading of the robot's sensor; None without
            sensors.
        measure: Function from signal, name and observation to the sampled measurement; None for a continuous
            sensor.
        is_exact: Function that returns whether the sensor of a signal always shows the true signal.
        estimators: Contribution of the robot's estimators.
        initial: States that store the instant, pose and motion with which the present reference began, by
            a short name.
        stored: Further states by name, with their expressions at that instant.
        held: Last measurements of sensors, by the state's name.
        samples: The same measurements, and readings of continuous sensors with errors, as vectors (3x1), by
            signal and path of the reference.
    """

    tip: SceneTip
    context: SectionContext
    plant: Plant
    start: InitialState
    target: SceneBody | None
    reading_of: Callable[[str, ca.SX], ca.SX | None]
    measure: Callable[[str, str, Observation], Measurement | None]
    is_exact: Callable[[str], bool]
    estimators: Contribution = field(default_factory=Contribution)
    initial: dict[str, State] = field(default_factory=dict)
    stored: dict[str, tuple[State, ca.SX]] = field(default_factory=dict)
    held: dict[str, Measurement] = field(default_factory=dict)
    samples: dict[tuple[str, str], ca.SX] = field(default_factory=dict)

    @property
    def root(self) -> int | None:
        """Frame of the target, None if there is no target."""
        return None if self.target is None else self.target.root_frame

    @functools.cached_property
    def motion(self) -> DesiredMotion:
        """Desired motion at the current time, by the active reference."""
        desired, *others = self.motions
        for motion, since in zip(others, self.sinces[1:], strict=True):
            parts = {
                part.name: ca.if_else(since.active, getattr(motion, part.name), getattr(desired, part.name))
                for part in fields(DesiredMotion)
            }
            desired = DesiredMotion(**parts)
        return desired

    @functools.cached_property
    def motions(self) -> tuple[DesiredMotion, ...]:
        """Desired motion by each reference."""
        if not self.context.phases:
            return (self._from_start(self.tip.references[0]),)
        return tuple(
            self._since(reference, since)
            for reference, since in zip(self.tip.references, self.sinces, strict=True)
        )

    @functools.cached_property
    def sinces(self) -> tuple[StartInstant, ...]:
        """Start instant of each reference."""
        switches = self.context.phases
        return tuple(
            StartInstant(self.tip.label, either(*(switches[name] for name in reference.phases)))
            for reference in self.tip.references
        )

    def _from_start(self, reference: SceneReference) -> DesiredMotion:
        """Motion by a reference that is active from the start, so that its initial values are known."""
        pivot = None
        if reference.from_target and self.root is not None:
            pivot = self.start.placement(self.root)[1]
        beginning = InitialMotion(*self.start.placement(self.tip.frame), self._first_twist, self._at_start)
        return reference.config.motion(self._context(self.context.at(reference.path)), beginning, pivot)

    def _context(self, context: SectionContext) -> ReferenceContext:
        """Context of a reference: plant, tip, target and sensors."""
        target, model = self.target, self.plant.model
        links = {} if target is None else {link.name: link for link in target.description.links}
        frames = {name: int(model.getFrameId(f"target/{name}", pin.FrameType.BODY)) for name in links}
        return ReferenceContext(
            **{part.name: getattr(context, part.name) for part in fields(SectionContext)},
            plant=self.plant,
            tip=self.tip.frame,
            links=frames,
            target=() if target is None or not target.root_joint else target.subtree,
            reading_of=self.reading_of,
            estimates=dict(self.estimators.estimates),
            held=functools.partial(self._measured_last, context.path),
        )

    def _measured_last(self, path: str, signal: str, reading: ca.SX, origin: ca.SX | None = None) -> ca.SX:
        """Reading of a sensor, or its last sample if it is held; constant entries stay constant."""
        name = f"{self.tip.label}.{path}.{signal}"
        if name not in self.held:
            frame = self.plant.placement(self.tip.frame)[1]
            away = None
            if self.root is not None:
                away = ca.norm_2(ca.densify(self.plant.placement(self.root)[1] - frame))
            origin = None if origin is None else changing(reading, origin)
            measurement = self.measure(signal, name, Observation(changing(reading), away, origin=origin))
            if measurement is None:
                if not self.is_exact(signal):
                    self.samples[signal, path] = reading
                return reading
            self.held[name] = measurement
        self.samples[signal, path] = filled(reading, self.held[name].known)
        return self.samples[signal, path]

    @property
    def measured(self) -> Mapping[str, ca.SX]:
        """Measured signals (3x1 each) by name, those of the active reference where it reads the signal."""
        result: dict[str, ca.SX] = {}
        for i, reference in enumerate(self.tip.references):
            for (signal, path), value in self.samples.items():
                if path == reference.path:
                    earlier = result.get(signal)
                    result[signal] = (
                        value if earlier is None else ca.if_else(self.sinces[i].active, value, earlier)
                    )
        return result

    def _at_start(self, name: str, value: ca.SX) -> ca.SX:
        """Expression at the initial state, at which every sensor measures."""
        del name
        for held in self.held.values():
            value = ca.substitute(value, held.value.symbol, held.reading)
        value = self._first_estimates(value)
        return self.plant.at_start(value, self.start, self.context.constants)

    def _first_estimates(self, value: ca.SX) -> ca.SX:
        """Expression with the filters' states at their initial values."""
        for state in self.estimators.states:
            value = ca.substitute(value, state.symbol, state.initial)
        return value

    def _remembered(self, path: str, name: str, value: ca.SX) -> ca.SX:
        """Expression of the state at the start of the present reference; constant entries stay constant."""
        label = f"{self.tip.label}.begun.{path}.{name}"
        if label not in self.stored:
            entries = changing(value)
            # states of a filter, which are not memory states, would count as zero in initial values
            self.stored[label] = memory(label, self._first_estimates(entries)), entries
        return filled(value, self.stored[label][0].symbol)

    def _first_twist(self) -> tuple[ca.SX, ca.SX]:
        """Velocity and spin of the tip at the start (3x1 each)."""
        start = self.start
        moving = forward_kinematics(start.model, start.q, start.v)
        return frame_velocity(start.model, moving, self.tip.frame)

    def _since(self, reference: SceneReference, since: StartInstant) -> DesiredMotion:
        """Motion by a reference that becomes active at the start of a phase, which events determine."""
        time = self.context.time - self._symbol("since")
        context = replace(self.context.at(reference.path), time=time, since=since)
        pivot = self._vector("pivot") if reference.from_target and self.root is not None else None
        if self.plant.planar:
            rotation = ca.mtimes(rotation_exp(self._vector("rotation")), self._first_rotation)
        else:
            rotation = ca.reshape(self._symbol("rotation"), 3, 3)
        beginning = InitialMotion(
            rotation,
            self._vector("origin"),
            lambda: (self._vector("velocity"), self._vector("spin")),
            functools.partial(self._remembered, reference.path),
        )
        return reference.config.motion(self._context(context), beginning, pivot)

    @functools.cached_property
    def _first_rotation(self) -> ca.SX:
        return self.context.at(self.tip.path).once("start", self.start.placement(self.tip.frame)[0])

    def _symbol(self, key: str) -> ca.SX:
        """Symbol of the memory state of an initial value; only of those components that can change."""
        if key not in self.initial:
            first = ca.SX.zeros(1) if key == "since" else self._values(None)[key][self._axes(key)]
            self.initial[key] = memory(f"{self.tip.label}.begun.{key}", first)
        return self.initial[key].symbol

    def _vector(self, key: str) -> ca.SX:
        """Stored vector (3x1)."""
        vector, frame = ca.SX(3, 1), {"origin": self.tip.frame, "pivot": self.root}.get(key)
        vector[self._axes(key)] = self._symbol(key)
        if self.plant.planar and frame is not None:
            height = self.start.placement(frame)[1][2]
            vector[2] = self.context.at(self.tip.path).once(f"height.{key}", height)
        return vector

    def _axes(self, key: str) -> list[int]:
        """Components of a stored vector."""
        if key == "since":
            return [0]
        if key == "rotation" and not self.plant.planar:
            return list(range(9))
        return list(self.plant.rotation_axes if key in ("rotation", "spin") else self.plant.translation_axes)

    def _values(self, led: DesiredMotion | None) -> Mapping[str, ca.SX]:
        """Initial values of a reference that becomes active.

        Args:
            led: Desired motion of the preceding reference, from which the new one continues; None starts from
                the tip's own motion.
        """
        plant, frame = self.plant, self.tip.frame
        rotation, origin = plant.placement(frame)
        velocity, spin = plant.velocity(frame)
        pivot = origin if self.root is None else plant.placement(self.root)[1]
        if led is not None:
            pivot = led.position + ca.mtimes(ca.mtimes(led.rotation, rotation.T), pivot - origin)
            rotation, origin, velocity, spin = led.rotation, led.position, led.velocity, led.angular_velocity
        turned = plant.orientation_error(rotation, self._first_rotation) if plant.planar else ca.vec(rotation)
        return {
            "since": self.context.time,
            "rotation": turned,
            "origin": origin,
            "pivot": pivot,
            "velocity": velocity,
            "spin": spin,
        }

    def index(self, phase: str) -> int:
        """Index of the reference that is active in a phase."""
        return next(i for i, reference in enumerate(self.tip.references) if phase in reference.phases)

    def begin(self, ended: str, begins: str, *, at_pose: bool) -> tuple[dict[str, bool], dict[str, ca.SX]]:
        """Switches and states that the reference of a new phase sets; none if the reference continues."""
        before, after = self.index(ended), self.index(begins)
        if before == after:
            return {}, {}
        values = self._values(None if at_pose else self.motions[before])
        updates = {
            state.name: ca.densify(values[key][self._axes(key)]) for key, state in self.initial.items()
        }
        updates |= {state.name: value for state, value in self.stored.values()}
        return dict.fromkeys(self.sinces[after].jumps, False), updates

    @property
    def states(self) -> tuple[State, ...]:
        """States of the references and of held measurements."""
        held = (state for one in self.held.values() for state in one.states)
        return (*self.initial.values(), *(state for state, _ in self.stored.values()), *held)

    @property
    def events(self) -> tuple[Event, ...]:
        """Instants at which a reference jumps, or a sensor measures."""
        jumps = (event for since in self.sinces for event in (*since.jumps.values(), *since.knots))
        return (*jumps, *(event for one in self.held.values() for event in one.events))
