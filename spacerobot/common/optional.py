"""Import of optional packages at their first use."""

from __future__ import annotations

import importlib
from typing import Any

from spacerobot.common.errors import SpaceRobotError


def optional_module(module: str, extra: str, purpose: str) -> Any:
    """Import a module of a package that an extra installs.

    Args:
        module: Dotted name of the module.
        extra: Name of the extra in ``pip install 'spacerobot[EXTRA]'``.
        purpose: Subject of the error message, the function that needs the package: ``the format mcap``.

    Raises:
        SpaceRobotError: If the package is not installed; the message names the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        missing = error.name or module
        raise SpaceRobotError(
            f"{purpose} needs the package {missing.partition('.')[0]}, which is not installed: "
            f"pip install 'spacerobot[{extra}]'"
        ) from None
