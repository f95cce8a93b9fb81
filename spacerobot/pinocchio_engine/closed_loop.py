"""The closed loop of a scene as x' = f(t, x), y = h(t, x), evaluated with NumPy and Pinocchio.

The laws are those of the elements' contributions, compiled once as functions of time, state, constants and
mechanical inputs. Mechanics, forward dynamics, impacts, distances and time integration are this engine's own.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.closedloop.build import evaluate, section_context, state_names
from spacerobot.closedloop.events import LoopEvent, rules_of, update_of
from spacerobot.closedloop.forward_dynamics import ForwardDynamicsResult
from spacerobot.common.arrays import Array
from spacerobot.common.section import numbers
from spacerobot.compiled.numeric_function import NumericFunction
from spacerobot.elements import Contribution
from spacerobot.pinocchio_engine.dynamics import DynamicsConditions, DynamicsUnknowns
from spacerobot.pinocchio_engine.mechanical_inputs import InputBuilder, InputPlant, numeric_start
from spacerobot.pinocchio_engine.mechanical_state import MechanicalState, configuration_rate, coordinates
from spacerobot.scenario.load import to_document
from spacerobot.scene import Scene
from spacerobot.symbolic import Parameters, Plant


@dataclass(frozen=True)
class EvaluatedInstant:
    """Mechanics, arguments of the laws and solved unknowns at one time.

    Attributes:
        state: Mechanical state.
        arguments: Arguments of the compiled laws: t, (q, v, z), c and inputs.
        solved: Unknowns (n,) of the forward dynamics; NaN where not requested.
        acceleration: v' (nv,), the last entries of ``solved``.
    """

    state: MechanicalState
    arguments: tuple[float, Array, Array, Array]
    solved: Array
    acceleration: Array


class PinocchioLoop:
    """Closed loop of a scene, ready to be evaluated.

    The state is x = (q, v, z), as in the closed loop. The constants c include the switches, which only
    :meth:`happen` changes.

    Attributes:
        scene, model: The scene and its ``pinocchio.Model``.
        parameter_paths: Dotted paths of the parameters.
        state_names: Names of z, in the closed loop's order.
        x0: Initial state (nx,).
        c: Constants (nc,), with the current switches.
        events: Rules of the events.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.model, self._scratch = scene, scene.model, scene.model.createData()
        parameters = Parameters(dict(numbers(to_document(scene.scenario))))
        context = section_context(scene, parameters)
        plant = InputPlant.of(scene, parameters, context.constants)
        builder = InputBuilder(scene, context, plant, numeric_start(scene))
        self._inputs, self._places = plant.inputs, coordinates(scene.model)

        def solve(plant: Plant, acting: Contribution) -> ForwardDynamicsResult:
            self._unknowns = DynamicsUnknowns(plant, acting)
            return self._unknowns.result

        evaluated = evaluate(builder, solve)
        acting = evaluated.acting
        constants = context.constants
        z = ca.vertcat(ca.SX(0, 1), *(state.symbol for state in acting.states))
        self.state_names = state_names(self.model, acting.states)[self.model.nq + self.model.nv :]
        self.parameter_paths = parameters.paths
        prepared = ca.Function("c", [parameters.symbols], [ca.densify(constants.expressions)])
        self._constants = NumericFunction(prepared)
        self.c: Array = self._constants(parameters.values)[0]
        self._jumps, self._tables = list(constants.jumps), constants.tables
        self._jump_times = self.c[self._jumps]
        noise = (t.drawn(*(parameters.value(key) for key in t.keys)) for t in constants.noise)
        self._noise: Array = np.concatenate([np.empty(0), *noise])
        self._switches = list(constants.switches.values())
        self.events: tuple[LoopEvent, ...] = rules_of(acting.events, list(constants.switches))
        self._impacts = [event.impact for event in acting.events]
        self._kept: dict[float, Array] = {}
        # functions of (t, x, c, inputs) and, later ones, of what was solved for
        unknowns, which = self._unknowns, ca.SX.sym("which")
        none = ca.SX(0, 1)
        rates = ca.vertcat(none, *(state.derivative for state in acting.states))
        guards = ca.vertcat(none, *(event.guard for event in acting.events))
        armed = ca.vertcat(none, *(event.armed for event in acting.events))
        start = ca.vertcat(none, *(state.initial for state in acting.states))
        updated = update_of(plant, acting, which, unknowns.struck)
        symbols = [context.time, ca.vertcat(plant.q, plant.v, z), constants.symbols, plant.inputs.symbols]
        null_space, output, solved = unknowns.null_space, unknowns.output, unknowns.solved
        self._solved, self._reactions = solved.size1(), unknowns.reaction.size1()

        def function(name: str, arguments: list[ca.SX], *values: ca.SX) -> NumericFunction:
            result = ca.Function(name, arguments, ca.cse([ca.densify(value) for value in values]))
            return NumericFunction(result)

        self._loads = function("loads", symbols, *unknowns.loads.values())
        self._early = function("early", [*symbols, null_space], *unknowns.early)
        self._late = function("late", [*symbols, null_space, output], *unknowns.late)
        self._rates = function("rates", [*symbols, solved], rates)
        self._outputs = function("outputs", [*symbols, solved], *evaluated.outputs.values())
        self._guards = function("guards", [*symbols, solved], guards)
        self._armed = function("armed", [constants.symbols], armed)
        sampled = ca.vertcat(none, *unknowns.sampled)
        self._update = function("update", [*symbols, solved, unknowns.impact, sampled, which], updated)
        self._laws = {
            name: function(f"law_{i}", [*symbols, solved], *loads.values())
            for i, (name, loads) in enumerate(unknowns.laws.items())
        }
        self._rows = function("rows", symbols, constants.cursors)
        self._start = function("start", symbols, start)
        self._output_names = tuple(evaluated.outputs)
        self._guards_see_forces = bool(ca.depends_on(guards, solved)) if guards.numel() else False
        # initial state (nx,): other states count as zero where one begins, but for what events change
        q, v, model = np.array(self.scene.q), np.array(self.scene.v), self.model
        remembers = np.concatenate(
            [np.empty(0), *(np.full(one.symbol.size1(), one.remembers) for one in acting.states)]
        )
        inputs = self._inputs.values(MechanicalState(model, q, v))
        others = np.zeros(len(remembers))
        for _ in range(2):
            x = np.concatenate([q, v, others * remembers])
            others = self._start(0.0, x, self.c, inputs)[0]
        self.x0 = np.concatenate([q, v, others])

    def change(self, p: Array) -> None:
        """Continue with other parameters (np,), in the order of ``parameter_paths``; switches are kept."""
        switches, self.c = self.switches, self._constants(p)[0]
        self.c[self._switches] = switches
        self._jump_times, self._kept = self.c[self._jumps], {}

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times known in advance at which the dynamics jump [s], ascending."""
        return tuple(sorted({float(t) for t in self._jump_times}))

    @property
    def switches(self) -> Array:
        """Current values of the switches, 0 or 1."""
        return self.c[self._switches]

    def split(self, x: Array) -> tuple[Array, Array, Array]:
        """Parts q (nq,), v (nv,) and z (nz,) of a state."""
        nq, nv = self.model.nq, self.model.nv
        return x[:nq], x[nq : nq + nv], x[nq + nv :]

    def normalise(self, x: Array) -> Array:
        """State with cosine-sine pairs and quaternions back on their unit spheres."""
        q, v, z = self.split(x)
        return np.concatenate([pin.normalize(self.model, q), v, z])

    def instant(
        self, t: float, x: Array, within: float | None = None, *, solved: bool = True
    ) -> EvaluatedInstant:
        """Evaluate mechanics, inputs and unknowns at one time.

        Arguments and errors as for :meth:`derivative`. Without ``solved`` the unknowns are not
        computed.
        """
        q, v, z = self.split(x)
        state = MechanicalState(self.model, q, v, self._scratch)
        x = np.concatenate([state.q, v, z])
        inputs = self._inputs.values(state)
        # constants (nc,) as they hold within an interval: jumps passed or not, rows of tables shown
        at = t if within is None else within
        if at in self._kept and within is not None:
            constants = self._kept[at]
        else:
            constants = self.c.copy()
            constants[self._jumps] = np.where(self._jump_times <= at, -np.inf, np.inf)
            if self._tables:
                rows = self._rows(t, x, constants, inputs)[0].astype(int)
                for table in self._tables:
                    held, first = (self._noise, table.noise) if table.noise >= 0 else (constants, table.first)
                    first += rows[table.cursor] * table.width
                    constants[table.window : table.window + table.width] = held[first : first + table.width]
            self._kept = {at: constants}
        arguments = (t, x, constants, inputs)
        if not solved:
            return EvaluatedInstant(state, arguments, np.full(self._solved, np.nan), np.full(len(v), np.nan))
        conditions = self._conditions(state, arguments)
        parts = [conditions.kept_still(name, size) for name, size in self._unknowns.projections]
        null_space = np.concatenate([np.empty(0), *parts])
        commanded, pushed = self._early(*arguments, null_space)
        effort = commanded + pushed
        outputs, reactions, acceleration = conditions.solve(effort, outputs=True)
        if len(outputs):
            commanded, pushed = self._late(*arguments, null_space, outputs)
            effort = commanded + pushed
        if self._unknowns.then:
            _, reactions, acceleration = conditions.solve(effort, outputs=False)
        loads = reactions[: self._reactions]
        return EvaluatedInstant(
            state, arguments, np.concatenate([null_space, outputs, loads, acceleration]), acceleration
        )

    def derivative(self, t: float, x: Array, within: float | None = None) -> Array:
        """Rate x' (nx,) of the state at time t [s].

        Args:
            t, x: Time and state; the configuration need not be normalised.
            within: Time in the interval that is meant if t lies between two intervals; t if None.

        Raises:
            numpy.linalg.LinAlgError: If rigid grasps constrain one degree of freedom twice.
        """
        now = self.instant(t, x, within)
        q, v, _ = self.split(x)
        rates = self._rates(*now.arguments, now.solved)[0]
        return np.concatenate([configuration_rate(self._places, q, v), now.acceleration, rates])

    def outputs(self, t: float, x: Array, within: float | None = None) -> dict[str, Array]:
        """Outputs by name, as column vectors; arguments and errors as for :meth:`derivative`."""
        now = self.instant(t, x, within)
        return dict(zip(self._output_names, self._outputs(*now.arguments, now.solved), strict=True))

    def guards(self, t: float, x: Array, within: float) -> Array:
        """Guards of all events (ne,), armed or not."""
        now = self.instant(t, x, within, solved=self._guards_see_forces)
        return self._guards(*now.arguments, now.solved)[0]

    @property
    def armed(self) -> list[int]:
        """Numbers of the events that can occur with the current switches."""
        return [int(number) for number in np.flatnonzero(self._armed(self.c)[0])]

    def gaps(self, x: Array) -> tuple[Array, Array]:
        """Gaps [m] between the shapes of all contacts, and bounds of the gaps' rates [m/s], (n,) each."""
        q, v, _ = self.split(x)
        state, pairs = MechanicalState(self.model, q, v, self._scratch), list[tuple[float, float]]()
        for contact in self.scene.contacts:
            for pair in contact.pairs:
                crown = contact.config.crown
                pairs.append((state.proximity(pair, crown)[0], state.approach_speed(pair, crown)))
        gaps, speeds = np.array(pairs).reshape(-1, 2).T
        return gaps, speeds

    def happen(self, number: int, t: float, x: Array, within: float | None = None) -> Array:
        """Apply an event's switches and return the state after it (nx,).

        Arguments as for :meth:`derivative`.
        """
        event = self.events[number]
        if event.ends:
            return x
        for place, value in event.sets:
            self.c[self._switches[place]] = float(value)
        self._kept.clear()
        now = self.instant(t, x, within)
        impact = np.zeros(self._unknowns.impact.size1())
        if self._impacts[number]:
            conditions = self._conditions(now.state, now.arguments)
            impact = conditions.strike(self._reactions)
        # outputs of laws that are evaluated at instants; zero for those that another event evaluates
        jumps = [np.zeros(output.size1()) for output in self._unknowns.sampled]
        for place, (name, loads) in enumerate(self._unknowns.laws.items()):
            if name == event.name:
                values = self._laws[name].matrices(*now.arguments, now.solved)
                impulses = dict(zip(loads, values, strict=True))
                conditions = self._conditions(now.state, now.arguments)
                conditions = DynamicsConditions(now.state, {**conditions.loads, **impulses})
                outputs = conditions.solve(impulses["effort"][:, 0], outputs=True)[0]
                jumps[place] = self._unknowns.instants[place].of(outputs)
        sampled = np.concatenate([np.empty(0), *jumps])
        after = self._update(*now.arguments, now.solved, impact, sampled, number)[0]
        self._kept.clear()
        return after

    def _conditions(
        self, state: MechanicalState, arguments: tuple[float, Array, Array, Array]
    ) -> DynamicsConditions:
        loads = self._loads.matrices(*arguments)
        return DynamicsConditions(state, dict(zip(self._unknowns.loads, loads, strict=True)))
