"""Build the closed loop of a scene."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca

from spacerobot.closedloop.closed_loop import ClosedLoop
from spacerobot.closedloop.energy import build_works
from spacerobot.closedloop.forward_dynamics import Solution, solve_accelerations
from spacerobot.closedloop.grasps import (
    Constraint,
    build_constraint,
    build_coupling,
    build_relative,
    close_velocity,
)
from spacerobot.closedloop.joint_control import build_joint_control
from spacerobot.closedloop.outputs import build_outputs
from spacerobot.closedloop.parameters import Constants, Parameters
from spacerobot.closedloop.plant import Plant, build_plant
from spacerobot.closedloop.references import Motion, build_motion
from spacerobot.closedloop.start import Start, initial_state
from spacerobot.closedloop.states import State
from spacerobot.closedloop.tip_control import Channel, build_channels
from spacerobot.dynamics import configuration_derivative, normalise
from spacerobot.scenario import Compliant
from spacerobot.scene import Scene
from spacerobot.scene.closing import has_loops, open_grasps


def build_closed_loop(scene: Scene, vary: Collection[str] = ()) -> ClosedLoop:
    """Closed loop of a scene, its parameters being every number it depends on.

    Parameters
    ----------
    scene
        The scene.
    vary
        Parameters that shall be kept although they are exactly zero (products of inertia, offsets of
        centres of mass); all others that are not structurally zero are there anyway.

    Raises
    ------
    ScenarioError
        If ``vary`` names what the closed loop does not depend on.
    """
    parameters, constants = Parameters(scene.scenario, vary), Constants()
    start = initial_state(scene, parameters)
    plant = build_plant(scene, parameters, constants)
    time = ca.SX.sym("t")
    motions = _motions(scene, start, time, parameters, constants)
    channels = [
        channel
        for tip in scene.tips
        for channel in build_channels(plant, tip, motions[tip.label], parameters, constants)
    ]
    controls = [
        control
        for body in scene.robots
        if (control := build_joint_control(plant, body, motions, start, parameters, constants)) is not None
    ]
    relatives = [build_relative(plant, start, grasp, constants) for grasp in scene.grasps]
    couplings = [
        build_coupling(plant, relative, relative.grasp.config, parameters, constants)
        for relative in relatives
        if isinstance(relative.grasp.config, Compliant)
    ]
    constraints = [
        build_constraint(plant, relative, parameters, constants)
        for relative in relatives
        if not isinstance(relative.grasp.config, Compliant)
    ]
    solution = solve_accelerations(plant, channels, controls, couplings, constraints, parameters, constants)
    works = build_works(plant, solution, couplings, constraints)
    states = [*_controller_states(channels), *(control.state for control in controls), *works]
    if has_loops(scene):
        start = _close_loops(start, plant, constraints, constants)
    outputs = build_outputs(plant, start, motions, solution, couplings, constraints, works, constants)
    loop = _assemble(plant, start, time, states, solution, outputs, parameters, constants)
    for path in vary:
        loop.index(path)
    return loop


def _motions(
    scene: Scene, start: Start, time: ca.SX, parameters: Parameters, constants: Constants
) -> dict[str, Motion]:
    """Reference motion of each tip, by its label."""
    motions = {}
    for tip in scene.tips:
        pivot, path = None, f"{tip.path}.reference"
        if tip.from_target and scene.target is not None:
            pivot, path = start.placement(scene.target.root_frame)[1], "target.reference"
        motions[tip.label] = build_motion(
            tip.reference, path, time, parameters, constants, start=start.placement(tip.frame), pivot=pivot
        )
    return motions


def _controller_states(channels: Sequence[Channel]) -> list[State]:
    return [state for channel in channels for state in channel.states]


def _close_loops(
    start: Start, plant: Plant, constraints: Sequence[Constraint], constants: Constants
) -> Start:
    """Start with a velocity that rigid grasps allow which no base could close."""
    arguments = [plant.q, plant.v, constants.symbols]
    closed = ca.Function("closed", arguments, [close_velocity(plant, constraints)])
    return replace(start, v=closed(start.q, start.v, constants.expressions))


def _gaps(start: Start, scene: Scene) -> tuple[ca.SX, dict[str, float]]:
    """Initial gaps [m] of the grasps that no base closes (n x 1), and the greatest ones allowed, by path."""
    grasps = open_grasps(scene)
    gaps = [start.placement(grasp.tip.frame)[1] - start.placement(grasp.frame)[1] for grasp in grasps]
    found = ca.vertcat(ca.SX(0, 1), *(ca.norm_2(ca.densify(gap)) for gap in gaps))
    return found, {grasp.path: grasp.config.max_gap for grasp in grasps}


def _assemble(
    plant: Plant,
    start: Start,
    time: ca.SX,
    states: Sequence[State],
    solution: Solution,
    outputs: dict[str, ca.SX],
    parameters: Parameters,
    constants: Constants,
) -> ClosedLoop:
    """Named functions of the finished expressions."""
    model, q, v = plant.model, plant.q, plant.v
    z = ca.vertcat(*(state.symbol for state in states))
    x, c = ca.vertcat(q, v, z), constants.symbols
    rates = ca.vertcat(
        configuration_derivative(model, q, v),
        solution.acceleration,
        *(state.derivative for state in states),
    )
    initial = ca.Function("initial", [time, x, c], [ca.vertcat(*(state.initial for state in states))])
    resting = ca.vertcat(start.q, start.v, ca.SX.zeros(z.size1()))
    z0 = initial(0, resting, constants.expressions)
    setup = _function(
        "setup",
        {"p": parameters.symbols},
        {"x0": ca.densify(ca.vertcat(start.q, start.v, z0)), "c": ca.densify(constants.expressions)},
    )
    gaps, max_gaps = _gaps(start, plant.scene)
    arguments = {"t": time, "x": x, "c": c}
    return ClosedLoop(
        parameter_paths=parameters.paths,
        parameter_values=parameters.values,
        state_names=_state_names(model, states),
        nq=model.nq,
        nv=model.nv,
        nz=z.size1(),
        setup=setup,
        dynamics=_function("dynamics", arguments, {"xdot": ca.densify(rates)}),
        normalise=_function(
            "normalise", {"x": x}, {"x_unit": ca.densify(ca.vertcat(normalise(model, q), v, z))}
        ),
        outputs=_function("outputs", arguments, outputs),
        gaps=_function("gaps", {"p": parameters.symbols}, {"gap": ca.densify(gaps)}),
        max_gaps=max_gaps,
        jumps=constants.jumps,
    )


def _function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """Named function with common subexpressions shared."""
    shared = ca.cse(list(outputs.values()))
    return ca.Function(name, list(inputs.values()), shared, list(inputs), list(outputs))


def _state_names(model: Any, states: Sequence[State]) -> tuple[str, ...]:
    names = []
    for kind, starts, sizes in (("q", model.idx_qs, model.nqs), ("v", model.idx_vs, model.nvs)):
        for joint in range(1, model.njoints):
            size = sizes[joint]
            names += [f"{kind}.{model.names[joint]}" + (f"[{i}]" if size > 1 else "") for i in range(size)]
        if [*starts[1:]] != sorted(starts[1:]):
            raise ValueError("joints are not stored in the order of their coordinates")
    return tuple(names) + tuple(name for state in states for name in state.names)
