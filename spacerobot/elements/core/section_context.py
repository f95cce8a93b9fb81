"""Time and the numbers of a section, for building its law."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca

from spacerobot.common.errors import ScenarioError
from spacerobot.elements.core.event import Event, both, either, negated
from spacerobot.symbolic import Constants, Parameters
from spacerobot.symbolic.noise import DRAW, SEED


@dataclass(frozen=True)
class StartInstant:
    """Instant, set by events, from which a law counts its time.

    Attributes:
        owner: Name of the element that owns this time.
        active: Whether the law is active (1x1).
        jumps: Events at which the law jumps, by the name of the switch that each turns on.
        knots: Events without a switch, between two pieces of the law.
    """

    owner: str
    active: ca.SX
    jumps: dict[str, Event] = field(default_factory=dict)
    knots: list[Event] = field(default_factory=list)


@dataclass(frozen=True)
class SectionContext:
    """Time and the numbers of one section.

    Attributes:
        path: Dotted path of the section.
        time: Time (1x1) [s] since the law became active.
        parameters, constants: Numbers of the scenario, and values computed from them once per rollout.
        phases: Switch (1x1) of each phase, by name; empty if there is only one phase.
        since: Origin of time; None for the start of the simulation.
        words: Text values that differ from the scenario's in a phase, by dotted path with prefix
            ``phases.NAME.``.
    """

    path: str
    time: ca.SX
    parameters: Parameters
    constants: Constants
    phases: Mapping[str, ca.SX] = field(default_factory=dict)
    since: StartInstant | None = None
    words: Mapping[str, str] = field(default_factory=dict)

    def at(self, path: str) -> SectionContext:
        """Context of another section."""
        return dataclasses.replace(self, path=path)

    def number(self, key: str) -> ca.SX:
        """Number of the section (1x1), in the section's unit, in the present phase."""
        value = self.once(key, self.parameters(f"{self.path}.{key}"))
        for name, active in self.phases.items():
            phase_path = f"phases.{name}.{self.path}.{key}"
            if phase_path in self.parameters:
                value = ca.if_else(
                    active, self.constants.hoist(phase_path, self.parameters(phase_path)), value
                )
        return value

    def random(self, sensor: str, rows: int, width: int, row: ca.SX) -> ca.SX:
        """Standard normal numbers of a sensor's sample.

        Args:
            sensor: Name of the sensor, which chooses the stream of numbers.
            rows, width: Number of samples, and of numbers in each.
            row: Index of the sample (1x1), which only events change; limited to the last one.

        Returns:
            casadi.SX: Numbers of the sample (width x 1).
        """
        _ = self.parameters(SEED), self.parameters(DRAW)  # a rollout draws by them
        cursor = self.constants.cursor(f"{sensor}.sample", ca.fmin(row, rows - 1))
        return self.constants.random(sensor, rows, width, cursor)

    def steady(self, key: str) -> ca.SX:
        """A number of the section (1x1) that no phase may change.

        Raises:
            ScenarioError: If one does.
        """
        for name in self.phases:
            phase_path = f"phases.{name}.{self.path}.{key}"
            if phase_path in self.parameters:
                raise ScenarioError(
                    "found a number, allowed: none; phases do not change it", where=phase_path
                )
        return self.number(key)

    def chosen(self, key: str, word: str) -> dict[str, ca.SX]:
        """Text values at a key of the section, each with whether it applies in the present phase (1x1).

        Args:
            key: Key of the section.
            word: Text value of the scenario, the only one if no phase overrides it.
        """
        activity: dict[str, list[ca.SX]] = {}
        for name, active in self.phases.items():
            word_of_phase = self.words.get(f"phases.{name}.{self.path}.{key}", word)
            activity.setdefault(word_of_phase, []).append(active)
        return {word_of_phase: either(*active) for word_of_phase, active in activity.items()} or {
            word: ca.SX(1)
        }

    def is_zero(self, key: str) -> bool:
        """Whether a number of the section is always exactly zero: not varied, not overridden by a phase."""
        path, parameters = f"{self.path}.{key}", self.parameters
        phases = (f"phases.{name}.{path}" in parameters for name in self.phases)
        return parameters.value(path) == 0 and not parameters.varies(path) and not any(phases)

    def vector(self, key: str, factor: float = 1.0) -> ca.SX:
        """Three numbers of the section times a factor (3x1); exact zeros are structural.

        Args:
            key: Key of the numbers.
            factor: Factor, for example of a conversion of units.
        """
        value = self.parameters.sparse_vector(f"{self.path}.{key}")
        return self.once(key, value * factor if factor != 1.0 else value)

    def once(self, name: str, expression: ca.SX) -> ca.SX:
        """Evaluate an expression once for each rollout.

        Args:
            name: Name of the constant, unique in the section.
            expression: Expression of the parameters only; any shape.

        Returns:
            casadi.SX: Symbol or constant of the same shape.
        """
        return self.constants.hoist(f"{self.path}.{name}", expression)

    def begun(self, name: str, expression: ca.SX) -> ca.SX:
        """Value of an expression at the instant at which the law becomes active.

        Args:
            name: Name of the constant, unique in the section.
            expression: Expression of the initial state of the law; any shape.
        """
        if self.since is not None:
            return expression
        return self.once(name, self.constants.expanded(expression))

    def jump(self, key: str, time: float | ca.SX | None = None) -> ca.SX:
        """Time (1x1) [s] of a jump of the law, only to be compared with the law's time.

        Integration steps end there.

        Args:
            key: Key of the time in the section, or a name if ``time`` is given.
            time: Time [s] if it is not a number of the section: an expression of the parameters and of the
                law's initial state.
        """
        name = f"{self.path}.{key}"
        at = self.parameters(name) if time is None else ca.SX(time)
        if self.since is None:
            return self.constants.jump(name, self.constants.expanded(at))
        jump_passed = self.constants.switch(f"{self.since.owner}:{name}.passed")
        if jump_passed.name() not in self.since.jumps:
            overrun = self.time - (at if isinstance(time, ca.SX) else self.constants.hoist(name, at))
            armed = both(self.since.active, negated(jump_passed))
            jump = Event(
                jump_passed.name(), "reference", self.since.owner, overrun, armed, {jump_passed.name(): True}
            )
            self.since.jumps[jump_passed.name()] = jump
        return ca.if_else(jump_passed, -ca.inf, ca.inf)

    def switch(self, name: str, initial: bool = False) -> ca.SX:
        """Switch of the section (1x1): 1 or 0, changed by events only.

        Args:
            name: Name of the switch; its symbol is named ``path.name``.
            initial: Whether it is on at the start.
        """
        return self.constants.switch(f"{self.path}.{name}", initial)
