"""Building of the closed loop of a scene from the contributions of its elements."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import casadi as ca

from spacerobot.closedloop.closed_loop import ClosedLoop, OutputVariable
from spacerobot.closedloop.energy import EnergyTerm, build_works, plant_powers, stored_energies
from spacerobot.closedloop.events import booked, guards_of, rules_of, speeds_of, update_of
from spacerobot.closedloop.external_impulse import base_wrenches, impulse_of, on_bases, pushes_of, unbooked
from spacerobot.closedloop.forward_dynamics import ForwardDynamicsResult, solve_accelerations
from spacerobot.closedloop.impulse import strike
from spacerobot.closedloop.initial_state import initial_state
from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.closedloop.outputs import added_up, combine, core_outputs, measured_outputs
from spacerobot.closedloop.phases import phased
from spacerobot.closedloop.plant import build_plant
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.files import StrPath
from spacerobot.common.section import leaves, numbers
from spacerobot.dynamics import configuration_derivative, normalise
from spacerobot.elements import Contribution, Event, SectionContext, State
from spacerobot.elements.core.contribution import SampledLaw, concatenate
from spacerobot.scenario.load import to_document
from spacerobot.scene import Scene, to_scene
from spacerobot.scene.grasp_closing import has_loops, open_grasps
from spacerobot.symbolic import Constants, InitialState, Parameters, Plant

Builder = TypeVar("Builder", bound=LoopBuilder)


def build_closed_loop(
    scene: Scene | StrPath, vary: Collection[str] = (), kind: type[LoopBuilder] = LoopBuilder
) -> ClosedLoop:
    """Closed loop of a scene, whose parameters are all numbers that it depends on.

    Args:
        scene: The scene, or the name or file of its scenario.
        vary: Parameters to keep although they are exactly zero (products of inertia, offsets of centres of
            mass); all structurally nonzero numbers are kept anyway.
        kind: Kind of builder.

    Raises:
        ScenarioError: If ``vary`` names a number that the closed loop does not depend on.
        SpaceRobotError: If two elements give states the same name.
    """
    scene = to_scene(scene)
    builder = builder_of(kind, scene, vary)
    loop = assemble(builder, evaluate(builder))
    for path in vary:
        loop.index(path)
    return loop


def builder_of(kind: type[Builder], scene: Scene, vary: Collection[str] = ()) -> Builder:
    """Builder of some kind; parameters as for :func:`build_closed_loop`."""
    parameters = Parameters(dict(numbers(to_document(scene.scenario))), vary)
    context = section_context(scene, parameters)
    start = initial_state(scene, parameters)
    return kind(scene, context, build_plant(scene, parameters, context.constants), start)


def section_context(scene: Scene, parameters: Parameters) -> SectionContext:
    """Time, and the scenario's numbers as its elements see them."""
    constants, names = Constants(), list(scene.scenario.phases)
    phases = {name: constants.switch(f"phases.{name}", name == names[0]) for name in names}
    differing = leaves({"phases": {name: p.changes for name, p in scene.scenario.phases.items()}})
    words = {path: word for path, word in differing if isinstance(word, str)}
    return SectionContext("", ca.SX.sym("t"), parameters, constants, phases, words=words)


@dataclass(frozen=True)
class EvaluatedLoop:
    """Expressions of the complete loop.

    Attributes:
        acting: Sum of all contributions, with all events and all states except (q, v).
        acceleration, torque: Acceleration v', and generalized forces of the actuators (nv x 1 each).
        works: Works of the energy balance.
        variables, outputs: Descriptions and expressions of the outputs.
    """

    acting: Contribution
    acceleration: ca.SX
    torque: ca.SX
    works: Sequence[EnergyTerm]
    variables: tuple[OutputVariable, ...]
    outputs: Mapping[str, ca.SX]


