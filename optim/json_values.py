"""Values as JSON takes them, and files of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from spacerobot.common.files import StrPath, write_text


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


def write_json(path: StrPath, value: Any) -> None:
    """Write a value as :func:`plain` makes it to a JSON file.

    Raises:
        ResultError: If it cannot be written.
    """
    write_text(path, json.dumps(plain(value), indent=1, allow_nan=False) + "\n")
