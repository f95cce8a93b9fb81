"""Extraction of the onboard software of a scene from its closed loop.

The periodic controllers, estimators and detections of the closed loop are events: at the instants of a clock,
or where a guard rises, they perform an update ``z+ = F(t, x, c)``. Their states z become fields of a C
struct, the scenario's numbers c become constants, and the rest of the state x becomes inputs: samples of
sensors with ``errors``, and true values for ideal sensors or for laws that use the model. A true value that
does not influence a task after its first call, such as the initial attitude of a filter, is fixed at its
initial value.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.closedloop import ClosedLoop
from spacerobot.closedloop.build import EvaluatedLoop, builder_of, evaluate
from spacerobot.closedloop.onboard_ports import OnboardLoopBuilder
from spacerobot.common.arrays import Array
from spacerobot.elements import Event, State
from spacerobot.elements.core.clock import EARLY, ONCE
from spacerobot.flightcode.c_text import FUNCTIONS, MEMBERS, PROGRAMS, identifier
from spacerobot.flightcode.field_names import (
    EVENT_TEXTS,
    PLANT_STATES,
    SampleNames,
    column_names,
    true_motion,
)
from spacerobot.flightcode.flyable import controllers, plans
from spacerobot.flightcode.onboard import Field, OnboardSoftware, Role, Task, common_tick
from spacerobot.scenario import Robot
from spacerobot.scene import Scene, SceneBody

LONGEST = 0.01
"""Maximum step [s] for the integration of states that change between instants."""

COINCIDENT = 1e-9
"""Delay [s] after which a reference's jump is seen: at the same instant, laws come first, as in rollouts."""

TRIALS = 24
"""Number of random points at which an input is tested for influence."""

INFLUENCE = 1e-10
"""Relative change of a task's results below which an input has no influence."""


def onboard_software(scene: Scene, loop: ClosedLoop) -> OnboardSoftware:
    """Onboard software of a scene.

    Plans that are made in flight are inputs: the software tracks them.

    Args:
        scene: The scene, as :func:`~spacerobot.flightcode.flyable.prepared_scene` returns it.
        loop: Its closed loop, of :class:`OnboardLoopBuilder`.

    Raises:
        ScenarioError: If a controller is continuous, nothing is periodic, or periods have no common divisor.
    """
    for path, controller in controllers(scene):
        if controller.sampled is None:
            raise scene.error(
                "found a continuous controller, which reads the state at all times; allowed for flight code: "
                "one with `sampled: {period: ...}`",
                path,
            )
    builder = builder_of(OnboardLoopBuilder, scene)
    extraction = _Extraction(scene, loop, builder, evaluate(builder), plans(scene))
    try:
        return extraction.software()
    except ValueError as error:
        raise scene.error(f"periods: {error}", "robots") from None


@dataclass(frozen=True)
class _Draft:
    """Task before extraction: expressions (n x 1 each) of any symbol; new values are named as the states."""

    name: str
    path: str
    text: str
    values: Mapping[str, ca.SX]
    period: float = 0.0
    offset: float = 0.0
    continual: bool = False


