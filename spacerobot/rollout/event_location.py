"""Guards along one step: where they may turn above their levels, and where they rise there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.rollout.methods.tableau import INNER
from spacerobot.rollout.time_grid import ROUNDING

UNSURE, WRONG, CHECK = 0.01, 12, 2
"""Part of its bend by which a cubic is wrong where half the step is tried; by how many times that a guard may
be above it; which of the places inside a step checks it."""

SURGE = 1.3
"""A gap may close so many times as fast where it turns as it is seen to elsewhere along the step."""
GAP = "touched"
"""Kind of the events whose guards are minus a gap between shapes."""


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
    """

    first: Array
    rates: Array
    inner: Array
    end: Array

    @property
    def rise(self) -> bool:
        """Whether any is above its level at the end."""
        return bool((self.end > 0).any())

    def left(self, h: float) -> Array:
        """Time from the end of a step of length h to each guard's root [s], shape (ne,); infinite if none."""
        with np.errstate(all="ignore"):
            found = -self.end * h / (3 * (self.end - self._coefficients[1]))
        return np.where(found > 0, found, np.inf)

    @property
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

    def skips(self) -> npt.NDArray[np.bool_]:
        """Whether shapes may meet and part between two looks at their gap, minus each guard, shape (ne,).

        A gap closes no faster than the shapes move, so that between gaps a and b, seen a time T apart, it
        stays above (a + b - speed T) / 2: conservative advancement. The speed is the largest that is seen
        along the step, and more where the gap turns within T, as where one shape passes the other.
        """
        order, ne = [0, CHECK, 1], len(self.first)
        g = np.vstack([self.first, self.inner[order], self.end])
        length = np.diff([0.0, *(INNER[k] for k in order), 1.0])[:, None]
        with np.errstate(all="ignore"):
            change, both = np.diff(g, axis=0), g[1:] + g[:-1]
            reach, chord = length * np.max(abs(change) / length, axis=0), abs(change)
            before, after = np.vstack([self.rates, change[:-1]]), np.vstack([change[1:], np.full(ne, -1.0)])
            turns = (chord < 0.8 * reach) | (np.arange(4) < 3)[:, None]
            slow = (both + SURGE * reach > 0) & turns
            fast = (both + reach > 0) & (chord < 0.999 * reach)
            falls = (after < 0) | (change < 0)
            return np.asarray(((before > 0) & falls & (slow | fast)).any(axis=0))

    def _cubic(self, s: Array) -> Array:
        """The cubics at parts of the step (ne,)."""
        (b1, b2), r = self._coefficients, 1 - s
        with np.errstate(all="ignore"):
            return np.asarray(r * r * (r * self.first + 3 * s * b1) + s * s * (3 * r * b2 + s * self.end))

    @property
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
            a, b = low, high
            for _ in range(64):
                s = a + (b - a) / 2
                above = first + s * (rate + s * (rise + (s - low) * third)) > 0
                a, b = (a, s) if above else (s, b)
        return b
