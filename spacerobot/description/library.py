"""Import of yourdfpy without trimesh, whose import takes longer than most simulations.

yourdfpy imports all of trimesh. A URDF that is read without meshes uses only its functions for rotations.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

MESHES = "trimesh"


class _Later(ModuleType):
    """Placeholder of a package that is imported at the first use of a name, with importable submodules."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if sys.modules.get(self.__name__) is self:
            return object  # for annotations, which are evaluated while yourdfpy is imported
        return getattr(importlib.import_module(self.__name__), name)


def _load() -> ModuleType:
    spec = importlib.util.find_spec(MESHES)
    if MESHES in sys.modules or "yourdfpy" in sys.modules or spec is None:
        return importlib.import_module("yourdfpy")
    later = _Later(MESHES)
    later.__path__ = list(spec.submodule_search_locations or ())
    sys.modules[MESHES] = later
    try:
        return importlib.import_module("yourdfpy")
    finally:
        for name in [name for name in sys.modules if name.partition(".")[0] == MESHES]:
            del sys.modules[name]  # the next import loads the complete package


if TYPE_CHECKING:
    import yourdfpy as yourdfpy
else:
    yourdfpy = _load()
