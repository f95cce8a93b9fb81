"""Lifecycle of a grasp: open, inside its capture envelope, captured, released; common to all kinds."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from spacerobot.dynamics.rotations import rotation_from_rpy
from spacerobot.elements.core.context import GraspContext
from spacerobot.elements.core.contribution import (
    AccelerationConstraint,
    Contribution,
    Output,
    State,
    gated,
    memory,
)
from spacerobot.elements.core.desired_motion import STILL, TimeProfile, along
from spacerobot.elements.core.event import Event, both, either, negated
from spacerobot.elements.core.failure import failing
from spacerobot.elements.core.grasp_state import GraspState
from spacerobot.elements.grasps.capture import Capture
from spacerobot.elements.grasps.grasp import OBSERVED, Grasp, apart, only

DEGREE = np.pi / 180
TINY = 1e-12
"""Lower bound of the squared draw-in distance [m^2, rad^2], which keeps the draw-in time above zero."""
STATES = "0 open, 1 in its envelope, 2 captured, 3 released"


def grasp_lifecycle(config: Grasp, grasp: GraspContext) -> Contribution:
    """Contribution of a grasp to the closed loop, whether it is always closed or not."""
    if config.begins == "closed" and config.release is None and grasp.lets_go.is_zero():
        return config.build(grasp)
    return _GraspLifecycle(config, grasp).contribution()


@dataclass(frozen=True)
class _GraspLifecycle:
    """Switches and stored states of a grasp that opens or closes, and the law built on them."""

    config: Grasp
    grasp: GraspContext

    def contribution(self) -> Contribution:
        """Contribution of the closed grasp, with the events that close and open it."""
        law = self.config.build(dataclasses.replace(self.grasp, hold=self.hold))
        acting = gated(law, self.closed, [name for name in OBSERVED if name != "grasp_gap"])
        loss = law.energy
        constraints = tuple(self._remembering(constraint, loss) for constraint in acting.constraints)
        return dataclasses.replace(
            acting,
            constraints=constraints,
            states=(*acting.states, *self.memory.values()),
            outputs=(*acting.outputs, *self._outputs()),
            events=(
                *acting.events,
                *self._failing,
                *self._closing(),
                *self._opening(loss),
                *self._slipping(law.outputs, loss),
            ),
        )

    @functools.cached_property
    def closed(self) -> ca.SX:
        """Switch (1x1): nonzero while the grasp is closed."""
        return self.grasp.context.switch("closed", self.config.begins == "closed")

    @functools.cached_property
    def inside(self) -> ca.SX:
        """Switch (1x1): nonzero while the tip is inside the capture envelope and the dwell time elapses."""
        return self.grasp.context.switch("inside")

    @functools.cached_property
    def drawn(self) -> ca.SX:
        """Switch (1x1): nonzero while the tip is drawn in."""
        return self.grasp.context.switch("drawn")

    @functools.cached_property
    def released(self) -> ca.SX:
        """Switch (1x1): nonzero after the release; the grasp then closes again only if a phase allows it."""
        return self.grasp.context.switch("released")

    @functools.cached_property
    def _failing(self) -> tuple[Event, ...]:
        """Event at which its gripper fails, if it does."""
        if self.config.failure is None:
            return ()
        context = self.grasp.context.at(f"{self.grasp.context.path}.failure")
        return (failing(context, self.grasp.name)[1],)

    def _failed(self, mode: str) -> tuple[ca.SX, ...]:
        """Switch (1x1) of a gripper that fails in this way; none of another one."""
        failure = self.config.failure
        fails = failure is not None and failure.mode == mode
        return (self.grasp.context.switch("failure.failed"),) if fails else ()

    @property
    def _moves(self) -> tuple[ca.SX, ...]:
        """Condition (1x1) that it is not jammed, if it may be."""
        return tuple(negated(jammed) for jammed in self._failed("jammed"))

    @property
    def _free(self) -> ca.SX:
        """Whether the grasp may close (1x1)."""
        return both(negated(self.closed), negated(self.released), self.grasp.may_close, *self._moves)

    @functools.cached_property
    def memory(self) -> Mapping[str, State]:
        """States of the grasp, by short names."""
        plant, name = self.grasp.plant, self.grasp.name
        lines, turns, capture = len(plant.translation_axes), len(plant.rotation_axes), self.config.capture
        sizes = {}
        if capture is not None:
            sizes = {"captured_at": 1, "velocity": lines, "spin": turns, "rest_gap": 3, "rest_turn": turns}
            sizes |= {"entered_at": 1} if capture.dwell else {}
            sizes |= {"draw_time": 1} if self._is_drawn else {}
            sizes |= {"missed_at": 1} if self._failed("misses") else {}
        if self.config.is_rigid:
            sizes |= {"impulse": lines, "couple": turns}
        first = {"captured_at": -1.0, "draw_time": 1.0}
        return {
            key: memory(f"{name}.{key}", ca.SX.ones(size) * first.get(key, 0.0))
            for key, size in sizes.items()
        }

    @property
    def _is_drawn(self) -> bool:
        capture = self.config.capture
        return capture is not None and (capture.draw_in is not None or capture.draw_in_deg is not None)

    def _said(self, key: str, axes: tuple[int, ...]) -> ca.SX:
        """Stored vector (3x1) with components along some axes."""
        vector = ca.SX(3, 1)
        vector[list(axes)] = self.memory[key].symbol
        return vector

    @functools.cached_property
    def mated(self) -> ca.SX:
        """Rotation from tip axes to the mating frame's axes at the mated pose (3x3).

        Initial if it starts closed.
        """
        grasp, capture = self.grasp, self.config.capture
        if self.config.begins == "open" and capture is not None:
            angles = (
                grasp.context.parameters.sparse_vector(f"{grasp.context.path}.capture.mated_deg") * DEGREE
            )
            return (
                grasp.context.once("capture.mated", rotation_from_rpy(angles))
                if angles.nnz()
                else ca.SX.eye(3)
            )
        start = grasp.start
        tip, mate = start.placement(grasp.tip_frame)[0], start.placement(grasp.mate_frame)[0]
        return grasp.context.once("rest", ca.mtimes(mate.T, tip))

    @functools.cached_property
    def hold(self) -> GraspState:
        """Rest pose of the grasp: as captured, or drawn in from there."""
        capture, plant = self.config.capture, self.grasp.plant
        if capture is None:
            return GraspState(self.closed, self.mated, STILL, STILL)
        gap, turn = self.memory["rest_gap"].symbol, self._said("rest_turn", plant.rotation_axes)
        constant = TimeProfile(ca.SX(1), ca.SX(1, 1), ca.SX(1, 1))
        drawing = constant
        if self._is_drawn:
            # from 1 to 0 since the capture, by the cubic blend of Eq. 42; 0 after the draw-in
            time = self.memory["draw_time"].symbol
            fraction = (self.grasp.context.time - self.memory["captured_at"].symbol) / time
            s = ca.fmin(ca.fmax(fraction, 0), 1)
            drawing = TimeProfile(
                self.drawn * (1 - s * s * (3 - 2 * s)),
                -self.drawn * 6 * s * (1 - s) / time,
                -self.drawn * (6 - 12 * s) / time**2,
            )
        return GraspState(
            self.closed,
            self.mated,
            along(gap, constant if capture.draw_in is None else drawing),
            along(turn, constant if capture.draw_in_deg is None else drawing),
        )

    def _remembering(self, constraint: AccelerationConstraint, loss: ca.SX | None) -> AccelerationConstraint:
        """Constraint with stored impulses, whose wrench drives the events of breaking away."""
        plant = self.grasp.plant

        def answer(force: ca.SX, torque: ca.SX) -> Contribution:
            answer_of_law = constraint.answer(force, torque)
            return dataclasses.replace(
                answer_of_law, events=(*answer_of_law.events, *self._slipping(answer_of_law.outputs, loss))
            )

        def struck(force: ca.SX, torque: ca.SX) -> Mapping[str, ca.SX]:
            impulse, couple = self.memory["impulse"], self.memory["couple"]
            return {
                impulse.name: impulse.symbol + force[list(plant.translation_axes)],
                couple.name: couple.symbol + torque[list(plant.rotation_axes)],
            }

        return dataclasses.replace(constraint, answer=answer, struck=struck)

    def _event(self, kind: str, guard: ca.SX, armed: ca.SX, sets: Mapping[str, bool]) -> Event:
        return Event(f"{self.grasp.name}.{kind}", kind, self.grasp.name, guard, armed, sets)

    def _closing(self) -> Iterator[Event]:
        """Events from open to captured and drawn in."""
        capture, time = self.config.capture, self.grasp.context.time
        if capture is None:
            return
        number, sets = self.grasp.context.number, {self.closed.name(): True}
        sets |= {self.drawn.name(): True} if self._is_drawn else {}
        if capture.at is not None:
            yield from self._attempts(time - number("capture.at"), self._free, sets)
        elif not capture.dwell:
            yield from self._attempts(margin(self.grasp, capture, self.mated), self._free, sets)
        else:
            inside, entered_at, room = (
                self.inside,
                self.memory["entered_at"],
                margin(self.grasp, capture, self.mated),
            )
            waiting = both(self._free, negated(inside))
            entered = self._event("entered", room, waiting, {inside.name(): True})
            yield dataclasses.replace(entered, updates={entered_at.name: time})
            yield self._event("left", -room, inside, {inside.name(): False})
            since_dwell = time - entered_at.symbol - number("capture.dwell")
            yield from self._attempts(since_dwell, both(self._free, inside), sets | {inside.name(): False})
        if self._is_drawn:
            since_dwell = time - self.memory["captured_at"].symbol - self.memory["draw_time"].symbol
            yield self._event("drawn", since_dwell, both(self.closed, self.drawn), {self.drawn.name(): False})

    def _attempts(self, guard: ca.SX, armed: ca.SX, sets: Mapping[str, bool]) -> Iterator[Event]:
        """Event of the capture, preceded by that of a failed attempt if the grasp may fail."""
        for failed in self._failed("misses"):
            context, missed = self.grasp.context, self.grasp.context.switch("missed")
            updates = {self.memory["missed_at"].name: context.time}
            first = both(armed, failed, negated(missed))
            attempt = self._event("missed", guard, first, {missed.name(): True})
            yield dataclasses.replace(attempt, updates=updates)
            since_retry = context.time - self.memory["missed_at"].symbol - context.number("failure.retry")
            guard = ca.fmin(guard, ca.if_else(missed, since_retry, guard))
            armed = both(armed, either(negated(failed), missed))
        # the capture event and the states that it stores
        plant, context, capture = self.grasp.plant, self.grasp.context, self.config.capture
        gap, velocity, spin = apart(self.grasp)
        rotation, turn = plant.placement(self.grasp.mate_frame)[0], misalignment(self.grasp, self.mated)
        lines, turns = list(plant.translation_axes), list(plant.rotation_axes)
        values = {
            "captured_at": context.time,
            "velocity": velocity[lines],
            "spin": spin[turns],
            "rest_gap": ca.mtimes(rotation.T, gap),
            "rest_turn": (turn if plant.planar else ca.mtimes(rotation.T, turn))[turns],
        }
        times = ca.SX(0)
        for key, factor, way in (("draw_in", 1.0, gap[lines]), ("draw_in_deg", DEGREE, turn[turns])):
            if getattr(capture, key) is not None:
                rate = context.number(f"capture.{key}") * factor
                times = ca.fmax(times, 1.5 * ca.sqrt(ca.dot(way, way) + TINY) / rate)
        values |= {"draw_time": times} if self._is_drawn else {}
        updates = {self.memory[key].name: ca.densify(value) for key, value in values.items()}
        capture_event = self._event("captured", guard, armed, sets)
        yield dataclasses.replace(capture_event, updates=updates, impact=self.config.is_rigid)

    def _opened(self, kind: str, guard: ca.SX, armed: ca.SX, loss: ca.SX | None) -> Event:
        """Event that opens the grasp; the energy of its springs is lost."""
        # a draw-in stops at its present value: the loss is the energy of the springs about that rest pose
        sets = {self.closed.name(): False, self.released.name(): True}
        return dataclasses.replace(self._event(kind, guard, both(armed, self.closed), sets), loss=loss)

    def _opening(self, loss: ca.SX | None) -> Iterator[Event]:
        """Events that release the grasp."""
        context, release, lets_go = self.grasp.context, self.config.release, self.grasp.lets_go
        if release is not None and release.at is not None:
            yield self._opened(
                "released", context.time - context.number("release.at"), both(*self._moves), loss
            )
        if not lets_go.is_zero():
            command_event = self._opened("released", ca.SX(1), both(lets_go, *self._moves), loss)
            yield dataclasses.replace(command_event, name=f"{self.grasp.name}.release_commanded")

    def _slipping(self, outputs: Iterable[Output], loss: ca.SX | None) -> Iterator[Event]:
        """Events at which the grasp breaks away, by the outputs of its force and torque."""
        release, values = self.config.release, {output.name: output.value for output in outputs}
        for key in ("force", "torque"):
            load = values.get(f"grasp_{key}")
            if release is not None and getattr(release, key) is not None and load is not None:
                strength = self.grasp.context.number(f"release.{key}")
                for weak in self._failed("weak"):
                    strength = strength * (1 - weak * (1 - self.grasp.context.number("failure.remaining")))
                slipped = self._opened("slipped", ca.dot(load, load) / strength**2 - 1, ca.SX(1), loss)
                yield dataclasses.replace(slipped, name=f"{self.grasp.name}.slipped_by_{key}")

    def _outputs(self) -> Iterator[Output]:
        """Outputs: state of the grasp, and stored values of its capture."""
        plant, states = self.grasp.plant, self.memory
        of_grasp = functools.partial(Output, dimension="grasp", label=self.grasp.name, plotted=False)
        state = 2 * self.closed + 3 * self.released + (self.inside if "entered_at" in states else 0)
        yield of_grasp("grasp_state", state, "1", f"state of grasps: {STATES}")
        rotation_vector = misalignment(self.grasp, self.mated)
        text = "rotation vector from where mated to tips"
        yield of_grasp("grasp_misalignment", rotation_vector, "rad", text, plotted=True)
        if "captured_at" in states:
            when = "time of the last capture, -1 before the first"
            yield of_grasp("grasp_captured_at", states["captured_at"].symbol, "s", when)
        if "rest_gap" in states:
            text = "from mating frames to tips at the capture, axes of the mating frame"
            yield of_grasp("grasp_capture_gap", states["rest_gap"].symbol, "m", text, plotted=True)
        outputs = {
            "velocity": (
                "grasp_capture_velocity",
                "m/s",
                "velocity of tips relative to the target at the capture",
            ),
            "spin": ("grasp_capture_spin", "rad/s", "spin of tips relative to the target at the capture"),
            "impulse": ("grasp_impulse", "N s", "impulses of grasps on the target"),
            "couple": (
                "grasp_impulse_couple",
                "N m s",
                "impulsive couples of grasps on the target, at the tip",
            ),
        }
        for key, (name, unit, text) in outputs.items():
            if key in states:
                axes = plant.translation_axes if key in ("velocity", "impulse") else plant.rotation_axes
                yield of_grasp(name, self._said(key, axes), unit, text)


def misalignment(grasp: GraspContext, mated: ca.SX) -> ca.SX:
    """Rotation vector (3x1) [rad], world axes, from the mated orientation (3x3, mate axes) to the tip's."""
    plant = grasp.plant
    mated_rotation = ca.mtimes(plant.placement(grasp.mate_frame)[0], mated)
    return plant.orientation_error(plant.placement(grasp.tip_frame)[0], mated_rotation)


