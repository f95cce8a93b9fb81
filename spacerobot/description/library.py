"""yourdfpy, without what it reads meshes with: that takes longer to load than most scenarios to simulate.

yourdfpy imports all of trimesh, of which a URDF without its meshes needs nothing but the angles of rotations.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

MESHES = "trimesh"


class _Later(ModuleType):
    """Stands in for a package until something of it is used; its own modules can be imported one by one."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if sys.modules.get(self.__name__) is self:
            return object  # in an annotation, while yourdfpy is loaded
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
            del sys.modules[name]  # loaded whole by whoever imports it next


if TYPE_CHECKING:
    import yourdfpy as yourdfpy
else:
    yourdfpy = _load()
