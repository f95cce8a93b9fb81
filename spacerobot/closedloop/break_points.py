"""Break points: the closed loop with an additive input at each torque, measurement and wheel.

With the signal y_i of a loop, such as the torque that controllers command of a joint, ``y_i + w_i`` acts in
its place. The derivatives of ``x' = f(t, x, c, w)`` and ``y = h(t, x, c, w)`` at w = 0 give the transfer
functions of every loop, broken at any of these points: with y = -L u and u = y + w, the response of u to w is
the sensitivity ``1 / (1 + L)``.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from spacerobot.closedloop.build import evaluate, section_context, state_names
from spacerobot.closedloop.events import update_of
from spacerobot.closedloop.forward_dynamics import ForwardDynamicsResult, solve_accelerations
from spacerobot.closedloop.impulse import masked
from spacerobot.closedloop.initial_state import initial_state
from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.closedloop.plant import build_plant
from spacerobot.common.errors import SpaceRobotError, near_names
from spacerobot.common.section import matching, numbers
from spacerobot.dynamics import configuration_derivative
from spacerobot.elements import CommandedTorque, Contribution
from spacerobot.elements.core.contribution import concatenate
from spacerobot.scenario.load import to_document
from spacerobot.scene import Scene
from spacerobot.symbolic import Parameters, Plant

TORQUE, MEASUREMENT, WHEEL = "torque", "measurement", "wheel"
PLACES = (TORQUE, MEASUREMENT, WHEEL)
"""Points at which loops are opened; names of break points begin with these words."""


def matching_points(names: Sequence[str], pattern: str) -> list[str]:
    """Names of break points that match a pattern.

    Args:
        names: Names of all break points.
        pattern: Pattern; ``*`` matches any characters.

    Raises:
        SpaceRobotError: If none matches; the message has similar names, or all of them in groups.
    """
    matches = matching(names, pattern)
    if not matches:
        raise SpaceRobotError(
            f"no break point {pattern!r}; {near_names(pattern, grouped(names))}; `*` matches any characters",
            where="loops",
        )
    return matches


def grouped(names: Iterable[str]) -> list[str]:
    """Names in groups: those that differ only in their last number are one, as ``torque/arm/joint_1..7``."""
    numbers_by_name: dict[tuple[str, str], list[int]] = {}
    groups = []
    for name in names:
        numbered = re.fullmatch(r"(.*?)(\d+)(\D*)", name)
        if numbered is None:
            groups.append(name)
        else:
            numbers_by_name.setdefault((numbered[1], numbered[3]), []).append(int(numbered[2]))
    for (first, last), numbers_of_group in numbers_by_name.items():
        lowest, highest = min(numbers_of_group), max(numbers_of_group)
        span = f"{lowest}..{highest}" if highest > lowest else f"{lowest}"
        groups.append(f"{first}{span}{last}")
    return groups


@dataclass(frozen=True)
class BreakPoints:
    """Inputs and signals of break points by name, in the order in which laws were built.

    Attributes:
        inputs: Symbols w (1x1 each).
        signals: Signals y of the loops (1x1 each).
    """

    inputs: dict[str, ca.SX] = field(default_factory=dict)
    signals: dict[str, ca.SX] = field(default_factory=dict)

    def opened(self, place: str, names: Sequence[str], signal: ca.SX) -> ca.SX:
        """Signal (n x 1) with an input added to each of its components.

        Args:
            place: One of :data:`PLACES`.
            names: Names of the components.
            signal: Its values. A law may be evaluated more than once: the first signal of a name counts.
        """
        added = []
        for i, name in enumerate(names):
            full = f"{place}/{name}"
            added.append(self.inputs.setdefault(full, ca.SX.sym(full)))
            self.signals.setdefault(full, signal[i])
        return signal + ca.vertcat(ca.SX(0, 1), *added)


@dataclass(frozen=True)
class PerturbedLoop:
    """Derivatives of a closed loop with break points, all at w = 0.

    Attributes:
        state_names: Names of the states x of the closed loop.
        coordinates: Names of the components of v, one for each tangent direction of q.
        inputs, outputs: Names of the break points, and of the outputs, with the break points' signals first.
        derivatives: (t, x, c) -> (A, B, C, D): Jacobians of x' and y by x and w.
        tangent: (x) -> (N, rate): ``q' = N(q) v`` (nq x nv), and the rate of N along that.
        constraints: (t, x, c) -> (G, slip_q): of the active rigid connections ``G v = 0``, G and the Jacobian
            of G v by q.
        update: (t, x, c, e) -> (x_after, E, F): state after event number e, its Jacobians by x and w.
    """

    state_names: tuple[str, ...]
    coordinates: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    derivatives: ca.Function
    tangent: ca.Function
    constraints: ca.Function
    update: ca.Function


def build_perturbed_loop(
    scene: Scene, outputs: Iterable[str] = (), vary: Collection[str] = ()
) -> PerturbedLoop:
    """Closed loop of a scene with break points; its constants are those of the original loop.

    Args:
        scene: The scene.
        outputs: Names of outputs of the closed loop, appended to the break points' signals.
        vary: See :func:`build_closed_loop`.

    Raises:
        KeyError: If an output does not exist.
    """
    parameters = Parameters(dict(numbers(to_document(scene.scenario))), vary)
    context, points = section_context(scene, parameters), BreakPoints()
    start = initial_state(scene, parameters)
    plant = build_plant(scene, parameters, context.constants)
    builder = LoopBuilder(scene, context, plant, start, break_point=points.opened)
    columns = [name.removeprefix("v.") for name in state_names(plant.model, ())[plant.model.nq :]]

    def solve(plant: Plant, acting: Contribution) -> ForwardDynamicsResult:
        """Accelerations with an input at each commanded generalized force."""
        values = [torque.value for torque in acting.torques]
        values += [ca.sum2(channel.actuation) for channel in acting.channels]
        driven = sorted({row for value in values for row in value.sparsity().row()})
        names = [f"{TORQUE}/{columns[row]}" for row in driven]
        added = ca.SX(plant.v.size1(), 1)
        for row, name in zip(driven, names, strict=True):
            added[row] = points.inputs.setdefault(name, ca.SX.sym(name))
        perturbed = Contribution(torques=(CommandedTorque("", added),))
        solution = solve_accelerations(plant, concatenate([acting, perturbed]))
        for row, name in zip(driven, names, strict=True):
            points.signals.setdefault(name, solution.commanded[row] - added[row])
        return solution

    loop = evaluate(builder, solve)
    z = ca.vertcat(*(state.symbol for state in loop.acting.states))
    t, x, c, w = context.time, ca.vertcat(plant.q, plant.v, z), context.constants.symbols, ca.SX(0, 1)
    w = ca.vertcat(w, *points.inputs.values())
    velocity = configuration_derivative(plant.model, plant.q, plant.v)
    rates = ca.vertcat(velocity, loop.acceleration, *(state.derivative for state in loop.acting.states))
    more = {
        f"{name}[{i}]": loop.outputs[name][i] for name in outputs for i in range(loop.outputs[name].size1())
    }
    y = ca.vertcat(ca.SX(0, 1), *(points.signals[name] for name in points.inputs), *more.values())
    zero = ca.SX.zeros(w.size1())

    def at_rest(*expressions: ca.SX) -> list[ca.SX]:
        """Expressions with the break points' inputs set to zero.

        Common subexpressions stay: of the updates of a filter (1.6 million operations) their elimination
        removes 6 %, and takes 17 s where all else takes 2 s.
        """
        return [ca.densify(expression) for expression in ca.substitute(list(expressions), [w], [zero])]

    matrices = at_rest(*(ca.jacobian(of, by) for of in (rates, y) for by in (x, w)))
    turn = ca.jacobian(velocity, plant.v)
    turning = ca.reshape(ca.jtimes(ca.vec(ca.densify(turn)), plant.q, velocity), *turn.shape)
    relative = np.eye(scene.model.nv) - scene.spread  # v_i - k v_j of joints that mimic others
    slips = [
        masked(constraint.slip, constraint.active)
        for constraint in loop.acting.constraints
        if constraint.compliance is None
    ]
    slips += [ca.mtimes(relative[[scene.model.idx_vs[tie.joint]], :], plant.v) for tie in scene.ties]
    slip = ca.vertcat(ca.SX(0, 1), *slips)
    which = ca.SX.sym("e")
    after = update_of(plant, loop.acting, which)
    arguments = [t, x, c]
    return PerturbedLoop(
        state_names=state_names(plant.model, loop.acting.states),
        coordinates=tuple(columns),
        inputs=tuple(points.inputs),
        outputs=(*points.inputs, *more),
        derivatives=ca.Function("derivatives", arguments, matrices),
        tangent=ca.Function("tangent", [x], at_rest(turn, turning)),
        constraints=ca.Function(
            "constraints", arguments, at_rest(*(ca.jacobian(slip, by) for by in (plant.v, plant.q)))
        ),
        update=ca.Function(
            "update", [*arguments, which], at_rest(after, *(ca.jacobian(after, by) for by in (x, w)))
        ),
    )
