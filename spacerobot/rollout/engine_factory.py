"""Engines of one kernel, each created on first use."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import TypeVar

from spacerobot.common.errors import CompileError
from spacerobot.compiled import Toolchain
from spacerobot.rollout.adjoint import AdjointEngine, adjoint_kernel
from spacerobot.rollout.engines import CompiledLoops, Engine, InterpretedLoops, Loops, compile_kernel
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.sensitivity import sensitivity_kernel
from spacerobot.rollout.virtual_machine import SceneProgram

Made = TypeVar("Made")

ADJOINT = "the closed loop's adjoint"
"""Name of the adjoint in progress messages of the compiler."""

OPERATION_S = 0.8e-9
"""Time of one operation in the virtual machine [s]."""

COMPILE_START_S, COMPILE_OPERATION_S = 1.0, 1.7e-4
"""Processor time of a compiler for the loops, and for each operation of a kernel's functions [s]."""

INTERPRETED_SHARE = 0.5
"""Maximum ratio of interpreted run time to compile time at which a request is interpreted."""


class Engines:
    """Engines that evaluate a kernel: compiled with a toolchain, or interpreted.

    The virtual machine starts at once and is about eight times slower than compiled code. It is used if its
    estimated time is at most half the compile time. The estimate counts operations and steps and reads no
    clock, so the same request gives the same bits whatever the cache holds.

    Args:
        kernel: The functions.
        toolchain: Compiler, or None.
        progress: Called with a few words while something is compiled.
        steps: Expected number of steps; infinite to compile everything.
        is_strict: Whether a compiler failure is an error; otherwise the kernel is interpreted.
        in_background: Whether single rollouts are interpreted while a thread compiles them.
    """

    def __init__(
        self,
        kernel: Kernel,
        toolchain: Toolchain | None,
        progress: Callable[[str], None] | None = None,
        *,
        steps: float = math.inf,
        is_strict: bool = False,
        in_background: bool = False,
    ) -> None:
        self.kernel = kernel
        self.toolchain = toolchain
        self.fallback = ""
        """Why it is interpreted although it should be compiled; empty otherwise."""
        self._progress, self._steps, self._is_strict = progress, steps, is_strict
        self._in_background = in_background
        self._background: threading.Thread | None = None
        self._made: dict[tuple[object, ...], object] = {}
        self._lock = threading.Lock()
        self._locks: dict[tuple[object, ...], threading.Lock] = {}

    def expect(self, steps: float) -> None:
        """Add to the expected number of steps."""
        self._steps += steps

    @property
    def single(self) -> Engine:
        """Engine for one rollout at a time."""
        if self._in_background and self.toolchain is not None:
            if self._background is None:
                # daemonic: compilers that it waits for are ended with this process
                self._background = threading.Thread(target=self._compile_single, daemon=True)
                self._background.start()
            if self._background.is_alive():
                return self._once(("interpreted", 1), self._interpreted_single)
        return self._forward("forward", self.kernel, 1)

    @property
    def batch(self) -> Engine:
        """Engine for many rollouts: as many lanes as the processor's vectors have."""
        return self._forward("forward", self.kernel, self._lanes)

    def adjoint(self, wrt: tuple[int, ...], *, many: bool) -> AdjointEngine:
        """Engine for gradients with respect to the parameters p[wrt], one rollout at a time or many."""
        kernel = self._once(("adjoint kernel", wrt), lambda: adjoint_kernel(self.kernel, wrt))
        lanes = self._lanes if many else 1

        def make() -> AdjointEngine:
            return AdjointEngine(kernel, self._loops(kernel, lanes, adjoint=True))

        return self._once(("adjoint", wrt, lanes), make)

    def sensitivity(self, wrt: tuple[int, ...], outputs: tuple[str, ...]) -> Engine:
        """Engine of forward sensitivities, one direction per lane; ``engine.kernel`` names its results."""
        key = ("sensitivity kernel", wrt, outputs)
        kernel = self._once(key, lambda: sensitivity_kernel(self.kernel, wrt, outputs))
        return self._forward(("sensitivity", wrt, outputs), kernel, self._lanes)

    def _compile_single(self) -> None:
        self._forward("forward", self.kernel, 1)

    def _interpreted_single(self) -> Engine:
        return Engine(self.kernel, InterpretedLoops(SceneProgram(self.kernel)))

    @property
    def _lanes(self) -> int:
        return 1 if self.toolchain is None else self.toolchain.lanes

    def _is_interpreted(self, kernel: Kernel) -> bool:
        """Whether the virtual machine evaluates this kernel."""
        if self.toolchain is None:
            return True
        compile_s = COMPILE_START_S + COMPILE_OPERATION_S * operations(kernel)
        return self._steps * operations_per_step(kernel) * OPERATION_S <= INTERPRETED_SHARE * compile_s

    def _forward(self, name: object, kernel: Kernel, lanes: int) -> Engine:
        def make() -> Engine:
            return Engine(kernel, self._loops(kernel, lanes, adjoint=False))

        return self._once((name, lanes, self._is_interpreted(kernel)), make)

    def _loops(self, kernel: Kernel, lanes: int, *, adjoint: bool) -> Loops:
        if self.toolchain is None or self._is_interpreted(kernel):
            return InterpretedLoops(SceneProgram(kernel))
        say = self._progress
        subject = ADJOINT if adjoint else "the closed loop"

        def report(done: int, total: int) -> None:
            if say is not None:
                say(f"compiling {subject}: {done} of {total} pieces done")

        # no progress from the background thread: its result is not awaited
        silent = threading.current_thread() is self._background
        progress = (lambda _done, _total: None) if silent else None if say is None else report
        try:
            library = compile_kernel(kernel, lanes, self.toolchain, adjoint=adjoint, progress=progress)
        except CompileError as error:
            if self._is_strict:
                raise
            self.toolchain, self.fallback = None, error.message
            return InterpretedLoops(SceneProgram(kernel))
        return CompiledLoops(library)

    def _once(self, key: tuple[object, ...], make: Callable[[], Made]) -> Made:
        """Value of a key, made by the first caller; others wait only if they request the same key."""
        with self._lock:
            lock = self._locks.setdefault(key, threading.Lock())
        with lock:
            if key not in self._made:
                self._made[key] = make()
            return self._made[key]  # type: ignore[return-value]


def operations(kernel: Kernel) -> int:
    """Operations of all functions of a kernel."""
    return sum(function.n_instructions() for function in kernel.functions.values())


def operations_per_step(kernel: Kernel) -> int:
    """Number of operations in a step: stages, guards at four points, and the reverse functions if present.

    The backward pass of a long rollout evaluates the stages a second time.
    """

    def size(name: str) -> int:
        return int(kernel.functions[name].n_instructions()) if name in kernel.functions else 0

    stages, once = kernel.method.stages, size("normalise") + 4 * size("values")
    if "dynamics_reverse" in kernel.functions:
        back = stages * size("dynamics_reverse") + size("normalise_reverse")
        return 2 * (stages * size("dynamics") + once) + back
    return len(kernel.method.nodes) * size("dynamics") + once
