"""Closed loop whose rollouts start at any time, in any state, with any switches."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.measures import Measures, final
from spacerobot.rollout.trajectory import Trajectory

SWITCHES = "switches"
"""Output of a resumed loop that holds its switches."""
BEGIN = "start.0"
"""Parameter of a resumed loop: its start time [s]."""
STATE = "end.state"
"""Measure of a piece: state and switches at its end."""


def resumed(loop: Any) -> Any:
    """Closed loop with time, state and switches at the start as additional parameters, after its own.

    Rollouts count time from their start; time-dependent laws receive the absolute time. The switches are an
    additional output.

    Args:
        loop: Closed loop, a data class with the members of
            :class:`spacerobot.rollout.closed_loop_protocol.ClosedLoopFunctions`.
    """
    nx, np_ = loop.nq + loop.nv + loop.nz, len(loop.parameter_paths)
    switches, jumps = list(loop.switches), list(loop.jumps)
    p, start = ca.SX.sym("p", np_), ca.SX.sym("start", 1 + nx + len(switches))
    begin, x0 = start[0], start[1 : 1 + nx]
    c = loop.setup(p)[1]
    for k, place in enumerate(switches):
        c[place] = start[1 + nx + k]
    for place in jumps:
        c[place] -= begin
    t, x, xdot, e = ca.SX.sym("t"), ca.SX.sym("x", nx), ca.SX.sym("xdot", nx), ca.SX.sym("e")
    shifted_constants = ca.SX.sym("c", c.numel() + 1)
    # Constants as the loop has them, with its jumps in the time of the whole.
    constants = shifted_constants[:-1]
    for place in jumps:
        constants[place] += shifted_constants[-1]
    at = (t + shifted_constants[-1], x, constants)
    arguments, names = [t, x, shifted_constants], ["t", "x", "c"]
    return dataclasses.replace(
        loop,
        parameter_paths=(*loop.parameter_paths, *(f"start.{i}" for i in range(start.numel()))),
        parameter_values=np.concatenate([loop.parameter_values, start_of(loop)]),
        setup=ca.Function("setup", [ca.vertcat(p, start)], [x0, ca.vertcat(c, begin)], ["p"], ["x0", "c"]),
        dynamics=ca.Function("dynamics", arguments, [loop.dynamics(*at)], names, ["xdot"]),
        outputs=ca.Function(
            "outputs",
            arguments,
            [
                *_all(loop.outputs, at),
                ca.vertcat(ca.SX(0, 1), *(shifted_constants[place] for place in switches)),
            ],
            names,
            [*loop.outputs.name_out(), SWITCHES],
        ),
        gaps=ca.Function("gaps", [ca.vertcat(p, start)], [ca.SX(loop.gaps(p))], ["p"], ["gap"]),
        guards=ca.Function(
            "guards",
            [*arguments, xdot],
            _all(loop.guards, (*at, xdot)),
            [*names, "xdot"],
            loop.guards.name_out(),
        ),
        rows=ca.Function("rows", arguments, [loop.rows(*at)], names, ["row"]),
        update=ca.Function("update", [*arguments, e], [loop.update(*at, e)], [*names, "e"], ["x_after"]),
    )


def resumed_measures(loop: Any, measures: Measures) -> Measures:
    """Measures of one piece of a resumed rollout, and its state and switches at the end.

    Args:
        loop: The original loop.
        measures: Measures over its signals, in absolute time.
    """
    signals, begin, switches = measures.signals, ca.SX.sym(BEGIN), ca.SX.sym(SWITCHES, len(loop.switches))
    resumed_signals = dataclasses.replace(
        signals,
        outputs={**signals.outputs, SWITCHES: switches},
        parameters={**signals.parameters, BEGIN: begin},
    )
    # a resumed loop counts time from its start
    shifted_measures = {
        name: dataclasses.replace(
            measure, expression=ca.substitute(measure.expression, signals.t, signals.t + begin)
        )
        for name, measure in measures.named.items()
    }
    shifted_measures[STATE] = final(ca.vertcat(signals.x, switches))
    return Measures(resumed_signals, shifted_measures, costs=lambda _r, _p: {})


def start_of(loop: Any) -> Array:
    """Start of a loop by itself: time 0, its initial state, its switches."""
    x0, c = (value.full().ravel() for value in loop.setup(loop.parameter_values))
    return np.concatenate([[0.0], x0, c[list(loop.switches)]])


def end_of(trajectory: Trajectory, start: Array) -> Array:
    """End of a rollout of a resumed loop, as the start of the next one."""
    switches = trajectory.outputs[SWITCHES][-1]
    return np.concatenate([[start[0] + trajectory.time[-1]], trajectory.state[-1], switches])


def joined(pieces: Sequence[tuple[float, Trajectory]]) -> Trajectory:
    """Rollouts one after the other as one, each with the time [s] at which it began."""
    first, last = pieces[0][1], pieces[-1][1]

    def together(values: Sequence[Array]) -> Array:
        """Concatenated samples of all pieces; at a boundary the last sample of the earlier piece is used."""
        return np.concatenate([values[0], *(value[1:] for value in values[1:])])

    ended = last.ended_at_s
    return dataclasses.replace(
        last,
        time=together([begin + piece.time for begin, piece in pieces]),
        state=together([piece.state for _, piece in pieces]),
        outputs={name: together([piece.outputs[name] for _, piece in pieces]) for name in first.outputs},
        diverged_at_s=None if last.diverged_at_s is None else pieces[-1][0] + last.diverged_at_s,
        steps=sum(piece.steps for _, piece in pieces),
        wall_s=sum(piece.wall_s for _, piece in pieces),
        step_error=float(np.max([piece.step_error for _, piece in pieces])),
        events=tuple(
            dataclasses.replace(event, time_s=begin + event.time_s)
            for begin, piece in pieces
            for event in piece.events
        ),
        ended_at_s=None if ended is None else pieces[-1][0] + ended,
    )


def _all(function: ca.Function, arguments: Sequence[ca.SX]) -> list[ca.SX]:
    results = function(*arguments)
    return list(results) if isinstance(results, tuple) else [results]
