"""Rollouts by CasADi's virtual machine: the same steps where there is no compiler."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import casadi as ca
import numpy as np

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.engines import CompiledEngine, StopFlag
from spacerobot.rollout.hybrid import HybridRun
from spacerobot.rollout.interpreted_event import InterpretedEvent
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.rollout_arrays import COMPLETED, DIVERGED, ENDED, RolloutArrays
from spacerobot.rollout.segments import StepPlan, plan
from spacerobot.rollout.tables import Integers, fill
from spacerobot.rollout.time_grid import TimeGrid

BLOCK = 64  # steps that CasADi's virtual machine does between two looks from Python


@dataclass(frozen=True)
class DiscreteTrajectory:
    """One rollout.

    Attributes
    ----------
    plan
        Its steps.
    c
        Prepared constants before each step and at the end, shape (K + 1, nc) or fewer rows after divergence.
    x
        States, likewise.
    m
        Peak quantities, likewise.
    error
        Estimate of each step's error in each state, shape (K, nx), zero if not asked for.
    done
        Good steps.
    rows
        Rows of tables before each step and at the end, shape (K + 1, cursors) or fewer after divergence.
    shown
        Constants that samples are seen with, one row for each sample that was reached.
    end_s
        Time of the last good state.
    fate
        How it ended.
    happenings, cut
        Events, and which steps were cut short, shape (K,) or empty.
    doubt
        Why derivatives may not hold, and at which event; zero where they do.
    """

    plan: StepPlan
    c: Array
    x: Array
    m: Array
    error: Array
    done: int
    rows: Integers
    shown: Array
    end_s: float
    fate: int
    happenings: tuple[InterpretedEvent, ...] = ()
    cut: Sequence[bool] = ()
    doubt: tuple[int, int] = (0, 0)

    @property
    def whole(self) -> bool:
        """Whether it came to its end."""
        return self.fate in (COMPLETED, ENDED)


@dataclass(frozen=True)
class InterpretedEngine:
    """One rollout after the other."""

    kernel: Kernel
    backend: str = field(default="interpreted", init=False)
    lanes: int = field(default=1, init=False)
    _made: dict[tuple[int, bool], ca.Function] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def rollouts(
        self, p: Array, grid: TimeGrid, raw: RolloutArrays, rows: Sequence[int], stop: StopFlag
    ) -> None:
        """Roll out every row of parameters (N, np) into ``raw``, recording outputs ``rows``."""
        for i, row in enumerate(p):
            if stop.is_set:
                return
            own = raw.part(slice(i, i + 1))
            path = self.path(row, grid, estimate=raw.error is not None, backwards=raw.backwards)
            at = path.plan.sampled[: len(path.shown)]
            seen = path.x[at]
            seen[0] = (
                self.kernel.functions["setup"](row)[0].full().ravel()
            )  # before what happens at the start
            if own.x is not None:
                own.x[0, : len(at)] = seen
            if own.y is not None:
                y = self.kernel.functions["outputs"](grid.time[None, : len(at)], seen.T, path.shown.T)
                own.y[0, : len(at)] = y.full().T[:, list(rows)]
            if own.error is not None:
                size = np.maximum(1.0, np.abs(path.x).max(axis=0))
                own.error[0] = (path.error.max(axis=0, initial=0.0) / size)[: self.kernel.nx].max()
            self.note(path, own)
            if path.whole:
                own.r[0] = self.reduce(path)
            own.cost[0] = self.kernel.functions["objective"](own.r[0], row).full().ravel()

    def path(
        self, p: Array, grid: TimeGrid, *, estimate: bool = False, backwards: bool = False
    ) -> DiscreteTrajectory:
        """One rollout, with its error estimated or zero, and the order of events at one instant."""
        kernel = self.kernel
        begin, c = (part.full().ravel() for part in kernel.functions["setup"](p))
        if kernel.events:
            noise = kernel.noise.drawn(p[None, :])[0]
            run = HybridRun(self, grid, begin, c, estimate, backwards, noise)
            run.run()
            last = kernel.functions["dynamics"](run.end_s, run.x, run.c)[1].full().ravel()
            return DiscreteTrajectory(
                plan=run.plan,
                c=np.array([*run.constants, run.c]),
                x=np.array([*run.states, run.x]),
                m=np.array([*run.peaks, last]),
                error=np.array(run.errors).reshape(-1, len(run.x)),
                done=len(run.rows),
                rows=np.array([*run.shown_rows, run.row], dtype=np.int64),
                shown=np.array(run.shown),
                end_s=run.end_s,
                fate=run.fate,
                happenings=tuple(run.happenings),
                cut=run.cut,
                doubt=run.doubt,
            )
        times = c[list(kernel.jumps)]
        steps = plan(grid, times, backwards=backwards)
        # constants before each step and at the end, with the side of each jump in its place
        sides = np.tile(c, (steps.steps + 1, 1))
        sides[:, list(kernel.jumps)] = np.where(times <= 0, -np.inf, np.inf)
        for k in steps.passes:
            sides[k:, kernel.jumps[steps.first[k]]] = -np.inf
        # rows of tables (K + 1, cursors) where jumps alone tell them; the constants then show them
        if not kernel.tables:
            rows = np.zeros((len(sides), 0), dtype=np.int64)
        else:
            rows = np.zeros((len(sides), kernel.size("rows", "row")), dtype=np.int64)
            for k in (0, *steps.passes):
                rows[k:] = kernel.functions["rows"](steps.t[k], begin, sides[k]).full().ravel()
                fill(kernel.tables, rows[k], sides[k:], kernel.c_slopes)
        # derivatives of each step's beginning and length along the direction of a sensitivity
        moves = np.array([0.0 if place < 0 else c[place] for place in (*kernel.jump_slopes, -1)])
        dh = (
            (moves[steps.last] - moves[steps.first]) / steps.number
            if len(moves) > 1
            else np.zeros(steps.steps)
        )
        dt = moves[steps.first] + steps.index * dh if len(moves) > 1 else dh
        states, peaks, errors, done = [begin[None, :]], [], [np.empty((0, len(begin)))], 0
        # first step and length of pieces in which no jump is passed
        cuts = np.unique(np.concatenate([[0], steps.passes, [steps.steps]]))
        blocks = [
            (int(k), int(min(BLOCK, end - k)))
            for begin, end in pairwise(cuts)
            for k in range(begin, end, BLOCK)
        ]
        for k, n in blocks:
            part = slice(k, k + n)
            inputs = (
                states[-1][-1],
                steps.t[None, part],
                steps.h[None, part],
                dt[None, part],
                dh[None, part],
            )
            found = self.steps(n, estimate)(*inputs, sides[k])
            path, m, error = (value.full().T for value in found[:3])
            with np.errstate(over="ignore", invalid="ignore"):
                good = np.sum(((path - begin) * kernel.scale) ** 2, axis=1) < 1  # false for a NaN as well
            first_bad = n if good.all() else int(np.argmin(good))
            done += first_bad
            states.append(path[:first_bad])
            peaks.append(m)
            errors.append(np.abs(error[:first_bad]))
            if first_bad < n:
                break
        x, c = np.concatenate(states), sides[: done + 1]
        last = kernel.functions["dynamics"](grid.time[-1], x[-1], c[-1])[1].full().T
        m, error = np.concatenate([*peaks, last])[: done + 1], np.concatenate(errors)
        at = steps.sampled[steps.sampled <= done]
        shown = c[np.maximum(at - 1, 0)]  # a sample on a jump shows what led up to it
        whole = done == steps.steps
        end_s = float(grid.time[-1] if whole else steps.t[done])
        fate = COMPLETED if whole else DIVERGED
        return DiscreteTrajectory(steps, c, x, m, error, done, rows[: done + 1], shown, end_s, fate)

    def note(self, path: DiscreteTrajectory, raw: RolloutArrays) -> None:
        """Write down how the only rollout of ``raw`` went, and its events."""
        raw.done[0], raw.reached[0], raw.fate[0] = path.done, path.end_s, path.fate
        rules, log = self.kernel.events, raw.log
        silent = [rule.silent or (rule.routine and log.jump is None) for rule in rules]
        told = [here for here in path.happenings if not silent[here.event]]
        log.fired[0], log.doubt[0] = len(told), path.doubt
        for k, here in enumerate(told[: log.event.shape[1]]):
            log.event[0, k], log.when[0, k] = here.event, here.time_s
            if log.jump is not None:
                log.jump[0, k] = here.before, here.after

    def reduce(self, path: DiscreteTrajectory) -> Array:
        """Measures r of a completed rollout."""
        x, c = path.x[-1], path.c[-1]
        e = self.kernel.functions["final"](path.end_s, x, c).full().ravel()
        # largest values of the first rows of m, and what goes along with them
        peaks = self.kernel.peaks
        if peaks == 0:
            winners = np.empty(0)
        else:
            when = path.m[:, :peaks].argmax(axis=0)
            winners = np.concatenate(
                [path.m[when, b + np.arange(peaks)] for b in range(0, path.m.shape[1], peaks)]
            )
        return np.concatenate([x[self.kernel.nx :], winners, e])

    def _combined(
        self, x: ca.MX, h: ca.MX, dh: ca.MX, weights: Sequence[float] | Array, slopes: Sequence[ca.MX]
    ) -> ca.MX:
        """State plus the step times a weighted sum of slopes."""
        used = [(w, k) for w, k in zip(weights, slopes, strict=False) if w != 0]
        if not used:
            return x
        total = x
        for w, k in used:
            total = total + h * float(w) * k
        if self.kernel.rate is None:
            return total
        n, m = self.kernel.nx // 2, self.kernel.integrals // 2
        plain = ca.MX(x.numel(), 1)
        for w, k in used:
            plain = plain + float(w) * k
        shear = [ca.MX(n, 1), plain[:n], ca.MX(m, 1), plain[2 * n : 2 * n + m]]
        return total + dh * ca.vertcat(*shear)

    def steps(self, n: int, estimate: bool) -> ca.Function:
        """So many steps with the same constants: states, peak quantities, errors, and what states inside add.

        These are coefficients of the powers 1 to 4 of the part of a step, four columns for each.
        """
        if (n, estimate) not in self._made:
            kernel, method = self.kernel, self.kernel.method
            nx, nc = kernel.scale.size, kernel.size("setup", "c")
            x, c = ca.MX.sym("x", nx), ca.MX.sym("c", nc)
            t, h, dt, dh = (ca.MX.sym(name) for name in ("t", "h", "dt", "dh"))
            slopes: list[ca.MX] = []
            peaks = ca.MX(kernel.size("dynamics", "m"), 1)
            for s in range(len(method.nodes) if estimate else method.stages):
                here = c
                if kernel.rate is not None:
                    here = ca.vertcat(c[: kernel.rate], dt + method.nodes[s] * dh)
                stage = self._combined(x, h, dh, method.a[s], slopes)
                slope, m = kernel.functions["dynamics"](t + method.nodes[s] * h, stage, here)
                slopes.append(slope)
                peaks = m if s == 0 else peaks
            end = kernel.functions["normalise"](self._combined(x, h, dh, method.b, slopes))
            error = ca.MX(nx, 1)
            for weight, slope in zip(method.error, slopes, strict=False):
                error = error + (h * weight * slope if estimate else 0)
            inside = ca.mtimes(h * ca.horzcat(*slopes[: method.stages]), ca.DM(method.dense))
            inner = inside if kernel.events else ca.MX(nx, 0)
            found = [ca.densify(value) for value in (end, peaks, error, inner)]
            self._made[n, estimate] = ca.Function("step", [x, t, h, dt, dh, c], found).mapaccum("steps", n)
        return self._made[n, estimate]


KernelEngine = CompiledEngine | InterpretedEngine
"""Evaluates a kernel."""