def margin(grasp: GraspContext, capture: Capture, mated: ca.SX) -> ca.SX:
    """Margin in the capture envelope (1x1), above zero inside: the minimum of 1 - (value / limit)^2."""
    plant, number = grasp.plant, grasp.context.number
    gap, velocity, spin = apart(grasp)
    gap, velocity = only(gap, plant.translation_axes), only(velocity, plant.translation_axes)
    axis_numbers = grasp.context.parameters.sparse_vector(f"{grasp.context.path}.capture.axis")
    unit = grasp.context.once("capture.axis", axis_numbers / ca.norm_2(ca.densify(axis_numbers)))
    axis = ca.mtimes(plant.placement(grasp.mate_frame)[0], unit)
    closing = ca.dot(axis, velocity)
    turn = misalignment(grasp, mated)
    squares = {
        "distance": ca.dot(gap, gap),
        "misalignment_deg": ca.dot(turn, turn) / DEGREE**2,
        "closing_speed": closing**2,
        "lateral_speed": ca.dot(velocity, velocity) - closing**2,
        "spin_deg": ca.dot(only(spin, plant.rotation_axes), spin) / DEGREE**2,
    }
    rooms = [1 - squares[name] / number(f"capture.{name}") ** 2 for name in capture.limits]
    return functools.reduce(ca.fmin, rooms)
