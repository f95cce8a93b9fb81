"""Dockings whose events are located, against the same with their events at fixed times."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from benchmarks.row import Row
from benchmarks.timing import paired
from spacerobot.closedloop import ClosedLoop, build_closed_loop
from spacerobot.rollout import BatchEvents, Rollout, build_rollout
from spacerobot.scene import load_scene

STEP, COUNT, MOST = 0.01, 32, 1.5
VARIED = "target.links.body.mass"


def row() -> Row:
    """A batch of the shipped docking against one that switches, by jumps, where the nominal one does."""
    scene = load_scene("docking")
    loop, duration_s = build_closed_loop(scene), scene.scenario.simulation.duration
    located = _rollout(loop, duration_s)
    mass = located.values()[located.indices([VARIED])[0]]
    values = mass * np.linspace(0.98, 1.02, COUNT)[:, None]
    nominal = located.batch((VARIED,), [[mass]], states=True)
    ended = np.nan_to_num(nominal.events.ended_at_s[0], nan=duration_s)
    samples = int(np.isfinite(nominal.state[0, :, 0]).sum())
    fixed = _rollout(_fixed(loop, nominal.events, nominal.state[0, samples - 1]), float(ended))
    times = paired(
        lambda: located.batch((VARIED,), values, threads=1),
        lambda: fixed.batch((VARIED,), values, threads=1),
        calls=(1, 1),
    )
    ratio = times.first_s / times.second_s
    return Row(
        f"a batch of {COUNT} dockings with {nominal.events.count[0]} events each",
        "the same, switched at fixed times",
        f"{times.first_s / COUNT * 1e3:.1f} ms",
        f"{times.second_s / COUNT * 1e3:.1f} ms",
        ratio,
        f"at most {MOST:g} times",
        ratio <= MOST,
        f"tanaka6 at {STEP * 1e3:g} ms, one thread, {ended:.4g} s",
    )


def _rollout(loop: ClosedLoop, duration_s: float) -> Rollout:
    return build_rollout(loop, duration_s=duration_s, step_s=STEP, output_step_s=duration_s / 50, many=True)


def _fixed(loop: ClosedLoop, events: BatchEvents, last: np.ndarray) -> ClosedLoop:
    """The closed loop with its switches thrown at given times, and its memory as it was at the end."""
    count = int(events.count[0])
    nc = loop.setup.numel_out(1)
    t, x, c = ca.SX.sym("t"), ca.SX.sym("x", loop.nx), ca.SX.sym("c", nc + count)
    inner = ca.SX(c[:nc])
    for k, event in enumerate(events.event[0, :count]):
        for place, on in loop.events[event].sets:
            switch = loop.switches[place]
            inner[switch] = ca.if_else(t < c[nc + k], inner[switch], float(on))
    p = ca.SX.sym("p", len(loop.parameter_paths))
    x0, c0 = loop.setup(p)
    rates = loop.dynamics(t, x, inner)
    kept = [i for i in range(loop.nx) if ca.SX(rates[i]).is_zero()]
    x0[kept] = last[kept]
    at = {"t": t, "x": x, "c": c}
    outputs = loop.outputs(t, x, inner)
    return replace(
        loop,
        setup=ca.Function("setup", [p], [x0, ca.vertcat(c0, events.time_s[0, :count])], ["p"], ["x0", "c"]),
        dynamics=ca.Function("dynamics", [*at.values()], [rates], [*at], ["xdot"]),
        outputs=ca.Function("outputs", [*at.values()], outputs, [*at], loop.outputs.name_out()),
        jumps=(*loop.jumps, *range(nc, nc + count)),
        switches=(),
        events=(),
        fine=(),
    )
