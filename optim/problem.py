"""The tuning problem of a scene: points of the unit cube in, objective, constraints and derivatives out."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from optim.batches import roll_out
from optim.objectives import OBJECTIVE, Terms, UserObjective, build_terms, error_rows, extended_loop
from optim.protocol import Array, Evaluation, Form, Linearisation
from optim.scenes import changed_scene, tuning_of
from optim.tied import tie
from optim.variables import Variables, resolve_variables
from spacerobot.closedloop import ClosedLoop, build_closed_loop
from spacerobot.rollout import Jacobian, Rollout, build_rollout
from spacerobot.scene import Scene

WINDOWS = 250  # rows of a minimax problem: for each error the largest and the least value in so many windows


@dataclass(frozen=True)
class TuningProblem:
    """A closed loop whose variables are free, ready to be evaluated; see :class:`optim.protocol.Problem`.

    Attributes
    ----------
    scene
        The scene, the tuning problem's changes made.
    loop
        Its closed loop, the variables not tied yet.
    variables
        The free numbers.
    terms
        Objective and constraints.
    rollout
        Parameters are the variables by name, then everything else by dotted path.
    threads
        For batches; each usable core if None. Results do not depend on it.
    """

    scene: Scene
    loop: ClosedLoop
    variables: Variables
    terms: Terms
    rollout: Rollout
    threads: int | None = None
    label: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return self.variables.names

    @property
    def start(self) -> Array:
        """The scenario's own values in the unit cube, (k,)."""
        return np.clip(self.variables.unit(self.variables.start), 0.0, 1.0)

    @property
    def form(self) -> Form:
        """How the objective is made up."""
        return self.terms.form

    @cached_property
    def constraint_names(self) -> tuple[str, ...]:
        """One name for each component of each constrained measure."""
        sizes = self.terms.measures.sizes
        return tuple(f"{name}.{i}" for name in self.terms.limits for i in range(sizes[name]))

    @cached_property
    def fingerprint(self) -> str:
        """Hash of everything that decides what the numbers are."""
        kernel, grid, v = self.rollout.kernel, self.rollout.grid, self.variables
        numbers = [*self.rollout.values(None), *v.lower, *v.upper, *v.log, grid.duration_s, grid.step_s]
        limits = sorted(self.terms.limits.items())
        engine = self.rollout.summary  # another compiler may round otherwise
        digest = hashlib.sha256(repr(([float(x) for x in numbers], v.names, limits, engine)).encode())
        for name in ("setup", "dynamics", "objective"):
            digest.update(kernel.functions[name].serialize().encode())
        return digest.hexdigest()

    def evaluate(self, u: Array) -> Evaluation:
        """Objective (N,) and constraints (N, m) at points u (N, k); NaN where the rollout diverged."""
        found = self.measure(u)
        return Evaluation(np.array(found[OBJECTIVE]), self._constraints(found, len(u)))

    def measure(self, u: Array, plants: Mapping[str, Array] | None = None) -> dict[str, Array]:
        """Objective and all measures at points u (N, k), each of shape (N,) or (N, n).

        Parameters
        ----------
        u
            Points of the unit cube; beyond its faces where a linear scale allows.
        plants
            Values (N,) of other parameters by dotted path.
        """
        return self.measure_values(self.variables.values(np.atleast_2d(u)), plants)

    def measure_values(self, values: Array, plants: Mapping[str, Array] | None = None) -> dict[str, Array]:
        """The same at values (N, k) of the variables, in the scenario's units."""
        others = dict(plants or {})
        rows = np.column_stack([np.atleast_2d(values), *others.values()])
        return roll_out(self.rollout, (*self.names, *others), rows, self.threads)

    def linearise(self, u: Array) -> Linearisation:
        """Objective, constraints and their exact derivatives at one point u (k,).

        By the adjoint where only the objective's gradient is needed, else by forward sensitivities.
        """
        values = dict(zip(self.names, self.variables.values(u), strict=True))
        slope = self.variables.slope(u)
        if self.form == "smooth" and not self.terms.limits:
            found = self.rollout.value_and_gradient(values, wrt=self.names, costs=[OBJECTIVE])
            value, gradient = float(found.costs[OBJECTIVE]), found.gradients[OBJECTIVE] * slope
            return _plain(value, gradient)
        outputs = [*self.terms.residuals] + (["tip_error"] if self.form == "minimax" else [])
        jacobian = self.rollout.jacobian(values, wrt=self.names, outputs=tuple(dict.fromkeys(outputs)))
        return self._assemble(jacobian, slope)

    def _assemble(self, jacobian: Jacobian, slope: Array) -> Linearisation:
        measures, k = jacobian.trajectory.measures, len(self.variables)
        m = len(self.constraint_names)
        if jacobian.trajectory.status != "completed":
            nothing = np.full(k, np.nan)
            return replace(
                _plain(np.nan, nothing),
                constraints=np.full(m, np.nan),
                constraint_jacobian=np.full((m, k), np.nan),
            )
        value = float(jacobian.trajectory.costs[OBJECTIVE])
        gradient = self._gradient(jacobian) * slope
        limits = self.terms.limits
        g = np.concatenate([np.empty(0), *(measures[n] / limit - 1 for n, limit in limits.items())])
        dg = np.concatenate(
            [np.empty((0, k)), *(jacobian.measures[n] / limit for n, limit in limits.items())]
        )
        rows, rows_jacobian = self._rows(jacobian)
        smooth, smooth_gradient = value, gradient
        if self.form == "minimax":
            smooth, smooth_gradient = self._beside_peak(jacobian, value, gradient, slope)
        return Linearisation(
            value, gradient, g, dg * slope, rows, rows_jacobian * slope, smooth, smooth_gradient
        )

    def _gradient(self, jacobian: Jacobian) -> Array:
        """Derivative of the objective with respect to the variables' values (k,), by the chain rule."""
        measures = [jacobian.trajectory.measures[name] for name in self.rollout.kernel.measures]
        slopes = [jacobian.measures[name] for name in self.rollout.kernel.measures]
        p = self.rollout.values(None)
        towards = self._objective_slope(np.concatenate(measures), p).full().ravel()
        return np.asarray(towards @ np.concatenate(slopes), dtype=np.float64)

    @cached_property
    def _objective_slope(self) -> ca.Function:
        """(r, p) -> derivative of the objective with respect to the measures r."""
        objective = self.rollout.kernel.functions["objective"]
        r = ca.SX.sym("r", objective.numel_in(0))
        p = ca.SX.sym("p", objective.numel_in(1))
        row = self.rollout.kernel.costs.index(OBJECTIVE)
        return ca.Function("slope", [r, p], [ca.densify(ca.jacobian(objective(r, p)[row], r))])

    @cached_property
    def _peak_weight(self) -> float:
        """Factor of the largest error in a minimax objective."""
        tuning = self.scene.scenario.tuning
        return 1.0 if tuning is None else tuning.objective.weight

    def _beside_peak(
        self, jacobian: Jacobian, value: float, gradient: Array, slope: Array
    ) -> tuple[float, Array]:
        """What a minimax objective holds beside the largest error."""
        peaks = jacobian.trajectory.measures["tip_error_peak"]
        worst = int(np.argmax(peaks))
        own = self._peak_weight * jacobian.measures["tip_error_peak"][worst] * slope
        return value - self._peak_weight * float(peaks[worst]), gradient - own

    def _rows(self, jacobian: Jacobian) -> tuple[Array, Array]:
        if self.form == "smooth":
            return np.empty(0), np.empty((0, len(self.variables)))
        if self.form == "minimax":
            return self._window_peaks(jacobian)
        step = self.rollout.grid.duration_s / self.rollout.grid.intervals
        rows, slopes = [], []
        for name, (weight, factor) in self.terms.residuals.items():
            scale = np.sqrt(weight * step) * factor
            rows.append((jacobian.trajectory.outputs[name] * scale).ravel())
            slopes.append((jacobian.outputs[name] * scale[:, None]).reshape(-1, len(self.variables)))
        return np.concatenate(rows), np.concatenate(slopes)

    def _window_peaks(self, jacobian: Jacobian) -> tuple[Array, Array]:
        """Largest and least value of each error in each window of time, and its derivative there."""
        columns = error_rows(self.scene)
        error = self._peak_weight * jacobian.trajectory.outputs["tip_error"][:, columns]
        slope = self._peak_weight * jacobian.outputs["tip_error"][:, columns]
        rows, slopes = [], []
        for part in np.array_split(np.arange(len(error)), min(WINDOWS, len(error))):
            for sign in (1, -1):
                when = part[(sign * error[part]).argmax(axis=0)]
                each = np.arange(error.shape[1])
                rows.append(sign * error[when, each])
                slopes.append(sign * slope[when, each])
        return np.concatenate(rows), np.concatenate(slopes)

    def _constraints(self, found: Mapping[str, Array], count: int) -> Array:
        limits = self.terms.limits
        return np.column_stack([np.empty((count, 0)), *(found[n] / limit - 1 for n, limit in limits.items())])


