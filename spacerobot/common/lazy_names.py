"""Lazy loading of a package's public names, so that the import of the package takes little time."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

IMPORT = re.compile(r"^from (\S+) import (\w+) as \2$", re.MULTILINE)
"""Line of a stub with a public name and its module."""


def lazy_names(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Read a package's public names from its stub, ``__init__.pyi``, which type checkers read as well.

    The names are loaded by a module's ``__getattr__`` (:pep:`562`), as by scientific Python's
    ``lazy_loader``, whose stubs have relative imports only.

    Args:
        package: The package's ``__name__``.
        file: The package's ``__file__``; the stub is in the same folder.

    Returns:
        tuple: The package's ``__getattr__``, ``__dir__`` and ``__all__``. A module of the package would hide
            a public name that equals its own.
    """
    stub = Path(file).with_suffix(".pyi").read_text(encoding="utf-8")
    modules = {name: module for module, name in IMPORT.findall(stub)}

    def load(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = importlib.import_module(modules[name])
        try:
            return getattr(module, name)
        except AttributeError:  # the name is a module of that package
            return importlib.import_module(f"{modules[name]}.{name}")

    return load, lambda: sorted(modules), list(modules)
