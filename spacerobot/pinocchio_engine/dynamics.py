"""Numeric forward dynamics and impacts from the elements' contributions.

    [ 1 + K_d C A D    K_d C A S     ] [u]   [command - K_d C a_0]
    [ S^T A D          S^T A S + idle] [w] = [-drift - S^T a_0   ]

A is the inverse of the joint-space inertia (composite rigid bodies) and a_0 the acceleration under all other
loads (articulated bodies). D and S are the generalized forces of the channels' outputs u and of the reactions
w of rigid connections, and C v' is the acceleration that enters the channels' derivatives. Rows of an
inactive connection are masked, and idle is 1 on them. Actuators that u drives are evaluated once u is known.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from spacerobot.closedloop.forward_dynamics import ForwardDynamicsResult, deliver, in_turn, known_locks
from spacerobot.closedloop.impulse import PlasticImpact, idleness, imposed, masked
from spacerobot.common.arrays import Array
from spacerobot.elements import Contribution, ControlChannel
from spacerobot.elements.core.contribution import SampledLaw, concatenate, jointly
from spacerobot.pinocchio_engine.mechanical_state import MechanicalState
from spacerobot.symbolic import Plant


class DynamicsUnknowns:
    """Symbols of the unknowns that NumPy solves for, and the loads and conditions in their equations.

    Attributes:
        null_space, output, reaction, acceleration: Symbols (n x 1): forces that keep tips still, outputs of
            implicit channels, reactions of rigid connections along their directions, and v'.
        struck: Symbols of the velocity, impulses and loss of an impact.
        loads: Expressions by name that depend on no unknown.
        early, late: Generalized forces, commanded and of wrenches (nv x 1 each), before and after ``output``
            is known.
        laws, sampled: Loads of laws evaluated at sample instants, by the name of their event; and the symbols
            of their outputs (n x 1 each).
    """

    def __init__(self, plant: Plant, acting: Contribution) -> None:
        size, channels = plant.v.size1(), acting.channels
        self.implicit = [channel for channel in channels if channel.derivative_gain is not None]
        self.ties = plant.ties
        torque = ca.SX(size, 1)
        for channel in channels:
            if channel.derivative_gain is None:
                torque = torque + ca.mtimes(channel.actuation, channel.command)
        self.projections: list[tuple[str, int]] = []
        self.null_space, self.loads = ca.SX(0, 1), dict[str, ca.SX]()
        for number, command in enumerate(acting.torques):
            tip_channels = [one for one in channels if one.robot == command.robot and one.moves_tip]
            torque = torque + command.value
            if command.null_space and tip_channels:
                actuation = ca.horzcat(*(one.actuation for one in tip_channels))
                force = ca.SX.sym(f"null_space_{number}", actuation.size2())
                torque = torque - ca.mtimes(actuation, force)
                self.null_space = ca.vertcat(self.null_space, force)
                self.projections.append((f"asked_{number}", force.size1()))
                locks = known_locks(acting.constraints)
                still = [plant.ties, *(masked(one.sense, one.active) for one in locks)]
                idle = [ca.SX(force.size1() + plant.ties.size2(), 1), *(idleness(one) for one in locks)]
                self.loads |= {
                    f"asked_{number}": command.value,
                    f"asked_{number}_sense": ca.horzcat(*(one.sense for one in tip_channels), *still),
                    f"asked_{number}_drive": ca.horzcat(*(one.drive for one in tip_channels), *still),
                    f"asked_{number}_idle": ca.vertcat(*idle),
                }
        first, self.then = in_turn(acting.drives, self.implicit)
        commanded = torque
        torque, early = deliver(torque, first, {column for drive in self.then for column in drive.columns})
        wrenches = [*acting.wrenches, *acting.outside, *early.wrenches, *early.outside]
        pushed = plant.reduced(wrenches=wrenches) - plant.passive_forces
        self.early = torque, pushed
        self.output = ca.SX.sym("output", sum(channel.size for channel in self.implicit))
        if self.implicit:
            torque = torque + ca.mtimes(ca.horzcat(*(one.actuation for one in self.implicit)), self.output)
        torque, answer = deliver(torque, self.then)
        self.late = torque, pushed + plant.reduced(wrenches=[*answer.wrenches, *answer.outside])
        self.driven = concatenate([early, answer])
        self.instants = jointly(acting.sampled)
        self.laws = {law.event: self._at_instant(plant, acting, law, commanded) for law in self.instants}
        self.sampled = tuple(law.output for law in acting.sampled)
        self.reaction = ca.SX.sym("reaction", sum(held.size for held in acting.constraints))
        self.acceleration = ca.SX.sym("acceleration", size)
        # loads and conditions of implicit channels and rigid connections
        none, ties, held = ca.SX(0, 1), plant.ties.size2(), acting.constraints
        wide = ca.SX(plant.v.size1(), 0)
        self.loads |= _loads(plant, self.implicit) | {
            "held": ca.horzcat(wide, *(masked(one.sense, one.active) for one in held), plant.ties),
            "drift": ca.vertcat(none, *(masked(one.drift, one.active) for one in held), ca.SX(ties, 1)),
            "slip": ca.vertcat(none, *(masked(one.slip, one.active) for one in held), ca.SX(ties, 1)),
            "idle": ca.vertcat(none, *(idleness(one) for one in held), ca.SX(ties, 1)),
            "imposed": ca.vertcat(none, *(imposed(one) for one in held), ca.SX(ties, 1)),
        }
        cuts = np.cumsum([0, *(one.size for one in held)]).tolist()
        self.reactions = tuple(self.reaction[a:b] for a, b in itertools.pairwise(cuts))
        self.wrenches = tuple(one.on_target(along) for one, along in zip(held, self.reactions, strict=True))

    def _at_instant(
        self, plant: Plant, acting: Contribution, law: SampledLaw, commanded: ca.SX
    ) -> dict[str, ca.SX]:
        """Loads in the equations of a law evaluated at sample instants, together with the continuous laws."""
        torque, answers = deliver(commanded - law.held, law.others(acting.drives))
        wrenches = [*acting.wrenches, *acting.outside, *answers.wrenches, *answers.outside]
        effort = torque + plant.reduced(wrenches=wrenches) - plant.passive_forces
        return {"effort": effort} | _loads(plant, [*law.channels, *self.implicit])

    @cached_property
    def struck(self) -> PlasticImpact:
        """Impact whose velocity, impulses and loss are symbols."""
        cuts = np.cumsum([0, *(part.size1() for part in self.reactions)]).tolist()
        impulse = ca.SX.sym("impulse", self.reaction.size1())
        parts = tuple(impulse[a:b] for a, b in itertools.pairwise(cuts))
        return PlasticImpact(ca.SX.sym("struck", self.acceleration.size1()), parts, ca.SX.sym("loss"))

    @property
    def result(self) -> ForwardDynamicsResult:
        """Result of the forward dynamics in terms of the unknowns."""
        return ForwardDynamicsResult(
            self.acceleration, self.late[0], self.wrenches, self.driven, self.sampled
        )

    @property
    def solved(self) -> ca.SX:
        """All unknowns except those of an impact (n x 1)."""
        return ca.vertcat(self.null_space, self.output, self.reaction, self.acceleration)

    @property
    def impact(self) -> ca.SX:
        """Unknowns of an impact (n x 1)."""
        return ca.vertcat(self.struck.velocity, *self.struck.impulses, self.struck.loss)


def _loads(plant: Plant, channels: Sequence[ControlChannel]) -> dict[str, ca.SX]:
    """Loads of channels whose outputs depend on the acceleration."""
    none, wide = ca.SX(0, 1), ca.SX(plant.v.size1(), 0)
    gains = (ca.SX(one.size, 1) if one.derivative_gain is None else one.derivative_gain for one in channels)
    return {
        "channel_sense": ca.horzcat(wide, *(one.sense for one in channels)),
        "channel_drive": ca.horzcat(wide, *(one.drive for one in channels)),
        "command": ca.vertcat(none, *(one.command for one in channels)),
        "gain": ca.vertcat(none, *gains),
    }


@dataclass(frozen=True)
class DynamicsConditions:
    """Numeric values of :attr:`DynamicsUnknowns.loads` at one mechanical state."""

    state: MechanicalState
    loads: Mapping[str, Array]

    def mobility(self, rows: Array, columns: Array) -> Array:
        """Acceleration along loads ``rows`` (nv, m) that loads ``columns`` (nv, n) cause (m, n)."""
        product: Array = rows.T @ np.linalg.solve(self.state.inertia, columns)
        return product

    def kept_still(self, name: str, size: int) -> Array:
        """Forces (size,) that cancel the effect of a commanded torque on the tips' feedback."""
        sense, drive = self.loads[f"{name}_sense"], self.loads[f"{name}_drive"]
        right = self.mobility(sense, self.loads[name])
        matrix = self.mobility(sense, drive) + np.diag(self.loads[f"{name}_idle"][:, 0])
        force = np.linalg.solve(matrix, right)
        return np.asarray(force[:size, 0], dtype=float)

    def solve(self, effort: Array, *, outputs: bool) -> tuple[Array, Array, Array]:
        """Outputs of implicit channels (if ``outputs``), reactions and v' under loads ``effort`` (nv,)."""
        free, held = self.state.free_acceleration(effort), self.loads["held"]
        chosen = slice(None if outputs else 0)
        sense, drive = self.loads["channel_sense"][:, chosen], self.loads["channel_drive"][:, chosen]
        gain, command = self.loads["gain"][chosen, 0], self.loads["command"][chosen, 0]
        unknown = np.hstack([drive, held])
        if not unknown.size:
            return np.empty(0), np.empty(0), free
        caused = np.linalg.solve(self.state.inertia, unknown)
        nu = len(gain)
        matrix = np.vstack([gain[:, None] * (sense.T @ caused), held.T @ caused])
        matrix[:nu, :nu] += np.eye(nu)
        matrix[nu:, nu:] += np.diag(self.loads["idle"][:, 0])
        right = np.concatenate(
            [command - gain * (sense.T @ free), -self.loads["drift"][:, 0] - held.T @ free]
        )
        solution = np.linalg.solve(matrix, right)
        return solution[:nu], solution[nu:], free + caused @ solution

    def strike(self, count: int) -> Array:
        """Velocity after a plastic impact, impulses along the first ``count`` directions, and loss.

        The result has shape (nv + count + 1,). The impact obeys ``M (v+ - v-) = G^T j`` with ``G v+ = 0``;
        see :func:`spacerobot.closedloop.impulse.strike`.
        """
        held, slip = self.loads["held"], self.loads["slip"][:, 0]
        caused = np.linalg.solve(self.state.inertia, held)
        impulse = np.linalg.solve(held.T @ caused + np.diag(self.loads["idle"][:, 0]), -slip)
        velocity = self.state.v + caused @ impulse
        loss = -impulse @ (0.5 * slip + self.loads["imposed"][:, 0])
        return np.concatenate([velocity, impulse[:count], [loss]])
