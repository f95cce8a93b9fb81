"""An implicit adaptive integrator for stiff scenes: SUNDIALS' CVODES through CasADi."""

from __future__ import annotations

import time

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.rollout.closure import unclosed
from spacerobot.rollout.grid import INWARD, time_grid
from spacerobot.rollout.protocol import Array, ClosedLoopFunctions
from spacerobot.rollout.trajectory import Status, Trajectory, frozen


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
        grasp does not close. Its ``steps`` and ``step_s`` are zero and NaN, since they vary.
    """
    begin, grid = time.perf_counter(), time_grid(duration_s, output_step_s, output_step_s)
    p = np.array(loop.parameter_values if parameters is None else parameters, dtype=float)
    x, c = (part.full().ravel() for part in loop.setup(p))
    cause = unclosed(dict(zip(loop.max_gaps, loop.gaps(p).full().ravel(), strict=True)), loop.max_gaps)
    advance = _integrator(loop, grid.step_s, relative, absolute)
    states = [x]
    for start_s in grid.time[: 0 if cause else -1]:
        try:
            x = advance(x0=states[-1], p=np.concatenate([[start_s], c]))["xf"].full().ravel()
        except RuntimeError:  # what CasADi raises where CVODES gives up
            break
        if not np.isfinite(x).all():
            break
        states.append(loop.normalise(x).full().ravel())
    state, instants = np.array(states), grid.time[: len(states)]
    status: Status = "completed" if len(states) == grid.intervals + 1 else "diverged"
    status = "unclosed" if cause else status
    return Trajectory(
        time=frozen(instants),
        state=frozen(state),
        outputs=_outputs(loop, instants - INWARD * grid.step_s, state, c),
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


def _integrator(
    loop: ClosedLoopFunctions, interval_s: float, relative: float, absolute: float
) -> ca.Function:
    """Integrator over one sample interval; its parameters are the time at which that begins, and c."""
    nx, nc = loop.setup.numel_out(0), loop.setup.numel_out(1)
    t, x, start, c = ca.SX.sym("t"), ca.SX.sym("x", nx), ca.SX.sym("start"), ca.SX.sym("c", nc)
    # CVODES steps past the end and interpolates; a reference that ends there must not be seen from behind it
    inside = ca.fmin(ca.fmax(t, INWARD * interval_s), (1 - INWARD) * interval_s)
    dae = {"t": t, "x": x, "p": ca.vertcat(start, c), "ode": loop.dynamics(start + inside, x, c)}
    options = {"reltol": relative, "abstol": absolute, "max_num_steps": 100_000, "show_eval_warnings": False}
    return ca.integrator("advance", "cvodes", dae, 0.0, interval_s, options)


def _outputs(loop: ClosedLoopFunctions, instants: Array, state: Array, c: Array) -> dict[str, Array]:
    found = loop.outputs.call([ca.DM(instants).T, ca.DM(state).T, ca.DM(c)])
    return {name: frozen(y.full().T) for name, y in zip(loop.outputs.name_out(), found, strict=True)}
