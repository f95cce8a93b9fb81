"""Guards along one step: where they may turn above their levels, and where they rise there."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.methods.tableau import INNER
from spacerobot.rollout.time_grid import ROUNDING

UNSURE, WRONG, CHECK = 0.01, 12, 2
"""Part of its bend by which a cubic is wrong where half the step is tried; by how many times that a guard may
be above it; which of the places inside a step checks it."""

DEEP, LOOKS = 1e-6, 1000
"""No contact is missed that is deeper than this [m]; looks at gaps within a step before it is halved."""


@dataclass(frozen=True)
class TrialStep:
    """Guards of a step that was tried, from their levels.

    Attributes
    ----------
    first, rates
        At its beginning, and their rates there, shape (ne,).
    inner
        At the parts ``INNER`` of it, shape (3, ne).
    end
        At its end, shape (ne,).
    gaps
        Guards that are minus a gap.
    reach
        How far each gap may change in the step by the bounds of its rate at the beginning, the parts
        ``INNER`` and the end, shape (5, gaps) [m].
    inside
        Guards, and bounds of the rates of gaps, at a part of the step.
    """

    first: Array
    rates: Array
    inner: Array
    end: Array
    gaps: Sequence[int]
    reach: Array
    inside: Callable[[float], tuple[Array, Array]]

    @property
    def rise(self) -> bool:
        """Whether any is above its level at the end."""
        return bool((self.end > 0).any())

    def left(self, h: float) -> Array:
        """Time from the end of a step of length h to each guard's root [s], shape (ne,); infinite if none."""
        with np.errstate(all="ignore"):
            found = -self.end * h / (3 * (self.end - self._coefficients[1]))
        return np.where(found > 0, found, np.inf)

    @functools.cached_property
    def _coefficients(self) -> tuple[Array, Array]:
        """Middle two of the cubics in Bernstein's form, shape (ne,) each."""
        b0, (v1, v2), b3 = self.first, self.inner[:2], self.end
        with np.errstate(all="ignore"):
            return 3 * v1 - 1.5 * v2 + (b3 * 2 - b0 * 5) / 6, 3 * v2 - 1.5 * v1 + (b0 * 2 - b3 * 5) / 6

    def peaks(self) -> tuple[Array, Array, Array]:
        """Maxima of the cubics through these: places in parts of the step, values, bends; shape (ne,) each.

        NaN where there is none.
        """
        b0, (b1, b2), b3 = self.first, self._coefficients, self.end
        with np.errstate(all="ignore"):
            first, second, third = b1 - b0, b2 - b1, b3 - b2
            a, b = first - 2 * second + third, first - second
            root = np.sqrt(b * b - a * first)
            s = np.where(b > 0, first / (b + root), (b - root) / a)
        return s, self._cubic(s), 3 * self._bend

    def unsure(self) -> npt.NDArray[np.bool_]:
        """Whether each guard may be above its level since the cubic is wrong, shape (ne,)."""
        check, part = self.inner[CHECK], np.full(len(self.first), INNER[CHECK])
        with np.errstate(all="ignore"):
            wrong = abs(check - self._cubic(part))
            seen = np.max([self.first, *self._coefficients, self.end, check], axis=0)
            least = UNSURE * self._bend + ROUNDING * (abs(self.first) + abs(self.end))
            return np.asarray((wrong > least) & (seen + WRONG * wrong > 0))

    def meets(self) -> tuple[float, bool]:
        """Part of the step at which a gap is closed, and whether it surely is; 1 where none is.

        Between gaps a and b, seen a time T apart, a gap stays above (a + b - speed T) / 2, where the speed
        bounds its rate wherever the bodies are nearest: conservative advancement. That bound is the largest
        of the five places along the step, and as much more as they differ, since it may be larger in between.
        So the gap is seen again, by the states inside, at parts so near to each other that it can close
        between none of them. The states inside are wrong by no more than the one at the end, where the true
        gap is known: where a gap is not more than that, or there are too many looks, half the step shall be
        tried.
        """
        if not self.gaps:
            return 1.0, False
        a = -np.vstack([self.first, self.inner, self.end])[:, self.gaps]
        reach = 2 * self.reach.max(axis=0) - self.reach.min(axis=0)
        known = [*((INNER[i], a[1 + i]) for i in (0, CHECK, 1)), (1.0, a[-1])]
        part, now = 0.0, a[0]
        wrong: Array | None = None
        for _ in range(LOOKS):
            for place, gap in known:
                if place > part:
                    if not (now + gap + 2 * DEEP >= reach * (place - part)).all():
                        break
                    part, now = place, gap
            with np.errstate(all="ignore"):
                part += float(np.min((now + DEEP) / reach, initial=1 - part, where=reach > 0))
            if not part < 1:
                return 1.0, False
            if wrong is None:
                with np.errstate(invalid="ignore"):
                    off = abs(self.inside(1.0)[0] - self.end)[self.gaps]
                wrong = np.where(off < np.inf, off, 0.0)
            now = -self.inside(part)[0][self.gaps]
            if (now <= wrong).any():
                return (part, True) if (now <= 0).any() else (0.5, False)
        return 0.5, False

    def _cubic(self, s: Array) -> Array:
        """The cubics at parts of the step (ne,)."""
        (b1, b2), r = self._coefficients, 1 - s
        with np.errstate(all="ignore"):
            return np.asarray(r * r * (r * self.first + 3 * s * b1) + s * s * (3 * r * b2 + s * self.end))

    @functools.cached_property
    def _bend(self) -> Array:
        """How much the cubics bend, shape (ne,)."""
        b0, (b1, b2), b3 = self.first, self._coefficients, self.end
        with np.errstate(all="ignore"):
            return np.asarray(np.maximum(abs(2 * b1 - b0 - b2), abs(2 * b2 - b1 - b3)))


@dataclass
class RootBracket:
    """Lengths of a step without and with a guard above its level, and the guards there."""

    low: float
    before: Array
    high: float
    after: Array

    def earliest(self, tried: TrialStep) -> float:
        """The least root of the guards that are above their levels at the longer length."""
        above: npt.NDArray[np.int64] = np.flatnonzero(self.after > 0)
        return min(self._root(int(i), tried.first[i], tried.rates[i]) for i in above)

    def _root(self, i: int, first: float, rate: float) -> float:
        """Root of the polynomial through all that is known of guard i."""
        low, high, before, after = self.low, self.high, self.before[i], self.after[i]
        with np.errstate(all="ignore"):
            chord = np.divide(before - first, low) if low > 0 else 0.0
            rise = (chord - rate) / low if low > 0 else np.divide(np.divide(after - first, high) - rate, high)
            third = ((np.divide(after - before, high - low) - chord) / high - rise) / high if low > 0 else 0.0
        # halved with Python's own numbers, which takes a third of the time of NumPy's
        first, rate, rise, third, a, b = (float(value) for value in (first, rate, rise, third, low, high))
        for _ in range(64):
            s = a + (b - a) / 2
            above = first + s * (rate + s * (rise + (s - low) * third)) > 0
            a, b = (a, s) if above else (s, b)
        return b