def _plain(value: float, gradient: Array) -> Linearisation:
    none, k = np.empty(0), len(gradient)
    return Linearisation(
        value, gradient, none, np.empty((0, k)), none, np.empty((0, k)), value, np.array(gradient)
    )


def build_problem(
    scene: Scene,
    *,
    chosen: Sequence[str] | None = None,
    reading: str | None = None,
    objective: UserObjective | None = None,
    threads: int | None = None,
    also_vary: Sequence[str] = (),
    label: str = "",
) -> TuningProblem:
    """Tuning problem of a scene.

    Parameters
    ----------
    scene
        A scene whose scenario has a ``tuning`` section.
    chosen
        Names of the variables; all of them if None.
    reading
        Which of the tuning section's readings; none if None.
    objective
        The user's own: function of the closed loop's signals that gives a scalar measure.
    threads
        For batches; each usable core if None.
    also_vary
        Further parameters that shall be kept although they are exactly zero.
    label
        Name for reports.

    Raises
    ------
    ScenarioError
        If a variable leads nowhere, or the closed loop does not depend on it.
    """
    scene = changed_scene(scene, reading)
    tuning = tuning_of(scene)
    variables = resolve_variables(scene, tuning, chosen)
    loop = build_closed_loop(scene, vary=[*variables.all_paths, *also_vary])
    for path in variables.all_paths:
        loop.index(path)
    extended = extended_loop(loop, scene, tuning.objective)
    tied = tie(extended, dict(zip(variables.names, variables.paths, strict=True)), list(variables.start))
    terms = build_terms(tied, scene, objective or tuning.objective, tuning.constraints)
    rollout = build_rollout(
        tied, duration_s=scene.scenario.simulation.duration, step_s=tuning.step, measures=terms.measures
    )
    return TuningProblem(scene, loop, variables, terms, rollout, threads, label)
