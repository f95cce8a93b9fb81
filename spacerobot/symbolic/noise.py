"""Random numbers of sensor noise, drawn before a rollout by a counter-based generator.

Every number is a function of (seed, draw, sensor, index) alone, by Philox (Salmon and others 2011), so that
lanes, threads, workers and both engines use the same noise. The numbers are not part of c. A rollout copies
one row at a time into a window of c, so that compilation and setup do not depend on their count.

If the draw is negative, all numbers are zero: sensors have neither noise, bias nor lost samples, while
filters still assume the covariances of the scenario. The prediction model of model predictive control uses
this draw.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from spacerobot.common.arrays import Array

DRAW, SEED = "simulation.noise_draw", "simulation.noise_seed"
"""Paths of the scenario's numbers that select the noise: the draw, and the seed of all draws."""

NOISELESS = -1.0
"""Draw whose numbers are zero."""


@dataclass(frozen=True)
class NoiseTable:
    """Standard normal numbers of one sensor.

    Attributes:
        sensor: Name of the sensor, unique in the closed loop.
        rows, width: Number of samples, and numbers in each sample.
    """

    sensor: str
    rows: int
    width: int

    @property
    def keys(self) -> tuple[str, str]:
        """Paths of the parameters that select the numbers: seed and draw."""
        return SEED, DRAW

    def drawn(self, seed: float, draw: float) -> Array:
        """Numbers (rows * width,) of a draw, row by row; zeros if the draw is negative.

        Args:
            seed, draw: Seed and draw; their fractions are dropped.
        """
        if draw < 0:
            return np.zeros(self.rows * self.width)
        key = np.array([int(seed), int(draw)], dtype=np.uint64)
        counter = np.array([0, 0, 0, zlib.crc32(self.sensor.encode())], dtype=np.uint64)
        generator = np.random.Generator(np.random.Philox(key=key, counter=counter))
        return generator.standard_normal(self.rows * self.width)