@dataclass
class _Extraction:
    """Symbols and data fields of one closed loop, from which the functions of its flight code are built."""

    scene: Scene
    loop: ClosedLoop
    builder: OnboardLoopBuilder
    evaluated: EvaluatedLoop
    plans: dict[str, Sequence[str]]
    pools: dict[str, Field] = field(default_factory=dict)
    symbols: dict[int, Field] = field(default_factory=dict)

    @functools.cached_property
    def states(self) -> dict[str, State]:
        """All states after (q, v), by name."""
        return {state.name: state for state in self.evaluated.acting.states}

    @functools.cached_property
    def start(self) -> tuple[Array, Array]:
        """Initial state x (nx,) and constants c (nc,)."""
        x0, c = (value.full().ravel() for value in self.loop.setup(self.loop.parameter_values))
        return x0, c

    @functools.cached_property
    def _builder_names(self) -> tuple[set[str], set[str]]:
        """Names of the states and of the events that controllers, estimators and references make."""
        builder = self.builder
        parts = [*builder.controllers, *builder.estimators.values()]
        states = {state.name for part in parts for state in part.states}
        events = {event.name for part in parts for event in part.events}
        for lead in builder.leads.values():
            states |= {state.name for state in lead.states}
            events |= {event.name for event in lead.events}
        return states, events

    @functools.cached_property
    def _actuator_events(self) -> tuple[list[Event], dict[str, str]]:
        """Events of actuators that onboard software performs, and the reasons why others stay in the plant.

        Software can integrate its own commands and test samples. A momentum residual that integrates the
        motion between two instants, or that is tested continuously, is a law in continuous time and stays in
        the plant.
        """
        events = [event for event in self.evaluated.acting.events if event.onboard]
        events = [event for event in events if event.name not in self._builder_names[1]]
        ports = self.builder.continuous_ports
        reasons = {f"allocation of {name}": _reason(moving) for name, moving in ports.items()}
        while True:
            software_states = self._states_of(events)
            moving = {event.name: self._moving(event, software_states) for event in events}
            staying = {name: names for name, names in moving.items() if names}
            if not staying:
                return events, reasons
            reasons |= {name: _reason(names) for name, names in staying.items()}
            events = [event for event in events if event.name not in staying]

    def _states_of(self, events: Sequence[Event]) -> set[str]:
        """Names of the software's states if it performs these events of actuators."""
        written_states = {name for event in events for name in event.updates if name in self.states}
        phases = {state.name for state in self.builder.phase_states.values()}
        return self._builder_names[0] | phases | written_states | set(self._ports)

    def _moving(self, event: Event, names: set[str]) -> list[str]:
        """Names of plant signals that an event's states integrate, or its test reads, between instants."""
        expressions = [self.states[name].derivative for name in event.updates if name in self.states]
        if not any(name.endswith(".count") for name in event.updates):
            expressions.append(event.guard)
        others = (state.symbol for key, state in self.states.items() if key not in names)
        truths = [self.builder.plant.q, self.builder.plant.v, *others]
        moving = {symbol.element_hash() for truth in truths for symbol in ca.vertsplit(truth)}
        symbols = ca.symvar(ca.veccat(*expressions))
        return [symbol.name() for symbol in symbols if symbol.element_hash() in moving]

    @functools.cached_property
    def _ports(self) -> dict[str, ca.SX]:
        """Allocated commands by the names of their states, as expressions of the controllers' commands."""
        commands = dict[str, ca.SX]()
        for port in self.builder.command_ports.values():
            symbols = [self.states[name].symbol for name in commands]
            (command,) = ca.substitute([port.command], symbols, list(commands.values()))
            commands[port.state.name] = command
        return commands

    @functools.cached_property
    def own_states(self) -> set[str]:
        """Names of the states of software: of laws, phases, tests, and held commands."""
        return self._states_of(self._actuator_events[0])

    @functools.cached_property
    def own_events(self) -> list[Event]:
        """Events that software does, finished, in their order."""
        names = self._builder_names[1] | {event.name for event in self._actuator_events[0]}
        events = [event for event in self.evaluated.acting.events if event.name in names]
        return [event for event in events if event.updates or event.sets]

    @functools.cached_property
    def transitions(self) -> list[Event]:
        """Events that begin phases."""
        return [event for event in self.evaluated.acting.events if event.kind == "phase"]

    @functools.cached_property
    def own_switches(self) -> set[str]:
        """Names of switches that only the software sets: phases, references, detections, pulses."""
        software_events = {event.name for event in (*self.own_events, *self.transitions)}
        names = {name for event in self.own_events for name in event.sets}
        names |= {switch.name() for switch in self.builder.context.phases.values()}
        plant_events = [event for event in self.evaluated.acting.events if event.name not in software_events]
        return names - {name for event in plant_events for name in event.sets}

    # -- expressions of fields alone -------------------------------------------------------------------------

    @functools.cached_property
    def constants(self) -> tuple[ca.SX, ca.SX]:
        """Constants that are numbers or expressions of plans: symbols, and their replacements."""
        context = self.builder.context
        parameters, constants = context.parameters, context.constants
        plan_paths = [path for paths in self.plans.values() for path in paths]
        plan_symbols = [parameters(path) for path in plan_paths]
        places = {path: i for i, path in enumerate(parameters.paths)}
        fixed = sorted(set(range(len(places))) - {places[path] for path in plan_paths})
        symbols, expressions = constants.symbols, constants.expressions
        numbers = ca.Function("c", [parameters.symbols], [expressions])(parameters.values)
        values = ca.SX(ca.DM(numbers))
        if plan_symbols:
            partial = ca.substitute(expressions, parameters.symbols[fixed], ca.DM(parameters.values[fixed]))
            varied = ca.which_depends(partial, ca.vertcat(*plan_symbols), 1, True)
            for i in (i for i, varies in enumerate(varied) if varies):
                values[i] = partial[i]
        for i in constants.jumps:
            values[i] += COINCIDENT
        variable = {*constants.switches.values()}
        for table in constants.tables:
            variable |= set(range(table.window, table.window + table.width))
        indices = [i for i in range(symbols.numel()) if i not in variable]
        return symbols[indices], values[indices]

    def closed(self, expressions: Sequence[ca.SX], *, held: bool = False) -> list[ca.SX]:
        """Expressions of time and fields only: tables are evaluated, and constants replaced by numbers.

        Args:
            expressions: The expressions.
            held: Whether allocated commands are those of the last tick, instead of the present instant.
        """
        if self._ports and not held:
            commands = [self.states[name].symbol for name in self._ports]
            expressions = ca.substitute(list(expressions), commands, list(self._ports.values()))
        constants = self.builder.context.constants
        symbols = constants.symbols
        for table in (table for table in constants.tables if table.noise < 0):
            window = symbols[table.window : table.window + table.width]
            if not any(ca.depends_on(expression, window) for expression in expressions):
                continue
            row_number = constants.cursors[table.cursor]
            rows = ca.reshape(symbols[table.first : table.first + table.width * table.count], table.width, -1)
            current_row = rows[:, table.count - 1]
            for k in range(table.count - 1):
                current_row = ca.if_else(row_number == k, rows[:, k], current_row)
            expressions = ca.substitute(list(expressions), [window], [current_row])
        return [ca.SX(one) for one in ca.substitute(list(expressions), *([each] for each in self.constants))]

    # -- fields ----------------------------------------------------------------------------------------------

    def add(self, one: Field) -> Field:
        """Register a field under its symbols; its name becomes a C identifier that no other field has."""
        if one.path not in self.pools:
            names = {field.name for field in self.pools.values()}
            one = replace(one, name=identifier(one.name, names | MEMBERS))
            self.pools[one.path] = one
            self.symbols |= {part.element_hash(): one for part in ca.vertsplit(one.symbol)}
        return self.pools[one.path]

    def fill(self) -> None:
        """Register all fields that tasks may read."""
        x0, c0 = self.start
        names = {name: i for i, name in enumerate(self.loop.state_names)}
        for one in true_motion(self.scene, self.builder, x0):
            self.add(one)
        samples = self._samples()
        for name, state in self.states.items():
            places = tuple(names[each] for each in state.names)
            role: Role = "state" if name in self.own_states else "truth"
            state_field = Field(name, name, role, state.symbol, x0[list(places)], name, places=places)
            if role == "truth":
                unit, text = PLANT_STATES.get(name.rpartition(".")[2], ("SI unit", "state of the plant"))
                state_field = replace(state_field, text=f"{text}: {name}", unit=unit)
            self.add(samples(state_field) if name not in self.own_states else state_field)
        constants, loop_switches = self.builder.context.constants, self.loop.switches
        for name, place in constants.switches.items():
            role = "state" if name in self.own_switches else "mode"
            text = f"1 while: {name}" if role == "mode" else name
            at = loop_switches[self.loop.switch_names.index(name)]
            state_field = Field(name, name, role, constants.symbols[place], c0[[at]], text, places=(at,))
            self.add(state_field)
        for table in (table for table in constants.tables if table.noise >= 0):
            window = list(range(table.window, table.window + table.width))
            name = constants.symbols[window[0]].name().rpartition("[")[0]
            text = "standard normal numbers of simulated errors; zero on board"
            state_field = Field(name, name, "draw", constants.symbols[window], np.zeros(table.width), text)
            self.add(replace(state_field, places=tuple(window)))
        parameters = self.builder.context.parameters
        for name, paths in self.plans.items():
            symbol = ca.vertcat(*(parameters(path) for path in paths))
            places = tuple(self.loop.index(path) for path in paths)
            values = np.array([parameters.value(path) for path in paths])
            text = "point by point, joint by joint, of the plan from outside"
            units = {"position": "rad or m", "rate": "rad/s or m/s", "effort": "N m or N", "begin": "s"}
            key = name.rpartition(".")[2]
            text = "time at which the plan begins" if key == "begin" else f"{key} {text}"
            self.add(
                Field(
                    name,
                    name,
                    "plan",
                    symbol,
                    values,
                    text,
                    units.get(key, "1"),
                    places=places,
                )
            )

    def _sampling(self) -> set[tuple[float, float]]:
        """Periods and first instants of the sensors [s]."""
        measured = [event for event in self.evaluated.acting.events if _is_sample(event)]
        return {self.instants(event) for event in measured if event.clock}

    def _samples(self) -> SampleNames:
        periods = {}
        for event in self.evaluated.acting.events:
            if _is_sample(event) and event.clock:
                period, _ = self.instants(event)
                for name in event.updates:
                    periods[name] = period
        signal_by_state = {one.value.name: name for name, one in self.builder.measurements.items()}
        signal_by_count = {one.samples.name: name for name, one in self.builder.measurements.items()}
        bodies = {sample.signal for sample in self.builder.samples.values()}
        estimators = [f"{body.name}/{key}." for body in self.scene.robots for key in self._estimators(body)]
        stamped = {
            state
            for state, name in signal_by_state.items()
            if any(name.startswith(each) for each in estimators)
        }
        return SampleNames(signal_by_state, signal_by_count, periods, bodies, stamped)

    @staticmethod
    def _estimators(body: SceneBody) -> Sequence[str]:
        """Keys of the estimators of a body."""
        return [*body.config.estimators] if isinstance(body.config, Robot) else []

    def reads_of(self, expressions: Sequence[ca.SX]) -> list[Field]:
        """Fields that expressions read, in the order in which they were registered."""
        read_paths = {
            self.symbols[symbol.element_hash()].path
            for symbol in ca.symvar(ca.veccat(*expressions))
            if symbol.element_hash() in self.symbols
        }
        return [one for path, one in self.pools.items() if path in read_paths]

    # -- tasks -----------------------------------------------------------------------------------------------

    def instants(self, event: Event) -> tuple[float, float]:
        """Period and first instant of a clock's event [s]."""
        count = next(name for name in event.updates if name.endswith(".count") and name in self.states)
        (guard,) = self.closed([event.guard])
        rule = ca.Function("g", [self.builder.context.time, self.states[count].symbol], [guard])
        begin = EARLY - float(rule(0.0, 0.0))
        period = float(rule(0.0, 0.0)) - float(rule(0.0, 1.0))
        return round(period, 12), max(round(begin, 12), 0.0)

    def drafts(self) -> tuple[list[_Draft], list[_Draft], list[_Draft]]:
        """Tasks in the order of one instant, conditions before them, and transitions.

        A detection follows the task that writes its inputs: an event armed by another one precedes everything
            else at that instant.
        """
        tasks, conditions, detections, entries = (list[_Draft]() for _ in range(4))
        names = set(FUNCTIONS)
        for event in self.own_events:
            values, name = self._values(event), identifier(event.name, names)
            names.add(name)
            text = EVENT_TEXTS.get(event.kind, event.kind)
            if event.clock and any(key.endswith(".count") for key in event.updates):
                period, offset = self.instants(event)
                period = 0.0 if period >= ONCE else period
                tasks.append(_Draft(name, event.name, text, values, period, offset))
                continue
            if any(event is cut for cut in self._cuts):
                continue
            late = COINCIDENT if event.kind == "reference" else 0.0
            fires = ca.logic_and(event.armed, event.guard > late)
            gated = {key: ca.if_else(fires, value, self._symbol(key)) for key, value in values.items()}
            if event.kind == "reference":
                conditions.append(_Draft(name, event.name, text, gated))
                continue
            tested = {symbol.element_hash() for symbol in ca.symvar(event.guard)}
            places = [i for i, task in enumerate(tasks) if tested & self._written(task)]
            detection = _Draft(name, event.name, text, gated, continual=True)
            if places:
                at = max(places) + 1
                while at < len(tasks) and tasks[at].continual:
                    at += 1
                tasks.insert(at, detection)
            else:
                detections.append(detection)
        for event in self.transitions:
            text = f"phase {event.who} begins"
            name = identifier(f"enter_{event.name}", names)
            names.add(name)
            entries.append(_Draft(name, event.name, text, self._values(event)))
        return [*tasks, *detections], conditions, entries

    def _written(self, task: _Draft) -> set[int]:
        """Symbols of the states that a task writes, but for the numbers of instants."""
        names = [key for key in task.values if key in self.states and not key.endswith(".count")]
        return {part.element_hash() for key in names for part in ca.vertsplit(self.states[key].symbol)}

    @functools.cached_property
    def _cuts(self) -> list[Event]:
        """Events that turn switches off at times that software decided before: ends of pulses."""
        time = self.builder.context.time
        return [
            event
            for event in self.own_events
            if event.onboard
            and event.sets
            and not event.updates
            and not any(event.sets.values())
            and ca.jacobian(event.guard, time).is_one()
        ]

    def _symbol(self, name: str) -> ca.SX:
        """Symbol of a state or a switch."""
        if name in self.states:
            return self.states[name].symbol
        constants = self.builder.context.constants
        return constants.symbols[constants.switches[name]]

    def _values(self, event: Event) -> dict[str, ca.SX]:
        """New values of states and switches; states read the switches as after the event.

        Values of the plant, such as a joint's brake, are left out.
        """
        sets = {name: ca.SX(float(value)) for name, value in event.sets.items()}
        updates = [ca.SX(value) for value in event.updates.values()]
        if sets and updates:
            updates = ca.substitute(updates, [self._symbol(name) for name in sets], list(sets.values()))
        values = {**dict(zip(event.updates, updates, strict=True)), **sets}
        return {key: one for key, one in values.items() if key in self.own_states | self.own_switches}

    def software(self) -> OnboardSoftware:
        """Onboard software with the fields and tasks that are needed."""
        self.fill()
        tasks, conditions, entries = self.drafts()
        if not tasks:
            raise self.scene.error(
                "found no controller or estimator with sample instants; allowed: at least one",
                "robots",
            )
        tick = common_tick([time for task in tasks for time in (task.period, task.offset) if time])
        commands = self._commands()
        output = _Draft("output", "output", "commands of the actuators", dict(commands))
        allocate = _Draft("allocate", "allocation", "commands of wheels and thrusters", dict(self._ports))
        drafts = [*tasks, *conditions, allocate, *entries, output]
        closed = {draft.path: self.closed(list(draft.values.values())) for draft in drafts}
        flow = self._flow(float(tick))
        if flow is not None:
            closed[flow.path] = self.closed(list(flow.values.values()), held=True)
        closed[output.path] = self.closed(list(output.values.values()), held=True)
        self._drop_what_has_no_influence([*tasks], closed)
        needed = self._needed([*drafts, *([flow] if flow else [])], closed)

        def finished(draft: _Draft) -> Task | None:
            """Task over the needed fields; None if it writes none of them."""
            outputs = [
                (self.pools[key], value)
                for key, value in zip(draft.values, closed[draft.path], strict=True)
                if key in needed
            ]
            if not outputs:
                return None
            values = [ca.densify(value) for _, value in outputs]
            reads = self.reads_of(values)
            function = ca.Function(
                draft.name, [self.builder.context.time, *(one.symbol for one in reads)], ca.cse(values)
            )
            period, offset = (round(time / float(tick)) for time in (draft.period, draft.offset))
            writes = tuple(one for one, _ in outputs)
            period = 1 if draft.continual else period
            return Task(
                draft.name,
                draft.path,
                draft.text,
                period,
                offset,
                function,
                tuple(reads),
                writes,
                draft.continual,
            )

        def all_of(drafts: Sequence[_Draft]) -> tuple[Task, ...]:
            return tuple(task for task in map(finished, drafts) if task is not None)

        result = finished(output)
        assert result is not None, "the commands are always needed"
        functions = all_of(tasks), all_of(conditions), all_of(entries)
        flowing = None if flow is None else finished(flow)
        allocation = finished(allocate)
        used_paths = {
            one.path for group in functions for task in group for one in (*task.reads, *task.writes)
        }
        used_paths |= {one.path for one in (*result.reads, *result.writes)}
        for more in (flowing, allocation):
            if more is not None:
                used_paths |= {one.path for one in (*more.reads, *more.writes)}
        return OnboardSoftware(
            name=identifier(self.scene.scenario.name, PROGRAMS),
            title=self.scene.scenario.name,
            tick=tick,
            fields=tuple(one for path, one in self.pools.items() if path in used_paths),
            flow=flowing,
            conditions=functions[1],
            tasks=functions[0],
            allocation=allocation,
            entries=functions[2],
            output=result,
            sampling=tuple(sorted(self._sampling())),
            plant_side=self._actuator_events[1],
        )

    def _needed(self, drafts: Sequence[_Draft], closed: Mapping[str, list[ca.SX]]) -> set[str]:
        """Paths of states and commands that tasks write and that affect a task's state or a command."""
        written_paths = {key for draft in drafts for key in draft.values}
        transitions = {event.name for event in self.transitions}
        periodic = [draft for draft in drafts if draft.path not in transitions]
        needed = {key for draft in periodic for key in draft.values}
        while True:
            read = {
                one.path
                for draft in drafts
                for key, value in zip(draft.values, closed[draft.path], strict=True)
                if key in needed
                for one in self.reads_of([value])
            }
            more = (read & written_paths) - needed
            if not more:
                return needed
            needed |= more

    def _commands(self) -> dict[str, ca.SX]:
        """Commanded generalized forces of each robot, as separate fields."""
        totals: dict[str, ca.SX] = {}
        for contribution in self.builder.controllers:
            for torque in contribution.torques:
                path = f"{torque.robot}.{'null_space_' if torque.null_space else ''}torque"
                totals[path] = totals[path] + torque.value if path in totals else ca.SX(torque.value)
        model, commands = self.builder.plant.model, {}
        names = column_names(model)
        for path, total in totals.items():
            rows = sorted(set(total.sparsity().row()))
            if not rows:
                continue
            text = f"generalized forces commanded of {', '.join(names[row] for row in rows)}"
            if ".null_space_" in path:
                text += "; only the part in the null space of the tips' motion is to act"
            frame = "joint axes; of a base the axes of its root link"
            commands[path] = self._command(path, total[rows], "N m or N", text, frame)
        for name, port in self.builder.command_ports.items():
            path = f"{name}.commands"
            commands[path] = self._command(path, port.state.symbol, port.unit, f"{port.text}: {name}")
        for event in self.own_events:
            if event.kind != "control":
                continue
            (key,) = (key for key in event.updates if not key.endswith(".count"))
            text = "times until which valves are open, from the decision on; earlier ones: shut"
            path = f"{event.who}.open_until"
            commands[path] = self._command(path, self.states[key].symbol, "s", f"{text}: {event.who}")
        return commands

    def _command(self, path: str, value: ca.SX, unit: str, text: str, frame: str = "-") -> ca.SX:
        """Value of a command, which is registered as a field."""
        symbol = ca.SX.sym(path, value.numel())
        self.add(Field(path, path, "command", symbol, np.zeros(value.numel()), text, unit, frame))
        return ca.densify(value)

    def _flow(self, tick: float) -> _Draft | None:
        """Task that integrates states over one tick by the Runge-Kutta method of order 4.

        The simulation uses its own method. Both are accurate to rounding for free motions, such as those of
        filters between two samples.
        """
        flowing_states = [
            state
            for name, state in self.states.items()
            if name in self.own_states and not state.remembers and not ca.SX(state.derivative).is_zero()
        ]
        flowing_states = [state for state in flowing_states if ca.sparsify(state.derivative).nnz()]
        if not flowing_states and not self._cuts:
            return None
        time = self.builder.context.time
        symbols = ca.vertcat(ca.SX(0, 1), *(state.symbol for state in flowing_states))
        rates = ca.vertcat(ca.SX(0, 1), *(state.derivative for state in flowing_states))
        cuts = {name: time - event.guard for event in self._cuts for name in event.sets}
        # A pulse that ends within the tick counts by its part of the tick. Rates are linear in switches.
        parts = [
            self._symbol(name) * ca.fmin(ca.fmax((end - time) / tick, 0), 1) for name, end in cuts.items()
        ]
        began = ca.SX.sym("began")
        parts = ca.substitute(parts, [time], [began]) if parts else []
        (rate,) = self.closed(ca.substitute([rates], [self._symbol(name) for name in cuts], parts), held=True)
        for one in self.reads_of([rate]):
            if one.role not in ("state", "mode"):
                raise self.scene.error(
                    f"found {one.path} in its rate, allowed for flight code: states that change at instants, "
                    "or by themselves",
                    flowing_states[0].name,
                )
        rule = ca.Function("rate", [time, symbols], [rate], {"allow_free": True})
        free = rule.free_sx()
        rule = ca.Function("rate", [time, symbols, *free], [rate])
        free = [time if one.element_hash() == began.element_hash() else one for one in free]
        steps = max(1, math.ceil(tick / LONGEST))
        h, value = tick / steps, symbols
        for k in range(steps):
            at = time + k * h
            first = rule(at, value, *free)
            second = rule(at + h / 2, value + h / 2 * first, *free)
            third = rule(at + h / 2, value + h / 2 * second, *free)
            fourth = rule(at + h, value + h * third, *free)
            value = value + h / 6 * (first + 2 * second + 2 * third + fourth)
        ends = np.cumsum([0, *(state.symbol.numel() for state in flowing_states)]).tolist()
        values = dict(zip((state.name for state in flowing_states), ca.vertsplit(value, ends), strict=True))
        values |= {name: self._symbol(name) * (end > time + tick + COINCIDENT) for name, end in cuts.items()}
        return _Draft("flow", "flow", "states that change between instants, over one tick", values)

    def _drop_what_has_no_influence(self, tasks: Sequence[_Draft], closed: dict[str, list[ca.SX]]) -> None:
        """Fix true values that do not influence a task at their initial values.

        An estimate is an expression in which the true value cancels, and filters read the true state only at
        the start. The expressions do not show this, so tasks are evaluated with perturbed true values.
        """
        for draft in tasks:
            values = closed[draft.path]
            reads = self.reads_of(values)
            blocks = [one for one in reads if one.role == "truth"]
            if not blocks or not draft.period:
                continue
            arguments = [self.builder.context.time, *(one.symbol for one in reads)]
            function = ca.Function("f", arguments, [ca.densify(ca.veccat(*values))])
            fixed = [block for block in blocks if not self._influences(function, reads, block)]
            if fixed:
                closed[draft.path] = ca.substitute(
                    values, [one.symbol for one in fixed], [ca.SX(ca.DM(one.initial)) for one in fixed]
                )

    def _influences(self, function: ca.Function, reads: Sequence[Field], block: Field) -> bool:
        """Whether a true value changes the results of a function, at random values of all fields."""
        model, generator = self.builder.plant.model, np.random.default_rng(39)
        x0, moving = self.start[0], model.nq + model.nv
        phases = [switch.name() for switch in self.builder.context.phases.values()]

        def random_state() -> Array:
            """A state near the initial one."""
            q = pin.integrate(model, x0[: model.nq], 0.2 * generator.normal(size=model.nv))
            return np.concatenate([q, 0.2 * generator.normal(size=model.nv), x0[moving:]])

        for trial in range(TRIALS):
            x, others = random_state(), random_state()
            numbers = {}
            for one in reads:
                value = np.array(one.initial)
                if one.path.endswith(".count"):
                    value = np.full(one.size, 7.0)
                elif one.path in phases:
                    value[:] = phases.index(one.path) == trial % len(phases)
                elif one.role == "mode" or one.path in self.own_switches:
                    value[:] = generator.integers(2)
                elif one.role == "truth" and max(one.places) < moving:
                    value = x[list(one.places)]
                else:
                    scale = 1e-3 if one.role == "state" else 1.0
                    value = value + scale * generator.normal(size=one.size)
                numbers[one.path] = value
            changed = others[list(block.places)]
            if max(block.places) >= moving:
                changed = numbers[block.path] + generator.normal(size=block.size)
            time, results = float(generator.uniform(1, 2)), []
            for case in (numbers, {**numbers, block.path: changed}):
                results.append(function(time, *(case[one.path] for one in reads)).full().ravel())
            change = np.abs(results[1] - results[0]) / np.maximum(np.abs(results[0]), 1.0)
            if np.any(change > INFLUENCE) or np.any(np.isnan(results[0]) != np.isnan(results[1])):
                return True
        return False


def _is_sample(event: Event) -> bool:
    """Whether the event takes or delivers a sensor's sample."""
    return event.kind == "measured" and not event.onboard


def _reason(symbols: Sequence[str]) -> str:
    """Why something stays in the plant that reads these symbols."""
    stems = sorted({re.sub(r"(_\d+|\[\d+\])$", "", symbol) for symbol in symbols})
    words = {"q": "positions (q)", "v": "velocities (v)"}
    names = ", ".join(words.get(stem, stem) for stem in stems)
    return f"it reads {names}, which change between the instants of software"
