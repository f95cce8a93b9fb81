"""Type of arrays of real numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of real numbers; docstrings state the shapes."""
