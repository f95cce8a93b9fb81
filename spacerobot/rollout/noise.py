"""Random numbers of rollouts, drawn from their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spacerobot.rollout.closed_loop_protocol import Array
from spacerobot.symbolic import NoiseTable


@dataclass(frozen=True)
class NoiseInput:
    """Random numbers of a closed loop, and the indices in p of the parameters that determine each rule's."""

    rules: tuple[NoiseTable, ...] = ()
    places: tuple[tuple[int, int], ...] = ()

    @classmethod
    def of(cls, rules: Sequence[NoiseTable], paths: Sequence[str]) -> NoiseInput:
        """Noise table from rules and the paths of p."""
        places = tuple((paths.index(rule.keys[0]), paths.index(rule.keys[1])) for rule in rules)
        return cls(tuple(rules), places)

    def drawn(self, p: Array) -> Array:
        """Random numbers (N, n) for rows of parameters (N, np); equal seeds and draws give equal numbers."""
        rows: dict[tuple[float, ...], Array] = {}
        for row in p if self.rules else ():
            key = tuple(row[list(sum(self.places, ()))])
            if key not in rows:
                parts = zip(self.rules, self.places, strict=True)
                rows[key] = np.concatenate([rule.drawn(row[a], row[b]) for rule, (a, b) in parts])
        if not rows:
            return np.empty((len(p), 0))
        return np.array([rows[tuple(row[list(sum(self.places, ()))])] for row in p])
