"""The manual tuning procedure of section 4.3, steps i to iii, by fixed rules and with a log of its trials.

i.   K_i = K_d = 0; raise K_p until the error no longer falls or the loop oscillates.
ii.  If it oscillated, halve K_p; raise K_i until the error no longer falls or the loop oscillates.
iii. Raise K_d as long as this reduces the oscillations or the error.

The amnesia controller is off (G_e = 0) during i and ii: with it, and K_d = 0, no K_p and K_i keep the loop
stable. The oscillations that iii removes are its own. The paper gives no numbers for "rapidly", "little
overshoot" and "oscillates"; the constants below are ours.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from optim.problem.objectives import OBJECTIVE, error_rows
from optim.problem.problem import EvaluationCost
from optim.problem.tuning_problem import TuningProblem
from optim.search.search import NOT_APPLICABLE, Search, SearchRun
from spacerobot.common.arrays import Array

FIRST, FACTOR, TRIALS = 1.0, 2.0, 14
AMNESIA_GAIN = ".amnesia.ge"
ENOUGH = 0.02  # an error that falls by less than this fraction "no longer falls"
SWING = 0.1  # an extreme counts if it differs by this fraction of the largest error
OSCILLATES_HZ = 2.0
PATIENCE = 4  # trials in a row that do not help
NEEDED = ("kp", "ki", "kd")


def manual(search: Search, problem: TuningProblem) -> SearchRun:
    """Tune ``kp``, ``ki`` and ``kd`` by the manual procedure; the other variables stay at the start.

    In the paper the procedure serves to find bounds, so it does not respect them: the result may lie outside
    the unit cube. A variable with a log scale has its lower bound in place of zero.

    Returns:
        Run: Status ``done``, ``interrupted``, or ``not applicable`` if one of the three gains is not free;
            the log holds each trial.
    """
    if any(name not in problem.names for name in NEEDED):
        present = ", ".join(problem.names) or "none"
        return search.finish(NOT_APPLICABLE, f"needs the variables {', '.join(NEEDED)}, found: {present}")
    trials = _Trials(search, problem)
    gains = {name: trials.zero(name) for name in NEEDED}
    try:
        if trials.raise_gain("i", "kp", gains):
            gains["kp"] /= 2
        search.tell(1 / 3)
        trials.raise_gain("ii", "ki", gains)
        search.tell(2 / 3)
        trials.calm("iii", "kd", gains)
        search.tell(1.0)
    except KeyboardInterrupt:
        return trials.finish(gains, "interrupted")
    return trials.finish(gains, "done")


class _Trials:
    """Trials of gains in sequence, each recorded."""

    def __init__(self, search: Search, problem: TuningProblem) -> None:
        self._search, self._problem = search, problem
        self._log: list[dict[str, object]] = []
        owners = dict(zip(problem.names, problem.variables.paths, strict=True))
        self._amnesia = [
            name
            for name in problem.rollout.loop.parameter_paths
            if any(path.endswith(AMNESIA_GAIN) for path in owners.get(name, (name,)))
        ]

    def zero(self, name: str) -> float:
        """Value that represents zero for a variable: its lower bound if its scale is logarithmic."""
        i = self._problem.names.index(name)
        return float(self._problem.variables.lower[i]) if self._problem.variables.log[i] else 0.0

    def raise_gain(self, step: str, name: str, gains: dict[str, float]) -> bool:
        """Raise a gain while the error falls, and store the best one in ``gains``.

        Returns whether the loop oscillates with the stored gain.

        A loop that diverges before it ever followed its reference has not converged yet: the gain is raised
        on.
        """
        error, _ = self._try(step, gains)
        followed, oscillated, idle, value = False, False, 0, FIRST
        for _ in range(TRIALS):
            trial_error, swings = self._try(step, gains | {name: value})
            if trial_error < error * (1 - ENOUGH):
                gains[name], error, followed, idle = value, trial_error, True, 0
                oscillated = swings > OSCILLATES_HZ
            elif followed or np.isfinite(trial_error):
                idle += 1
            if followed and (oscillated or not np.isfinite(trial_error) or idle >= PATIENCE):
                break
            value *= FACTOR
        return oscillated

    def calm(self, step: str, name: str, gains: dict[str, float]) -> None:
        """Raise a gain while oscillations or the error decrease, or the loop still diverges."""
        error, swings = self._try(step, gains)
        value = FIRST
        for _ in range(TRIALS):
            trial_error, still = self._try(step, gains | {name: value})
            if still < swings * (1 - ENOUGH) or trial_error < error * (1 - ENOUGH):
                gains[name], error, swings = value, trial_error, still
            elif np.isfinite(error):
                return
            value *= FACTOR

    def finish(self, gains: Mapping[str, float], status: str) -> SearchRun:
        """The run that ends at some gains."""
        u = self._point(gains)
        evaluation = self._problem.evaluate(u[None, :])
        self._search.u, self._search.objective = u, float(evaluation.objective[0])
        self._search.violation = float(evaluation.violation[0])
        self._search.cost += EvaluationCost(rollouts=1)
        outside = "" if ((u >= 0) & (u <= 1)).all() else "outside the bounds, which it does not know"
        return self._search.finish(status, outside, log=tuple(self._log))

    def _point(self, gains: Mapping[str, float]) -> Array:
        values = self._problem.variables.values(self._problem.start)
        for name, value in gains.items():
            values[self._problem.names.index(name)] = value
        return self._problem.variables.unit(values)

    def _try(self, step: str, gains: Mapping[str, float]) -> tuple[float, float]:
        """Largest error [m] and swings per second of one trial; infinite if it diverged."""
        rollout, names = self._problem.rollout, self._problem.names
        point = dict(zip(names, self._problem.variables.values(self._point(gains)), strict=True))
        if step != "iii":
            point |= dict.fromkeys(self._amnesia, 0.0)
        row = list(point.values())
        batch = rollout.batch(tuple(point), [row], outputs=["tip_error"], threads=1)
        self._search.cost += EvaluationCost(rollouts=1)
        lost = bool(np.isfinite(batch.diverged_at_s[0]))
        errors = batch.outputs["tip_error"][0][:, error_rows(self._problem.scene)]
        largest = np.inf if lost else float(np.abs(errors).max())
        # full swings (two turning points each) of the liveliest component, small ones left out
        threshold = SWING * float(np.abs(errors).max())
        turns = np.inf if lost else max(_turns(column, threshold) for column in errors.T)
        swings = turns / 2 / rollout.grid.duration_s
        self._log.append(
            {
                "step": step,
                **{name: float(value) for name, value in gains.items()},
                "largest_error_m": None if lost else largest,
                "swings_hz": None if lost else swings,
                "objective": None if lost else float(batch.costs[OBJECTIVE][0]),
            }
        )
        return largest, swings


def _turns(values: Array, threshold: float) -> int:
    """Number of turning points of a signal whose values differ by at least a threshold."""
    turns, extreme, rising = 0, values[0], 0
    for value in values[1:]:
        if rising >= 0 and value < extreme - threshold:
            turns, extreme, rising = turns + (rising > 0), value, -1
        elif rising <= 0 and value > extreme + threshold:
            turns, extreme, rising = turns + (rising < 0), value, 1
        elif (rising >= 0 and value > extreme) or (rising <= 0 and value < extreme):
            extreme = value
    return turns