def evaluate(
    builder: LoopBuilder, solve: Callable[[Plant, Contribution], ForwardDynamicsResult] = solve_accelerations
) -> EvaluatedLoop:
    """Contributions of all elements, the resulting accelerations, and the outputs.

    Args:
        builder: Builder of the elements.
        solve: Function from mechanics and contributions to accelerations.
    """
    scene, plant = builder.scene, builder.plant
    _ = builder.motions  # built first, so that their constants stand in front of those of the controllers
    acting = concatenate(builder.contributions())
    solution = solve(plant, acting)
    answers = concatenate(
        constraint.answer(force, torque)
        for constraint, (force, torque) in zip(acting.constraints, solution.wrenches, strict=True)
    )
    acting = concatenate([acting, solution.driven, builder.port_states()])
    acting = builder.with_tip_wrenches(acting, solution)
    # at one instant sensors measure before filters estimate, and these before controllers read
    order = {"measured": 0, "estimated": 1}
    first = sorted(acting.events, key=lambda event: order.get(event.kind, 2))
    acting = replace(acting, events=tuple(first))
    events = tuple(_evaluated(event, acting.sampled, solution.sampled) for event in acting.events)
    events = (*events, *answers.events)
    impulse = impulse_of(plant, [*acting.outside, *on_bases(scene, plant, solution.torque)])
    delivered = [*solution.driven.outside, *on_bases(scene, plant, solution.torque)]
    pushed = pushes_of(plant, delivered, builder.pushed)
    powers = (*plant_powers(plant, solution.torque), *acting.powers, *answers.powers, *booked(events))
    works = build_works(powers)
    declared = [
        *core_outputs(builder, solution.torque, acting.stored),
        *acting.outputs,
        *measured_outputs(builder),
        *answers.outputs,
        *stored_energies(scene, plant, acting),
        *(work.output for work in works),
        *impulse.outputs,
        *base_wrenches(scene, plant, delivered),
    ]
    combined = added_up(declared)
    phases = phased(builder, combined)
    variables, outputs = combine(scene, [*combined, *phases.outputs])
    states = (*acting.states, *pushed, *impulse.states, *(work.state for work in works), *phases.states)
    measured = [event for event in phases.events if event.kind == "measured"]
    rest = [event for event in phases.events if event.kind != "measured"]
    acting = replace(acting, states=states, events=(*measured, *events, *rest))
    return EvaluatedLoop(acting, solution.acceleration, solution.torque, works, variables, outputs)


def _evaluated(event: Event, laws: Sequence[SampledLaw], outputs: Sequence[ca.SX]) -> Event:
    """Event in which solved values replace the output symbols of the laws that it evaluates."""
    for law, output in zip(laws, outputs, strict=True):
        if law.event == event.name:
            values = ca.substitute(list(event.updates.values()), [law.output], [output])
            event = replace(event, updates=dict(zip(event.updates, values, strict=True)))
    return event


def _beginning(builder: LoopBuilder, acting: Contribution, x: ca.SX) -> tuple[InitialState, ca.SX]:
    """Initial state with velocities that rigid grasps in loops allow, and initial values of other states."""
    start, constants = builder.start, builder.context.constants
    arguments = [builder.context.time, x, constants.symbols]
    zeros = ca.SX.zeros(sum(state.symbol.size1() for state in acting.states))

    def at_start(expression: ca.SX, q: ca.SX, v: ca.SX, z: ca.SX) -> ca.SX:
        """An expression of (t, x, c) as one of the parameters."""
        return ca.Function("first", arguments, [expression])(0, ca.vertcat(q, v, z), constants.expressions)

    if has_loops(builder.scene):
        closed = strike(builder.plant, acting.constraints).velocity
        start = replace(start, v=at_start(closed, start.q, start.v, zeros))
    initial = ca.vertcat(*(state.initial for state in acting.states))
    z = at_start(initial, start.q, start.v, zeros)
    if any(state.remembers for state in acting.states):
        remembered = [ca.SX.ones(state.symbol.size1()) * state.remembers for state in acting.states]
        z = at_start(initial, start.q, start.v, z * ca.vertcat(*remembered))
    return start, ca.vertcat(start.q, start.v, z)


