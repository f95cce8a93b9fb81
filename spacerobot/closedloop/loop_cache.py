"""Cache of closed loops, so that a scene that was simulated before need not be built again.

The key of an entry is a hash of everything that a closed loop is built from: the resolved scenario, the
URDFs, the model, the source of spacerobot and the versions of its libraries. Entries are pickles, which can
run code as compiled libraries can. They are therefore loaded only from the private folder of the compiled
libraries.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import pickle
import tempfile
import zlib
from collections.abc import Collection
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin

from spacerobot.closedloop import ClosedLoop, build_closed_loop
from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.compiled import cache
from spacerobot.elements.core.registry import only_shipped
from spacerobot.scenario.load import to_document
from spacerobot.scene import Scene

SUFFIX = ".loop"


def cached_closed_loop(
    scene: Scene, vary: Collection[str] = (), kind: type[LoopBuilder] = LoopBuilder
) -> ClosedLoop:
    """Closed loop of a scene from the cache, or built and stored there; identical to the bit in both cases.

    With user-defined kinds of elements, whose source is not part of the key, the loop is always built.

    Args:
        scene, vary, kind: As for :func:`build_closed_loop`.

    Raises:
        ScenarioError: As :func:`build_closed_loop`.
    """
    if not only_shipped():
        return build_closed_loop(scene, vary, kind)
    content = f"{SceneContent(scene).key} {sorted(vary)} {kind.__name__}"
    key = hashlib.sha256(content.encode()).hexdigest()[:32]
    folder = cache.cache_folder()
    path = cache.find(folder, key, SUFFIX)
    if path is not None:
        # an entry may be damaged or removed by another process, and unpickling may raise any exception
        with contextlib.suppress(Exception):
            cached = pickle.loads(zlib.decompress(path.read_bytes()))  # noqa: S301 (the user's own)
            if isinstance(cached, ClosedLoop):
                return cached
        with contextlib.suppress(OSError):
            path.unlink()
    loop = build_closed_loop(scene, vary, kind)
    with contextlib.suppress(OSError):  # a full disk must not end a simulation
        # write to a temporary file, then rename it
        handle, place = tempfile.mkstemp(prefix="built-", suffix=".tmp", dir=folder)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(zlib.compress(pickle.dumps(loop), 1))
            cache.store(folder, key, Path(place), SUFFIX)
        finally:
            Path(place).unlink(missing_ok=True)
    return loop


class SceneContent:
    """A scene that compares equal to every scene from which the same closed loop is built.

    With user-defined kinds of elements, whose source is not known, it is equal to itself alone.

    Args:
        scene: The scene.

    Attributes:
        key: Hash of everything that the closed loop is built from.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        if not only_shipped():
            self.key = f"scene {id(scene)}"  # unique while this object refers to the scene
            return
        content = {
            "scenario": to_document(scene.scenario),
            "urdf": [body.description.sha256 for body in scene.bodies],
            "model": scene.model.saveToString(),
            "start": [scene.q.tolist(), scene.v.tolist()],
            "code": _code(),
            "versions": [ca.CasadiMeta.version(), pin.__version__, np.__version__],
        }
        self.key = hashlib.sha256(json.dumps(content).encode()).hexdigest()

    def __eq__(self, other: object) -> bool:
        """Whether both scenes have the same closed loop."""
        return isinstance(other, SceneContent) and other.key == self.key

    def __hash__(self) -> int:
        """Hash of the key."""
        return hash(self.key)


@functools.cache
def _code() -> str:
    """Hash of the source of spacerobot."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(f"{path.relative_to(package)}\0".encode() + path.read_bytes())
    return digest.hexdigest()
