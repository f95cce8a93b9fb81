"""Random numbers of sensors: drawn before a rollout, by a counter-based generator.

Every number is a function of (seed, draw, sensor, index) alone, by Philox (Salmon and others 2011), so that
lanes, threads, workers and both engines see the same noise. A rollout reads them through windows of tables
that no function sees: neither compilation nor setup depends on how many there are.

Below draw 0 all numbers are zero: sensors show what they would without noise, bias and lost samples, while
filters go on assuming the covariances of the scenario. The model of predictive control is simulated so.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from spacerobot.common.arrays import Array

DRAW, SEED = "simulation.noise_draw", "simulation.noise_seed"
"""Numbers of the scenario: which draw, and of which family."""

NOISELESS = -1.0
"""The draw of zeros."""


@dataclass(frozen=True)
class NoiseTable:
    """Standard normal numbers of one sensor.

    Attributes:
        sensor: Its name, unique in the closed loop.
        rows, width: Samples, and numbers for each.
    """

    sensor: str
    rows: int
    width: int

    @property
    def keys(self) -> tuple[str, str]:
        """Paths of the parameters that decide them: seed and draw."""
        return SEED, DRAW

    def drawn(self, seed: float, draw: float) -> Array:
        """The numbers (rows x width,), row by row, of a draw; whole parts count, below 0 all are zero."""
        if draw < 0:
            return np.zeros(self.rows * self.width)
        key = np.array([int(seed), int(draw)], dtype=np.uint64)
        counter = np.array([0, 0, 0, zlib.crc32(self.sensor.encode())], dtype=np.uint64)
        generator = np.random.Generator(np.random.Philox(key=key, counter=counter))
        return generator.standard_normal(self.rows * self.width)
