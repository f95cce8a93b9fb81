"""Gradient of a docking through events, and dockings with located events against events at fixed times."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from benchmarks.table_row import Row, at_most
from benchmarks.timing import paired
from spacerobot.closedloop import ClosedLoop, build_closed_loop
from spacerobot.common.errors import DivergedError
from spacerobot.rollout import Measures, Rollout, Signals, Trajectory, build_rollout, final
from spacerobot.scene import load_scene

STEP, COUNT, MOST, MOST_ROLLOUTS = 0.01, 32, 1.5, 6
VARIED = "target.links.body.mass"


def rows() -> list[Row]:
    """Row of a batch against one with events at fixed times, and row of a gradient against a rollout."""
    # gradient through events, two of them coincident, against a rollout
    scene, duration_s = load_scene("docking"), 20.0
    loop = build_closed_loop(scene)
    signals = Signals.of(loop)
    measures = Measures(signals, {"end": final(signals.x)}, lambda r, _: {"end": ca.sumsqr(r["end"])})
    rollout = _rollout(loop, duration_s, measures=measures, many=False)
    wrt = [path for path in loop.parameter_paths if ".pid." in path or ".capture." in path]
    status = rollout.value_and_gradient(wrt=wrt).status[0]
    times = paired(rollout.run, lambda: rollout.value_and_gradient(wrt=wrt, accuracy=False))
    alone = paired(rollout.run, lambda: rollout.value_and_gradient(wrt=wrt, orders=False))
    gradient = Row(
        f"adjoint gradient of a docking, {len(wrt)} parameters, both orders of what coincides",
        "one compiled rollout",
        f"{times.second_s * 1e3:.1f} ms",
        f"{times.first_s * 1e3:.1f} ms",
        times.ratio,
        f"at most {MOST_ROLLOUTS} rollouts",
        times.ratio <= MOST_ROLLOUTS and status == "exact",
        f"{alone.ratio:.2f} with one order; status: {status}",
        {"one_order_ratio": alone.ratio},
    )
    # batch of the shipped docking against one that switches by jumps at the events of the nominal rollout
    duration_s = scene.scenario.simulation.duration
    located = _rollout(loop, duration_s)
    mass = located.values()[located.indices([VARIED])[0]]
    values = mass * np.linspace(0.98, 1.02, COUNT)[:, None]
    nominal = located.run()
    end_s = nominal.ended_at_s or duration_s
    fixed = _rollout(_fixed(loop, nominal), end_s)
    batch = fixed.batch((VARIED,), values, threads=1)
    if np.isfinite(batch.diverged_at_s).any():
        raise DivergedError("a docking with events at fixed times diverges")
    times = paired(
        lambda: located.batch((VARIED,), values, threads=1),
        lambda: fixed.batch((VARIED,), values, threads=1),
    )
    what = f"a batch of {COUNT} dockings with about {len(nominal.events)} events each"
    note = f"tanaka6 at {STEP * 1e3:g} ms, one thread, {end_s:.4g} s"
    names = what, "the same, switched at fixed times"
    return [at_most(MOST, names, times, note, count=COUNT), gradient]


def _rollout(
    loop: ClosedLoop, duration_s: float, *, measures: Measures | None = None, many: bool = True
) -> Rollout:
    times = {"duration_s": duration_s, "step_s": STEP, "output_step_s": duration_s / 50}
    return build_rollout(loop, **times, measures=measures, many=many)


def _fixed(loop: ClosedLoop, nominal: Trajectory) -> ClosedLoop:
    """Closed loop whose switches and discrete states jump to their nominal values at the nominal times."""
    count, nc = len(nominal.events), loop.setup.numel_out(1)
    t, x, c = ca.SX.sym("t"), ca.SX.sym("x", loop.nx), ca.SX.sym("c", nc + count)
    state, inner = ca.SX(x), ca.SX(c[:nc])
    rates = ca.SX(loop.dynamics(t, x, inner))
    memory, switches = [i for i in range(loop.nx) if rates[i].is_zero()], list(loop.switches)
    for k, event in enumerate(nominal.events):
        ahead = t < c[nc + k]
        state[memory] = ca.if_else(ahead, state[memory], event.after[memory])
        inner[switches] = ca.if_else(ahead, inner[switches], event.switches)
    p = ca.SX.sym("p", len(loop.parameter_paths))
    x0, c0 = loop.setup(p)
    instants = np.array([event.time_s for event in nominal.events])
    at, rates = {"t": t, "x": x, "c": c}, loop.dynamics(t, state, inner)
    outputs = loop.outputs(t, state, inner)
    return replace(
        loop,
        setup=ca.Function("setup", [p], [x0, ca.vertcat(c0, instants)], ["p"], ["x0", "c"]),
        dynamics=ca.Function("dynamics", [*at.values()], [rates], [*at], ["xdot"]),
        outputs=ca.Function("outputs", [*at.values()], outputs, [*at], loop.outputs.name_out()),
        jumps=(*loop.jumps, *range(nc, nc + count)),
        switches=(),
        events=(),
        fine=(),
    )
