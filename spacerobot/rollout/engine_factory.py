"""Engines of one kernel, each made when it is first asked for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

from spacerobot.compiled import Library, Toolchain
from spacerobot.rollout.adjoint import AdjointEngine, CompiledAdjoint, InterpretedAdjoint, adjoint_kernel
from spacerobot.rollout.engines import CompiledEngine, compile_kernel
from spacerobot.rollout.interpreted import InterpretedEngine, KernelEngine
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.sensitivity import sensitivity_kernel

Made = TypeVar("Made")

ADJOINT = "the closed loop's adjoint"
"""What it is called while it is compiled."""


class Engines:
    """Engines that evaluate a kernel: compiled with a toolchain, or interpreted without one.

    Parameters
    ----------
    kernel
        The functions.
    toolchain
        Compiler, or None.
    progress
        Called with a few words while something is compiled.
    """

    def __init__(
        self, kernel: Kernel, toolchain: Toolchain | None, progress: Callable[[str], None] | None = None
    ) -> None:
        self.kernel = kernel
        self.toolchain = toolchain
        self._progress = progress
        self._made: dict[tuple[object, ...], object] = {}
        self._lock = threading.Lock()
        self._locks: dict[tuple[object, ...], threading.Lock] = {}

    @property
    def single(self) -> KernelEngine:
        """For one rollout at a time."""
        return self._once(("forward", 1), lambda: self._forward(self.kernel, 1))

    @property
    def batch(self) -> KernelEngine:
        """For many: as many lanes as the processor's vectors have."""
        lanes = self._lanes
        return self._once(("forward", lanes), lambda: self._forward(self.kernel, lanes))

    def adjoint(self, wrt: tuple[int, ...], *, many: bool) -> AdjointEngine:
        """For gradients with respect to some places in p, one at a time or many."""
        lanes = self._lanes if many else 1

        def make() -> AdjointEngine:
            kernel = adjoint_kernel(self.kernel, wrt)
            if self.toolchain is None:
                return InterpretedAdjoint(kernel)
            return CompiledAdjoint(kernel, self._compiled(kernel, lanes, adjoint=True))

        return self._once(("adjoint", wrt, lanes), make)

    def sensitivity(self, wrt: tuple[int, ...], outputs: tuple[str, ...]) -> KernelEngine:
        """For derivatives along directions, one in each lane; ``engine.kernel`` names what it returns."""

        def make() -> KernelEngine:
            return self._forward(sensitivity_kernel(self.kernel, wrt, outputs), self._lanes)

        return self._once(("sensitivity", wrt, outputs), make)

    @property
    def _lanes(self) -> int:
        return 1 if self.toolchain is None else self.toolchain.lanes

    def _forward(self, kernel: Kernel, lanes: int) -> KernelEngine:
        if self.toolchain is None:
            return InterpretedEngine(kernel)
        return CompiledEngine(kernel, self._compiled(kernel, lanes, adjoint=False))

    def _compiled(self, kernel: Kernel, lanes: int, *, adjoint: bool) -> Library:
        say = self._progress
        what = ADJOINT if adjoint else "the closed loop"

        def told(done: int, total: int) -> None:
            if say is not None:
                say(f"compiling {what}: {done} of {total} pieces done")

        progress = None if say is None else told
        return compile_kernel(kernel, lanes, self.toolchain, adjoint=adjoint, progress=progress)

    def _once(self, key: tuple[object, ...], make: Callable[[], Made]) -> Made:
        """Value of a key, made by the first caller; others wait only if they request the same key."""
        with self._lock:
            own = self._locks.setdefault(key, threading.Lock())
        with own:
            if key not in self._made:
                self._made[key] = make()
            return self._made[key]  # type: ignore[return-value]
