"""Values as JSON takes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """Plain lists, mappings and numbers; what is no number is None."""
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
