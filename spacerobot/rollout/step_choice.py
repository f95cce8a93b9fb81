"""Choice of a step from a stated error: step doubling on pilot rollouts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from spacerobot.common.errors import DivergedError
from spacerobot.rollout.trajectory import Trajectory

SAFETY = 0.9
GUARD = 100.0
"""Maximum error of a single step in tolerances; its estimate belongs to a method of lower order."""
HALVINGS = 16
"""Maximum number of halvings of the first step."""
MOST_STEPS = 2_000_000
"""Maximum number of steps of all pilot rollouts: seconds for a small scene, half a minute for a large one."""
FEWEST_HALVINGS = 5
"""Number of halvings that are tried even if the rollout then exceeds the maximum number of steps."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class StepChoice:
    """Chosen step with its estimated error.

    Attributes:
        step_s: The step.
        error: Largest error of any state at any sample against half the step, by Richardson's estimate,
            relative to the larger of one unit and that state's largest value.
        step_error: Largest error of a single step by the method's embedded estimate, relative in the same
            way. It includes fast motions that end between two samples.
        tolerance: Requested maximum error.
        unstable_s: Shortest step [s] at which a pilot rollout diverged, an upper bound of the stability
            limit; None if none did.
    """

    step_s: float
    error: float
    step_error: float
    tolerance: float
    unstable_s: float | None


class NoStepError(DivergedError):
    """Error if no step meets a tolerance; ``finest`` is the pilot rollout with the shortest step tried."""

    def __init__(self, tolerance: float, finest: Trajectory, reached: str) -> None:
        super().__init__(
            f"no step down to {finest.step_s:.3g} s reaches an error of {tolerance:.3g}: {reached}"
        )
        self.finest = finest


def search_step(
    run: Callable[[float], Trajectory],
    duration_s: float,
    longest_s: float,
    tolerance: float,
    order: int,
    progress: Progress | None = None,
) -> StepChoice:
    """Largest step whose error is within a tolerance, to about 10 %.

    The step is halved until it is stable and accurate, then lengthened as far as the order of the method
    predicts; a last pilot rollout checks the result. The error of a single step must be below :data:`GUARD`
    tolerances.

    Args:
        run: Function that returns a rollout with approximately a given step [s]; its samples must not depend
            on it.
        duration_s: Duration of a whole rollout [s].
        longest_s: First step to try [s].
        tolerance: Maximum error, see :class:`StepChoice`.
        order: Order of the method.
        progress: Called with a short message before each pilot rollout.

    Raises:
        NoStepError: No step within the limits :data:`HALVINGS` and :data:`MOST_STEPS` was accurate enough.
        DivergedError: A grasp does not close.
    """
    tell = progress or (lambda _: None)

    def pilot(step_s: float) -> Trajectory:
        tell(f"choosing a step: trying {step_s:.3g} s")
        return run(step_s)

    coarse, unstable, error = pilot(longest_s), None, np.inf
    if coarse.status == "unclosed":
        raise DivergedError(coarse.cause)
    steps, max_steps = coarse.steps, max(MOST_STEPS, 2 ** (FEWEST_HALVINGS + 1) * duration_s / longest_s)
    for _ in range(HALVINGS):
        if steps + 2 * duration_s / coarse.step_s > max_steps:
            break
        fine = pilot(coarse.step_s / 2)
        steps += fine.steps
        if coarse.status == "diverged":
            unstable = coarse.step_s
        elif fine.status == "completed":
            error = _error(coarse, fine, order)
            if max(error, coarse.step_error / GUARD) <= tolerance:
                choice = StepChoice(coarse.step_s, error, coarse.step_error, tolerance, unstable)
                ratio = SAFETY * (
                    choice.tolerance / max(choice.error, choice.step_error / GUARD, 1e-300)
                ) ** (1 / order)
                longer_s = min(choice.step_s * min(ratio, 2.0), longest_s)
                if longer_s > 1.05 * choice.step_s:
                    longer = pilot(longer_s)
                    if longer.status == "completed" and longer.step_s > choice.step_s:
                        pilot_error = _error(longer, fine, order)
                        if max(pilot_error, longer.step_error / GUARD) <= choice.tolerance:
                            return replace(
                                choice, step_s=longer.step_s, error=pilot_error, step_error=longer.step_error
                            )
                return choice
        coarse = fine
    raise NoStepError(tolerance, coarse, _reached(coarse, error, tolerance))


def _reached(finest: Trajectory, error: float, tolerance: float) -> str:
    """Times that the pilot rollouts reached, in words."""
    if finest.status == "diverged":
        return f"even with that one the rollout diverged, after {finest.diverged_at_s or 0:.3g} s"
    if finest.status == "chattering":
        return f"too many events come in too short a time, after {finest.diverged_at_s or 0:.3g} s"
    if error <= tolerance:
        return f"an error of {finest.step_error:.3g} was left in a single step"
    if np.isfinite(error):
        return f"an error of {error:.3g} was left"
    return "no two rollouts were completed to tell an error from"


def _error(coarse: Trajectory, fine: Trajectory, order: int) -> float:
    """Richardson's estimate of the coarse rollout's error, at the samples that both rollouts have."""
    scale = np.maximum(1.0, np.abs(fine.state).max(axis=0))
    shrink = (coarse.step_s / fine.step_s) ** order
    common = min(len(coarse.state), len(fine.state))  # an event may end them on either side of a sample
    difference = np.abs(coarse.state[:common] - fine.state[:common])
    return float((difference / scale).max() * shrink / (shrink - 1))
