"""Names of a package that are loaded when first used, so that importing the package takes no time."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

IMPORT = re.compile(r"^from (\S+) import (\w+) as \2$", re.MULTILINE)
"""Line of a stub that gives a public name and its module."""


def lazy_names(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Read a package's public names from its stub, ``__init__.pyi``, which type checkers read as well.

    :pep:`562` and the stubs of scientific Python's ``lazy_loader``, which accepts relative imports only, are
    the model.

    Args:
        package: The package's ``__name__``.
        file: The package's ``__file__``; the stub is in the same folder.

    Returns:
        tuple: The package's ``__getattr__``, ``__dir__`` and ``__all__``. No name may be that of a module of
            the package, which would hide it.
    """
    stub = Path(file).with_suffix(".pyi").read_text(encoding="utf-8")
    modules = {name: module for module, name in IMPORT.findall(stub)}

    def load(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = importlib.import_module(modules[name])
        try:
            return getattr(module, name)
        except AttributeError:  # a module of that package, as in the statement
            return importlib.import_module(f"{modules[name]}.{name}")

    return load, lambda: sorted(modules), list(modules)
