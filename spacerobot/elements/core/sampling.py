r"""Periodic controllers: the law is evaluated at instants, and its torques are held between them.

A controller of any kind is built as a continuous one and then made discrete. At each instant $t_k = k T$ its
law is evaluated once, with the states $z_k$ of the controller:

$$ u_k = u(t_k, x_k, z_k), \qquad z_{k+1} = z_k + T\,\varphi(T A)\,f(t_k, x_k, z_k), \qquad
   \varphi(a) = \frac{e^a - 1}{a}, $$

where $\dot z = f$, and $A$ is the coefficient of each state in its own rate, or zero if that coefficient
depends on the state. With inputs held over the period this is exact for integrals, leaks and lags (the
step-invariant transform); for other states it is Euler's rule.

An ideal derivative stays ideal: at the instant $u_k$ is solved together with the acceleration that it
causes, by the model, as in continuous time. (A backward difference would feed the acceleration back a
period late: on a mass $m$, $v_{k+1} - v_k = -(K_d / m)(v_k - v_{k-1})$, which diverges for any period if
$K_d > m$.) A controller without a model uses ``derivative: filtered``.

What is held are generalized forces: a tip's controller computes $u_k$ at its tip, maps it to joint torques
by the Jacobian of the instant, $\tau_k = J(q_k)^\top u_k$, and holds $\tau_k$ although the posture changes.
The torques pass the limit, the rate limit, the quantisation and the delay, in this order, so that the rate
limit starts from the limit, not from a command beyond it. Rounding may exceed the limit by half a step: what
is rounded is limited again. A shift register takes each sample at its instant, and a second clock, later by
the delay, puts it into effect. Torques in the null space of tips are held before their projection, which
follows the posture.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
from pydantic import Field

from spacerobot.common.section import quantity
from spacerobot.elements.core.clock import Clock, DelayLine, PeriodicSection
from spacerobot.elements.core.contribution import (
    CommandedTorque,
    Contribution,
    SampledLaw,
    State,
    memory,
)
from spacerobot.elements.core.section_context import SectionContext


class Sampling(PeriodicSection):
    """Periodic evaluation of a controller; its output is held between two instants."""

    limit: float | None = quantity("N m or N", "largest output of each component", default=None, gt=0)
    rate_limit: float | None = quantity(
        "N m/s or N/s",
        "largest rate of change of each output, from one instant to the next",
        default=None,
        gt=0,
    )
    resolution: float = quantity("N m or N", "step of outputs; 0: any", default=0.0, ge=0)

    def words(self) -> str:
        """Sampling rate and delay."""
        return f"at {1 / self.period:g} Hz" + (f", {self.delay:g} s late" if self.delay else "")


SAMPLED = Field(
    default=None,
    description="evaluate the law periodically and hold its output: `period`, and `delay`, `limit`, "
    "`rate_limit`, `resolution` of the output; continuous if not given",
)


def periodic(config: Sampling, context: SectionContext, name: str, continuous: Contribution) -> Contribution:
    """Contribution of a controller that is evaluated periodically, from its continuous one.

    Args:
        config: Period and delay of the samples.
        context: Time, and the numbers of the section ``sampled``.
        name: Name of the controller, unique in the closed loop: ``rpr1/tip/pid``.
        continuous: Contribution of the continuous law.

    Raises:
        ScenarioError: If a phase changes the period or the delay.
    """
    period = context.steady("period")
    clock = Clock.of(f"{name}.samples", context.time, period)
    states = [replace(one, derivative=ca.SX.zeros(one.symbol.size1())) for one in continuous.states]
    updates = {one.name: _advanced(one, period) for one in continuous.states if not one.remembers}
    solved = {
        i: ca.SX.sym(f"{name}.output{i}", channel.size)
        for i, channel in enumerate(continuous.channels)
        if channel.derivative_gain is not None
    }
    outputs = (solved.get(i, channel.command) for i, channel in enumerate(continuous.channels))
    forces = [
        ca.mtimes(channel.actuation, u) for channel, u in zip(continuous.channels, outputs, strict=True)
    ]
    torques_by_space: dict[bool, list[ca.SX]] = {False: forces, True: []}
    for torque in continuous.torques:
        torques_by_space[torque.null_space].append(torque.value)
    torques, events = [], []
    # commanded generalized forces of the channels
    names = [channel.robot for channel in continuous.channels]
    robot = [*names, *(torque.robot for torque in continuous.torques), ""][0]
    for null_space, parts in torques_by_space.items():
        commanded = sum(parts[1:], parts[0]) if parts else ca.SX(0, 1)
        rows = sorted(set(commanded.sparsity().row()))
        if not rows:
            continue
        law_name = f"{name}.null_space" if null_space else name
        held_forces = memory(f"{law_name}.held", ca.SX.zeros(len(rows)))
        # output (n x 1) after limits and quantisation, and the states of the limits
        value = commanded[rows]
        last_values = []
        limit = None if config.limit is None else context.number("limit")
        if limit is not None:
            value = ca.fmin(ca.fmax(value, -limit), limit)
        if config.rate_limit is not None:
            last = memory(f"{law_name}.last", ca.SX.zeros(value.size1()))
            step = context.number("rate_limit") * period
            value = ca.fmin(ca.fmax(value, last.symbol - step), last.symbol + step)
            last_values.append(last)
        if not context.is_zero("resolution"):
            step = context.number("resolution")
            value = step * ca.floor(value / step + 0.5)
            if limit is not None:
                value = ca.fmin(ca.fmax(value, -limit), limit)
        states += [*last_values, held_forces]
        updates |= {state.name: value for state in last_values}
        if context.is_zero("delay"):
            updates[held_forces.name] = value
        else:
            line = DelayLine.of(law_name, context, clock, held_forces, config.delay / config.period)
            states += line.states
            updates |= line.shifted(value)
            events.append(line.event("acts"))
        all_forces = ca.SX(commanded.size1(), 1)
        all_forces[rows] = held_forces.symbol
        torques.append(CommandedTorque(robot, all_forces, null_space))
    # samples before delayed outputs, so that a delay of whole periods outputs the sample of the same
    # instant
    tick = clock.event(
        f"{name}.sampled", "sampled", name, updates, silent=True, quantised=not context.is_zero("resolution")
    )
    laws = []
    if solved:
        ideal = tuple(continuous.channels[i] for i in solved)
        acts = next(torque.value for torque in torques if not torque.null_space)
        group = f"{robot} every {config.period!r} s"
        laws.append(SampledLaw(tick.name, ideal, ca.vertcat(*solved.values()), acts, group))
    return replace(
        continuous,
        states=(*states, clock.count),
        torques=tuple(torques),
        # channels without a command still define the tips that the null space must leave alone
        channels=tuple(
            replace(channel, command=ca.SX(channel.size, 1), derivative_gain=None)
            for channel in continuous.channels
        ),
        sampled=tuple(laws),
        events=(*continuous.events, tick, *events),
    )


def _advanced(state: State, period: ca.SX) -> ca.SX:
    """A state of the controller at the next instant (n x 1); see above."""
    rates, advanced = ca.jacobian(state.derivative, state.symbol), []
    for i in range(state.symbol.size1()):
        pole = rates[i, i]
        factor = ca.SX(1)
        if rates[i, i].nnz() and not ca.depends_on(pole, state.symbol):
            a = pole * period
            small = ca.fabs(a) < 1e-8
            factor = ca.if_else(small, 1 + a / 2, ca.expm1(a) / ca.if_else(small, 1, a))
        advanced.append(state.symbol[i] + period * factor * state.derivative[i])
    return ca.vertcat(*advanced)
