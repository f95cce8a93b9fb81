"""Closed loops whose allocation of wheels and thrusters is held, as by onboard software.

The allocation is a function of the commanded wrench. If all its inputs are held between the sample instants
of software (commands of periodic controllers, switches), the allocated command is held too, and becomes a
state of the closed loop that software replaces at its instants. An allocation that reads the motion (wheels
with friction at their speed limit, thrusters that unload wheels) stays in the plant.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import casadi as ca

from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.elements import Contribution, State, memory
from spacerobot.elements.actuators.actuator import FIRING


@dataclass(frozen=True)
class CommandPort:
    """Command of the parts of an actuator.

    Attributes:
        state: State that holds it (n x 1).
        command: The allocation (n x 1).
        unit, text: SI unit and description.
    """

    state: State
    command: ca.SX
    unit: str
    text: str


@dataclass(frozen=True)
class OnboardLoopBuilder(LoopBuilder):
    """Builder of a closed loop whose held allocations are states.

    Attributes:
        command_ports: Held allocations by the name of the actuator.
        continuous_ports: Actuators whose allocation reads inputs that are not held, with the names of these
            inputs.
    """

    command_ports: dict[str, CommandPort] = field(default_factory=dict)
    continuous_ports: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def command_port(self, name: str, unit: str, text: str, command: ca.SX) -> ca.SX:
        """State of a held allocation; the allocation expression itself if it is continuous.

        An allocation is evaluated for several requests. The first is that of the controllers; later ones are
        predictions within a law and stay expressions.
        """
        if name in self.command_ports:
            port = self.command_ports[name]
            return port.state.symbol if _same(port.command, command) else command
        held = self._held_symbols()
        moving = [symbol.name() for symbol in ca.symvar(command) if symbol.element_hash() not in held]
        if moving:
            self.continuous_ports.setdefault(name, tuple(moving))
        if name in self.continuous_ports:
            return command
        state = memory(f"{name}.command", ca.SX.zeros(command.size1()))
        self.command_ports[name] = CommandPort(state, ca.densify(command), unit, text)
        return state.symbol

    def port_states(self) -> Contribution:
        """States of the held allocations."""
        return Contribution(states=tuple(port.state for port in self.command_ports.values()))

    def _held_symbols(self) -> set[int]:
        """Symbols that change only at sample instants: constants, switches, states that only events change.

        Switches of thruster pulses are not among them, since pulses end between these instants.
        """
        constants = self.context.constants
        moving = {i for one in constants.tables for i in range(one.window, one.window + one.width)}
        moving |= set(constants.jumps)
        moving |= {place for name, place in constants.switches.items() if f".{FIRING}." in name}
        parts: Iterable[Contribution] = [*self.controllers, *self.estimators.values()]
        symbols = [state.symbol for part in parts for state in part.states if _is_held(state)]
        symbols += [port.state.symbol for port in self.command_ports.values()]
        symbols += [one for i, one in enumerate(ca.vertsplit(constants.symbols)) if i not in moving]
        return {element.element_hash() for symbol in symbols for element in ca.vertsplit(symbol)}


def _is_held(state: State) -> bool:
    """Whether only events change the state."""
    return state.remembers or not ca.sparsify(ca.SX(state.derivative)).nnz()


def _same(one: ca.SX, other: ca.SX) -> bool:
    """Whether two vectors have identical expression nodes as entries."""
    pairs = zip(ca.vertsplit(ca.densify(one)), ca.vertsplit(ca.densify(other)), strict=True)
    return all(a.element_hash() == b.element_hash() for a, b in pairs)
