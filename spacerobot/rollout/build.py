"""Building of rollouts: functions, compiled or interpreted engines, and the step."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypedDict, Unpack

from spacerobot.common.errors import CompileError, SpaceRobotError
from spacerobot.compiled import NO_COMPILER, find_toolchain
from spacerobot.rollout.closed_loop_protocol import ClosedLoopFunctions
from spacerobot.rollout.engine_factory import Engines
from spacerobot.rollout.kernel import Kernel, build_kernel
from spacerobot.rollout.measures import Measures
from spacerobot.rollout.methods import DEFAULT, METHODS
from spacerobot.rollout.rollout import TOLERANCE, Parameters, Rollout
from spacerobot.rollout.step_choice import StepChoice
from spacerobot.rollout.time_grid import time_grid

Backend = Literal["auto", "compiled", "interpreted"]


class Options(TypedDict, total=False):
    """Keyword arguments of :func:`build_rollout`; see :class:`Settings`."""

    step_s: float | None
    output_step_s: float | None
    tolerance: float
    method: str
    backend: Backend
    many: bool
    rollouts: float | None
    in_background: bool


@dataclass(frozen=True)
class Settings:
    """Settings of integration and sampling, and the backend.

    Attributes:
        step_s: Longest step [s]; shortened where it does not divide the output step. If None, it is chosen by
            :func:`choose_step`, and ``rollout.choice`` holds its error.
        output_step_s: Longest time between samples [s]. If None, each step is a sample, or each hundredth of
            the duration if the step is chosen automatically.
        tolerance: Maximum error of an automatically chosen step.
        method: Name of the numerical method, one of ``METHODS``.
        backend: ``auto`` compiles if a working compiler is found, unless the virtual machine would finish the
            requested rollouts sooner; it interprets otherwise.
        many: Whether the batch engine is compiled now, instead of the engine for a single rollout.
        rollouts: Expected number of rollouts or gradients, each over the whole duration; many if None.
        in_background: Whether single rollouts are interpreted while a compiler works in the background. Only
            for results that are displayed and not stored, since their bits then depend on timing.
    """

    step_s: float | None = None
    output_step_s: float | None = None
    tolerance: float = TOLERANCE
    method: str = DEFAULT
    backend: Backend = "auto"
    many: bool = False
    rollouts: float | None = None
    in_background: bool = False

    def sample_s(self, duration_s: float) -> float | None:
        """Longest time between samples [s]; None where each step is a sample."""
        is_automatic = self.step_s is None and self.output_step_s is None
        return duration_s / 100 if is_automatic else self.output_step_s


def build_rollout(
    loop: ClosedLoopFunctions,
    *,
    duration_s: float,
    measures: Measures | None = None,
    progress: Callable[[str], None] | None = None,
    **options: Unpack[Options],
) -> Rollout:
    """Make a closed loop ready to run: slow the first time (it compiles), quick from the cache.

    Args:
        loop, duration_s: The closed loop, and the duration of its rollouts [s].
        measures: Measures of each rollout.
        progress: Called with a short message while functions are compiled, also in later calls, and before
            each pilot rollout.
        **options: ``step_s``, ``output_step_s``, ``tolerance``, ``method``, ``backend``, ``many``,
            ``rollouts`` and ``in_background``; see :class:`Settings`.

    Raises:
        CompileError: ``backend`` is ``compiled`` and no compiler works.
        DivergedError: No step meets the tolerance.
        SpaceRobotError: A duration or a step is not positive, or the method is unknown.
    """
    settings = Settings(**options)
    sample_s, step_s = settings.sample_s(duration_s), settings.step_s
    grid = time_grid(duration_s, sample_s or duration_s if step_s is None else step_s, sample_s)
    if settings.method not in METHODS:
        raise SpaceRobotError(f"method '{settings.method}', allowed: {', '.join(METHODS)}")
    kernel = build_kernel(loop, measures, METHODS[settings.method])
    engines = _engines(kernel, settings, progress)
    rollout = Rollout(loop, kernel, grid, engines)
    if step_s is None:
        choice = rollout.choose_step(settings.tolerance, progress=progress)
        rollout = replace(rollout, grid=time_grid(duration_s, choice.step_s, sample_s), choice=choice)
    if settings.rollouts is not None:
        engines.expect(settings.rollouts * rollout.grid.steps)
    _ = engines.batch if settings.many else engines.single  # made now, and not when it is first used
    return rollout


def choose_step(
    loop: ClosedLoopFunctions,
    *,
    duration_s: float,
    parameters: Parameters = None,
    **options: Unpack[Options],
) -> StepChoice:
    """Largest step whose error is within a tolerance, found by step doubling on pilot rollouts.

    Args:
        loop, duration_s, **options: See :func:`build_rollout`; ``step_s`` is ignored.
        parameters: Parameter values; see :meth:`Rollout.values`.

    Raises:
        DivergedError: No step meets the tolerance.
    """
    sample_s = options.get("output_step_s") or duration_s / 100
    options["step_s"] = options["output_step_s"] = sample_s
    tolerance = options.get("tolerance", TOLERANCE)
    return build_rollout(loop, duration_s=duration_s, **options).choose_step(tolerance, parameters)


def _engines(kernel: Kernel, settings: Settings, progress: Callable[[str], None] | None) -> Engines:
    """Engines as the backend and the number of rollouts ask for."""
    backend = settings.backend
    if backend not in ("auto", "compiled", "interpreted"):
        raise SpaceRobotError(f"backend '{backend}', allowed: auto, compiled, interpreted")
    toolchain = None if backend == "interpreted" else find_toolchain()
    if toolchain is None and backend == "compiled":
        raise CompileError(NO_COMPILER)
    few = backend == "auto" and settings.rollouts is not None
    engines = Engines(
        kernel,
        toolchain,
        progress,
        steps=0 if few else math.inf,
        is_strict=backend == "compiled",
        in_background=settings.in_background and backend == "auto",
    )
    if toolchain is None and backend == "auto":
        engines.fallback = NO_COMPILER
    return engines
