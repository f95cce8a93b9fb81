"""An implicit adaptive integrator for stiff scenes: SUNDIALS' CVODES through CasADi."""

from __future__ import annotations

import contextlib
import re
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.rollout.closed_loop_protocol import Array, ClosedLoopFunctions
from spacerobot.rollout.initial_gaps import unclosed
from spacerobot.rollout.segments import Segment, segments
from spacerobot.rollout.tables import fill
from spacerobot.rollout.time_grid import TimeGrid, time_grid
from spacerobot.rollout.trajectory import Status, Trajectory, frozen

MOST_STEPS = 100_000
"""Of one segment."""
REASONS = {
    "CV_TOO_MUCH_WORK": f"more than {MOST_STEPS} steps to the next sample",
    "CV_TOO_MUCH_ACC": "the tolerance is below rounding",
    "CV_ERR_FAILURE": "no step is short enough for the tolerance",
    "CV_CONV_FAILURE": "its implicit equations cannot be solved, however short the step",
}
NO_NUMBER = "the dynamics give no finite number"


def integrate_cvodes(
    loop: ClosedLoopFunctions,
    *,
    duration_s: float,
    output_step_s: float,
    parameters: npt.ArrayLike | None = None,
    relative: float = 1e-9,
    absolute: float = 1e-10,
) -> Trajectory:
    """One rollout by a variable-order implicit method, interpreted; unit vectors are renewed at every sample.

    Parameters
    ----------
    loop
        The closed loop.
    duration_s, output_step_s
        Duration and longest time between samples.
    parameters
        All parameter values in order; nominal if None.
    relative, absolute
        Local error tolerances.

    Returns
    -------
    Trajectory
        Cut short with status ``diverged`` where the integrator gave up, ``unclosed`` where a
        grasp does not close; its cause says why. Its ``steps`` and ``step_s`` are zero and NaN, since
        they vary.
    """
    begin, grid = time.perf_counter(), time_grid(duration_s, output_step_s, output_step_s)
    p = np.array(loop.parameter_values if parameters is None else parameters, dtype=float)
    x, c = (part.full().ravel() for part in loop.setup(p))
    cause = unclosed(dict(zip(loop.max_gaps, loop.gaps(p).full().ravel(), strict=True)), loop.max_gaps)
    status: Status = "unclosed" if cause else "completed"
    found = [(x, c)] if cause else []
    if not cause:
        try:
            for sample in _samples(loop, _integrator(loop, relative, absolute), grid, x, c):
                found.append(sample)  # one by one: they are kept where it gives up
        except _GaveUpError as fault:
            status, cause = "diverged", str(fault)
    states, sides = zip(*found, strict=True)
    state, instants = np.array(states), grid.time[: len(states)]
    values = loop.outputs.call([ca.DM(instants).T, ca.DM(state).T, ca.DM(np.array(sides)).T])
    outputs = {name: frozen(y.full().T) for name, y in zip(loop.outputs.name_out(), values, strict=True)}
    return Trajectory(
        time=frozen(instants),
        state=frozen(state),
        outputs=outputs,
        measures={},
        costs={},
        status=status,
        diverged_at_s=None if status == "completed" else float(instants[-1]),
        steps=0,
        step_s=float("nan"),
        backend="cvodes",
        wall_s=time.perf_counter() - begin,
        cause=cause,
    )


def _samples(
    loop: ClosedLoopFunctions, advance: ca.Function, grid: TimeGrid, x: Array, c: Array
) -> Iterator[tuple[Array, Array]]:
    """State and constants at each sample; raises where the integrator gives up."""
    jumps, times = list(loop.jumps), c[list(loop.jumps)]
    c[jumps] = np.where(times <= 0, -np.inf, np.inf)
    _show(loop, 0.0, x, c)
    yield x, c.copy()
    for part in segments(grid, times):
        if part.first >= 0:
            c[jumps[part.first]] = -np.inf
            _show(loop, part.begin_s, x, c)
        x = loop.normalise(_carried(advance, x, part, c)).full().ravel()
        if part.samples:
            yield x, c.copy()


def _show(loop: ClosedLoopFunctions, t: float, x: Array, c: Array) -> None:
    """Let windows into tables show what holds from here on."""
    if loop.tables:
        fill(loop.tables, loop.rows(t, x, c).full().ravel().astype(np.int64), c)


class _GaveUpError(Exception):
    """The integrator did; in words why."""


def _carried(advance: ca.Function, x: Array, part: Segment, c: Array) -> Array:
    """State at the end of a segment."""
    if part.end_s == part.begin_s:
        return x
    given, listener = np.concatenate([[part.begin_s, part.end_s - part.begin_s], c]), _Listener(sys.stderr)
    try:
        with contextlib.redirect_stderr(listener):
            end: Array = advance(x0=x, p=given)["xf"].full().ravel()
    except RuntimeError as fault:  # what CasADi raises where CVODES gives up
        if "KeyboardInterrupt" in listener.said:  # and where Ctrl-C came
            raise KeyboardInterrupt from None
        flag = re.search(r"CVode returned \"(\w+)\"", str(fault))
        name = flag[1] if flag else "no reason given"
        reason = REASONS.get(name, NO_NUMBER if "RHSFUNC" in name else "")
        raise _GaveUpError(
            f"CVODES gave up: {reason} ({name})" if reason else f"CVODES gave up: {name}"
        ) from None
    if not np.isfinite(end).all():
        raise _GaveUpError(f"CVODES: {NO_NUMBER}")
    return end


class _Listener:
    """Standard error, but for what this thread writes: CasADi's words on what its integrator meets."""

    def __init__(self, behind: Any) -> None:
        self.said, self._behind, self._thread = "", behind, threading.get_ident()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._behind, name)

    def write(self, text: str) -> int:
        """Keep what this thread writes; what another does, a spinner's, is written."""
        if threading.get_ident() != self._thread:
            return int(self._behind.write(text))
        self.said += text
        return len(text)


def _integrator(loop: ClosedLoopFunctions, relative: float, absolute: float) -> ca.Function:
    """Integrator over one segment; its parameters are where that begins, its length, and c."""
    nx, nc = loop.setup.numel_out(0), loop.setup.numel_out(1)
    part, x, c = ca.SX.sym("part"), ca.SX.sym("x", nx), ca.SX.sym("c", nc)
    begin, length = ca.SX.sym("begin"), ca.SX.sym("length")
    rate = length * loop.dynamics(begin + length * part, x, c)
    dae = {"t": part, "x": x, "p": ca.vertcat(begin, length, c), "ode": rate}
    options = {
        "reltol": relative,
        "abstol": absolute,
        "max_num_steps": MOST_STEPS,
        "show_eval_warnings": False,
    }
    options["disable_internal_warnings"] = True  # why it gives up is in the status
    return ca.integrator("advance", "cvodes", dae, 0.0, 1.0, options)
