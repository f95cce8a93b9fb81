"""Phases of a closed loop: end conditions, successors, and effects of a phase change."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
import numpy as np

from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.elements import Contribution, Event, Output, SectionContext, both, negated
from spacerobot.scenario.phases import END, Limit, Phase, Settled, successors

DEGREE = np.pi / 180
Condition = tuple[str, ca.SX, ca.SX]
"""End condition of a phase: name, guard, and whether it is armed (1x1 each)."""


def phased(builder: LoopBuilder, outputs: Sequence[Output]) -> Contribution:
    """Contribution of the phases to the closed loop; without phases that of the references alone.

    Args:
        builder: Builder of all other elements, which are complete.
        outputs: Outputs of all other elements.

    Raises:
        ScenarioError: If a phase ends by an unknown output.
    """
    if not builder.context.phases:
        leads = builder.leads.values()
        return Contribution(
            states=tuple(state for lead in leads for state in lead.states),
            events=tuple(event for lead in leads for event in lead.events),
        )
    return _Phases(builder, outputs).contribution()


@dataclass(frozen=True)
class _Phases:
    """The phases of one closed loop."""

    builder: LoopBuilder
    outputs: Sequence[Output]

    @property
    def context(self) -> SectionContext:
        """Time and the scenario's numbers."""
        return self.builder.context

    @property
    def phases(self) -> Mapping[str, Phase]:
        """The sections."""
        return self.builder.scene.scenario.phases

    def contribution(self) -> Contribution:
        """Memory, events, and the number of the phase."""
        events = [event for name in self.phases for event in self._events(name)]
        leads = self.builder.leads.values()
        number = sum((i * switch for i, switch in enumerate(self.context.phases.values())), ca.SX(0))
        names = ", ".join(f"{i} {name}" for i, name in enumerate(self.phases))
        states = [*self.builder.phase_states.values(), *(state for lead in leads for state in lead.states)]
        return Contribution(
            states=tuple(states),
            events=(*events, *(event for lead in leads for event in lead.events)),
            outputs=(Output("phase", number, "1", f"phase: {names}", plotted=False),),
        )

    def _events(self, name: str) -> Iterator[Event]:
        """Events that end a phase, and those that mark the start and end of settling."""
        phase, (following, on_timeout) = self.phases[name], successors(self.phases)[name]
        if phase.until is not None and phase.until.settled is not None and phase.until.settled.dwell:
            # a body starts and stops moving slowly enough
            settled = phase.until.settled
            room, switch = self._room(name, settled), self._settling_switch(name)
            active = self.context.phases[name]
            turned, waiting = switch.name(), both(active, negated(switch))
            updates = {self.builder.memory("settled_at").name: self.context.time}
            yield Event(f"{name}.settling", "settling", settled.of, room, waiting, {turned: True}, updates)
            moves = both(active, switch)
            yield Event(f"{name}.moving", "moving", settled.of, -room, moves, {turned: False})
        for how, guard, armed in self._conditions(name, phase):
            follows = {"timeout": on_timeout, "abort": phase.on_abort or END}.get(how, following)
            yield self._ended(f"{name}.{how}", name, follows, guard, armed)

    def _conditions(self, name: str, phase: Phase) -> Iterator[Condition]:
        """Ways in which a phase ends, apart from being the phase."""
        context, until, always = self.context.at(f"phases.{name}"), phase.until, ca.SX(1)
        if until is not None and until.time is not None:
            yield "time", self.builder.phase_time() - context.number("until.time"), always
        elif until is not None and until.settled is not None:
            yield "settled", *self._settled(name, until.settled)
        elif until is not None and until.limit is not None:
            yield "limit", self._limit(f"{context.path}.until.limit", until.limit), always
        elif until is not None:
            names, switch = until.captured or until.released or (), self.builder.grasp_switch
            kind: Literal["closed", "released"] = "closed" if until.captured else "released"
            armed = both(*(switch(grasp, kind) for grasp in names))
            yield "captured" if until.captured else "released", always, armed
        if phase.abort is not None:
            yield "abort", self._limit(context.path + ".abort", phase.abort), always
        if phase.timeout is not None:
            yield "timeout", self.builder.phase_time() - context.number("timeout"), always

    def _room(self, name: str, settled: Settled) -> ca.SX:
        """Settling margin of a body (1x1), above zero while its speed and spin are below the limits."""
        plant, context = self.builder.plant, self.context.at(f"phases.{name}.until.settled")
        velocity, spin = plant.velocity(self.builder.scene.body(settled.of).root_frame)
        room = 1 - ca.dot(velocity, velocity) / context.number("speed") ** 2
        if settled.spin_deg is None:
            return room
        return ca.fmin(room, 1 - ca.dot(spin, spin) / (context.number("spin_deg") * DEGREE) ** 2)

    def _settling_switch(self, name: str) -> ca.SX:
        return self.context.at(f"phases.{name}").switch("settling")

    def _settled(self, name: str, settled: Settled) -> tuple[ca.SX, ca.SX]:
        """Guard and arming condition of a body that has been settled for the required time."""
        if not settled.dwell:
            return self._room(name, settled), ca.SX(1)
        dwell = self.context.at(f"phases.{name}").number("until.settled.dwell")
        since = self.builder.memory("settled_at").symbol
        return self.context.time - since - dwell, self._settling_switch(name)

    def _limit(self, path: str, limit: Limit) -> ca.SX:
        """Guard (1x1), above zero where an output has passed its upper or lower limit at ``path``."""
        values = {(output.name, output.label): output.value for output in self.outputs}
        key = (limit.output, limit.of or "")
        if key not in values:
            labels = [label for name, label in values if name == limit.output]
            place, unknown = ("of", limit.of or "none") if labels else ("output", limit.output)
            allowed = labels or sorted({name for name, _ in values})
            message = f"found {unknown!r}; {near_names(unknown, [label or 'none' for label in allowed])}"
            raise ScenarioError(message, source=self.builder.scene.source, where=f"{path}.{place}")
        side = "above" if limit.above is not None else "below"
        sign, value = (1 if limit.above is not None else -1), values[key]
        bound = self.context.at(path).number(side)
        if value.numel() == 1:
            return sign * (value - bound)
        return sign * (ca.dot(value, value) - bound * ca.fabs(bound))

    def _ended(self, event: str, name: str, follows: str, guard: ca.SX, armed: ca.SX) -> Event:
        """Event that ends a phase and starts the next one or ends the simulation."""
        armed = both(self.context.phases[name], armed)
        if follows == END:
            return Event(event, "end", name, guard, armed, ends=True)
        sets, updates = {self.context.phases[name].name(): False}, dict[str, ca.SX]()
        if f"phases.{name}.settling" in self.context.constants.switches:
            sets[f"phases.{name}.settling"] = False
        sets[self.context.phases[follows].name()] = True
        phase = self.phases[follows]
        for grasp in phase.captures or ():
            if f"grasps.{grasp}.released" in self.context.constants.switches:
                sets[f"grasps.{grasp}.released"] = False
        updates[self.builder.memory("began_at").name] = self.context.time
        for lead in self.builder.leads.values():
            turned, values = lead.begin(name, follows, at_pose=phase.begins_at == "pose")
            sets |= turned
            updates |= values
        happens = Event(event, "phase", follows, guard, armed, sets, updates)
        return replace(happens, updates=updates | self._anew(updates)) if phase.reset else happens

    def _anew(self, updates: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        """Initial values of the controllers' states at a phase change, from the other states after the event.

        Held outputs of periodic controllers, and their clocks, are not reset.
        """
        states = (state for part in self.builder.controllers for state in part.states)
        controllers = [state for state in states if not state.remembers]
        leads = [state for lead in self.builder.leads.values() for state in lead.states]
        changed = [state for state in leads if state.name in updates]
        old = ca.vertcat(*(state.symbol for state in (*controllers, *changed)))
        zeros = [ca.SX.zeros(state.symbol.size1()) for state in controllers]
        new = ca.vertcat(*zeros, *(updates[state.name] for state in changed))
        return {state.name: ca.substitute(state.initial, old, new) for state in controllers}
