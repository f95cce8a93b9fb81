"""The sweep back of the interpreted adjoint, step by step."""

from __future__ import annotations

from typing import Any

import numpy as np

from spacerobot.numeric_function import NumericFunction
from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.coincident_events import Occurrence, SweepNotes
from spacerobot.rollout.interpreted import DiscreteTrajectory
from spacerobot.rollout.interpreted_event import InterpretedEvent
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.rollout_arrays import ENDED, CoincidentInstants
from spacerobot.rollout.segments import HERE
from spacerobot.rollout.tables import Integers, gather


class AdjointSweep:
    """Bars of one rollout, from its end to its beginning.

    Parameters
    ----------
    kernel
        With the reverse functions.
    path
        The rollout.
    instants
        Where instants at which several things happened are told, if at all.
    """

    def __init__(
        self, kernel: Kernel, path: DiscreteTrajectory, instants: CoincidentInstants | None = None
    ) -> None:
        self._kernel, self._path = kernel, path
        self._f = {name: NumericFunction(function) for name, function in kernel.functions.items()}
        self._happenings = list(path.happenings)
        self._x, self._c = np.empty(0), np.empty(0)
        self._begin = 0.0  # of the time of the event that began the segment
        self._notes = None if instants is None else SweepNotes(kernel, instants)

    def gradient(self, p: Array, seed: Array, r: Array) -> Array:
        """Gradient (k,) of the costs of parameters p (np,), weighted by a seed (nj,); r are the measures."""
        kernel, path, steps = self._kernel, self._path, self._path.plan.steps
        rbar, direct = self._f["objective_reverse"](r, p, seed)
        first, last = kernel.integrals, kernel.integrals + kernel.peaks
        at_end = (path.end_s, path.x[-1], path.c[-1], rbar[last:])
        self._x, self._c, tbar = self._reverse("final", path.rows[-1], *at_end)
        self._x[kernel.nx :] += rbar[:first]
        when = self._when = (
            path.m[:, : kernel.peaks].argmax(axis=0) if kernel.peaks else np.empty(0, dtype=int)
        )
        for k in range(steps, -1, -1):
            self._events(k + 1)
            t, h = self._step(k) if k < steps else (tbar, 0.0)
            if (when == k).any():
                # the peaks that were met before step k
                at = path.plan.t[k] if k < steps else path.end_s
                met = np.where(when == k, rbar[first:last], 0.0)
                x, c, moved = self._reverse("peaks", path.rows[k], at, path.x[k], path.c[k], met)
                self._x, self._c, t = self._x + x, self._c + c, t + moved
            if k < steps:
                # from the bars of the step's beginning and length to the ends of its segment
                share = (h + path.plan.index[k] * t) / path.plan.number[k]
                self._end(int(path.plan.first[k]), t - share)
                self._end(int(path.plan.last[k]), share)
            elif path.fate == ENDED:
                self._end(path.happenings[-1].first, t)
        self._events(0)
        if self._notes is not None:
            self._notes.close()
        found = self._f["setup_reverse"](p, self._x, self._c)[0] + direct
        return np.asarray(found, dtype=np.float64)

    def _note(self, thing: Occurrence, step: int) -> None:
        """Tell of a thing before a step."""
        if self._notes is not None:
            self._notes.note(thing, self._x, self._when == step)

    def _reverse(self, name: str, row: Integers, *arguments: Any) -> tuple[Array, Array, float]:
        """Bars of state, constants and time by the reverse of a function, where tables showed these rows."""
        x, seen, t = self._f[f"{name}_reverse"](*arguments)
        c = np.zeros(self._kernel.size("setup_reverse", "cbar"))
        c[: len(seen)] = seen
        gather(self._kernel.tables, row, self._kernel.c_bars, c)
        return x, c, float(t.sum())

    def _end(self, place: int, value: float) -> None:
        """Take in the bar of the time at which a segment begins or ends."""
        if place == HERE:
            self._begin += value
        elif place >= 0 and self._kernel.jump_bars[place] >= 0:
            self._c[self._kernel.jump_bars[place]] += value

    def _events(self, steps: int) -> None:
        """Through the events behind so many steps that fired at once."""
        while self._happenings and self._happenings[-1].steps == steps and not self._happenings[-1].located:
            here = self._happenings.pop()
            self._note(Occurrence(here.event, False, here.time_s, here.before, here.c), steps)
            self._end(here.first, self._update(here))

    def _update(self, here: InterpretedEvent) -> float:
        """Through what an event changed; bar of its time."""
        arguments = (here.time_s, here.before, here.c, here.event, self._x)
        self._x, c, tbar = self._reverse("update", here.row, *arguments)
        self._c = self._c + c
        return tbar

    def _step(self, k: int) -> tuple[float, float]:
        """Through step k, and the event at its end; bars of its beginning and length.

        The length of a step that ends at a guard's root follows from that; see ``loops/adjoint.hpp``.
        """
        steps = self._path.plan
        if not (len(self._path.cut) and self._path.cut[k]):
            if steps.last[k] >= 0 and steps.index[k] + 1 == steps.number[k]:
                t, x, c = steps.t[k] + steps.h[k], self._path.x[k + 1], self._path.c[k]
                self._note(Occurrence(-1 - int(steps.last[k]), True, t, x, c), k + 1)
            self._x, c, t, h = self._step_back(k, self._x)
            self._c = self._c + c
            return t, h
        here = self._happenings.pop() if self._happenings and self._happenings[-1].steps == k + 1 else None
        if here is not None:
            thing = Occurrence(here.event, True, here.time_s, here.before, self._path.c[k], here.near)
            self._note(thing, k + 1)
        end = 0.0 if here is None else self._update(here)
        end, self._begin = end + self._begin, 0.0
        self._x, c, t, h = self._step_back(k, self._x)
        self._c = self._c + c
        if here is not None:
            seed = np.eye(len(self._kernel.events))[here.event]
            arguments = (here.time_s, here.before, self._path.c[k], seed)
            x, guard_c, guard_t = self._reverse("guards", self._path.rows[k], *arguments)
            x, c, root_t, root_h = self._step_back(k, x)
            mu = -(h + end) / (guard_t + root_h)
            self._x, self._c = self._x + mu * x, self._c + mu * (c + guard_c)
            t += mu * (root_t + guard_t)
        return t + end, 0.0

    def _step_back(self, k: int, xbar: Array) -> tuple[Array, Array, float, float]:
        """Bars of a step's state, constants, beginning and length, from that of its end."""
        f, method, path = self._f, self._kernel.method, self._path
        t, h, c, x = path.plan.t[k], path.plan.h[k], path.c[k], path.x[k]
        times = t + h * np.array(method.nodes[: method.stages])
        stages: list[Array] = []
        slopes = np.zeros((0, len(x)))
        for s in range(method.stages):
            stages.append(x + h * method.a[s, :s] @ slopes)
            slopes = np.vstack([slopes, f["dynamics"](times[s], stages[s], c)[0]])
        sum_bar = f["normalise_reverse"](x + h * np.array(method.b) @ slopes, xbar)[0]
        cbar, tbar, hbar = np.zeros(self._kernel.size("setup_reverse", "cbar")), 0.0, 0.0
        back = sum_bar.copy()
        bars = np.zeros_like(slopes)
        for s in reversed(range(method.stages)):
            total = method.b[s] * sum_bar + method.a[: method.stages, s] @ bars
            bars[s], part, moved = self._reverse("dynamics", path.rows[k], times[s], stages[s], c, h * total)
            back, cbar = back + bars[s], cbar + part
            tbar, hbar = tbar + moved, hbar + total @ slopes[s] + method.nodes[s] * moved
        return back, cbar, tbar, float(hbar)