def assemble(builder: LoopBuilder, evaluated: EvaluatedLoop) -> ClosedLoop:
    """Closed loop of finished expressions, as named functions.

    Args:
        builder: Builder whose elements are all built.
        evaluated: Expressions of the complete loop.
    """
    context, plant, acting = builder.context, builder.plant, evaluated.acting
    model, q, v = plant.model, plant.q, plant.v
    parameters, constants = context.parameters, context.constants
    z = ca.vertcat(*(state.symbol for state in acting.states))
    x, c = ca.vertcat(q, v, z), constants.symbols
    derivatives = [state.derivative for state in acting.states]
    rates = ca.vertcat(configuration_derivative(model, q, v), evaluated.acceleration, *derivatives)
    start, beginning = _beginning(builder, acting, x)
    # gaps [m] of the grasps that no base closes
    grasps = open_grasps(builder.scene)
    apart = [start.placement(grasp.tip.frame)[1] - start.placement(grasp.frame)[1] for grasp in grasps]
    gaps = ca.vertcat(ca.SX(0, 1), *(ca.norm_2(ca.densify(gap)) for gap in apart))
    arguments = {"t": context.time, "x": x, "c": c}
    unit = ca.densify(ca.vertcat(normalise(model, q), v, z))
    setup = {"x0": ca.densify(beginning), "c": ca.densify(constants.expressions)}
    places, names = constants.switches, list(constants.switches)
    rate, which = ca.SX.sym("xdot", x.size1()), ca.SX.sym("e")
    values, slopes = guards_of(acting.events, context.time, x, rate)
    guards = {
        "g": ca.densify(values),
        "rate": ca.densify(slopes),
        "speed": ca.densify(speeds_of(acting.events)),
    }
    after = {"x_after": ca.densify(update_of(plant, acting, which))}
    functions = _functions(
        setup=({"p": parameters.symbols}, setup),
        dynamics=(arguments, {"xdot": ca.densify(rates)}),
        normalise=({"x": x}, {"x_unit": unit}),
        outputs=(arguments, evaluated.outputs),
        gaps=({"p": parameters.symbols}, {"gap": ca.densify(gaps)}),
        rows=(arguments, {"row": ca.densify(constants.cursors)}),
        guards=({**arguments, "xdot": rate}, guards),
        update=({**arguments, "e": which}, after),
    )
    return ClosedLoop(
        parameter_paths=parameters.paths,
        parameter_values=parameters.values,
        state_names=state_names(model, acting.states),
        nq=model.nq,
        nv=model.nv,
        nz=z.size1(),
        variables=evaluated.variables,
        max_gaps={grasp.path: grasp.config.max_gap for grasp in grasps},
        noise=tuple(constants.noise),
        works={work.name: 1 if work.sign == "in" else -1 for work in evaluated.works},
        outside=unbooked(builder.scene),
        jumps=constants.jumps,
        tables=constants.tables,
        switches=tuple(places.values()),
        switch_names=tuple(names),
        events=rules_of(acting.events, names),
        fine=tuple((names.index(switch.name()), begin, end) for switch, begin, end in acting.fine),
        **functions,
    )


def _functions(**described: tuple[Mapping[str, ca.SX], Mapping[str, ca.SX]]) -> dict[str, Any]:
    """Functions of (inputs, outputs), common subexpressions shared.

    These are looked for once in all of them: outputs and guards repeat most of the dynamics.
    """
    shared = iter(ca.cse([value for _, outputs in described.values() for value in outputs.values()]))
    return {
        name: ca.Function(name, [*inputs.values()], [next(shared) for _ in outputs], [*inputs], [*outputs])
        for name, (inputs, outputs) in described.items()
    }


def state_names(model: Any, states: Sequence[State]) -> tuple[str, ...]:
    """Names of the coordinates of q and v, then of the states."""
    names = []
    for kind, starts, sizes in (("q", model.idx_qs, model.nqs), ("v", model.idx_vs, model.nvs)):
        for joint in range(1, model.njoints):
            size = sizes[joint]
            names += [f"{kind}.{model.names[joint]}" + (f"[{i}]" if size > 1 else "") for i in range(size)]
        if [*starts[1:]] != sorted(starts[1:]):
            raise ValueError("joints are not stored in the order of their coordinates")
    names += [name for state in states for name in state.names]
    shared = sorted(name for name, count in Counter(names).items() if count > 1)
    if shared:
        raise SpaceRobotError(
            f"more than one element has a state '{shared[0]}'; name states after the element's place: "
            "the robot, tip or grasp, and its key there"
        )
    return tuple(names)
