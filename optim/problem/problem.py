"""Interface of a problem to optimisers.

A point u lies in the unit cube of the k variables. The problem is

    minimise J(u)   subject to   g(u) <= 0,   0 <= u <= 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass, fields, replace
from typing import Literal, Protocol

import numpy as np

from spacerobot.common.arrays import Array

Form = Literal["smooth", "squares", "minimax"]


@dataclass(frozen=True)
class Evaluation:
    """Values at N points.

    Attributes:
        objective: J (N,); NaN where a rollout diverged.
        constraints: g (N, m), met where g <= 0; NaN where a rollout diverged.
        rows: Components r of the objective (N, n) if requested; see :class:`Linearisation`.
    """

    objective: Array
    constraints: Array
    rows: Array | None = None

    @property
    def violation(self) -> Array:
        """Largest violation of a constraint (N,), at least zero; infinite where a rollout diverged."""
        worst = np.maximum(self.constraints, 0.0).max(axis=1, initial=0.0)
        return np.where(np.isfinite(self.objective) & np.isfinite(worst), worst, np.inf)


@dataclass(frozen=True)
class Linearisation:
    """Values and exact first derivatives at one point.

    Attributes:
        objective, gradient: J, and its derivative (k,). At a kink of a minimax problem it is one of the
            subgradients.
        constraints, constraint_jacobian: g (m,), and its derivative (m, k).
        rows, rows_jacobian: r (n,), and its derivative (n, k). For ``squares`` J = sum(r^2) up to quadrature,
            which gives the Gauss-Newton Hessian; for ``minimax`` J = smooth + max(r); for ``smooth`` empty.
        smooth, smooth_gradient: Part of a minimax objective added to max(r), and its derivative (k,).
    """

    objective: float
    gradient: Array
    constraints: Array
    constraint_jacobian: Array
    rows: Array
    rows_jacobian: Array
    smooth: float
    smooth_gradient: Array

    @classmethod
    def of_smooth(cls, objective: float, gradient: Array) -> Linearisation:
        """Build the linearisation of a smooth objective without constraints."""
        none, empty = np.empty(0), np.empty((0, len(gradient)))
        return cls(objective, gradient, none, empty, none, empty, objective, np.array(gradient))

    def as_evaluation(self) -> Evaluation:
        """Values without derivatives, as an evaluation of one point."""
        return Evaluation(np.array([self.objective]), self.constraints[None, :])

    def as_arrays(self) -> dict[str, Array]:
        """The fields by name, for files and other processes."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, Array]) -> Linearisation:
        """The inverse of :meth:`as_arrays`; further entries are ignored."""
        named = {field.name: arrays[field.name] for field in fields(cls)}
        numbers = {name: float(named[name]) for name in ("objective", "smooth")}
        return cls(**named | numbers)  # type: ignore[arg-type]


NOUNS = {
    "rollouts": "rollout",
    "samples": "recorded rollout",
    "gradients": "gradient",
    "slopes": "directional derivative",
}
"""Nouns for the kinds of evaluation in texts."""


@dataclass(frozen=True)
class EvaluationCost:
    """Number of evaluations by kind; an evaluation of several plants counts as one.

    Attributes:
        rollouts: Rollouts without derivatives.
        samples: Rollouts that also record the objective's components over time.
        gradients: Rollouts with one gradient by the adjoint, whatever the number of variables.
        slopes: Rollouts with the derivative along one direction by forward sensitivities; a Jacobian by k
            variables needs k of them.
    """

    rollouts: int = 0
    gradients: int = 0
    slopes: int = 0
    samples: int = 0

    def __add__(self, other: EvaluationCost) -> EvaluationCost:
        return EvaluationCost(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def times(self, count: int) -> EvaluationCost:
        """Cost multiplied by a count."""
        return EvaluationCost(*(count * each for each in astuple(self)))

    def __str__(self) -> str:
        counts = asdict(self)
        texts = [
            f"{counts[kind]} {noun}{'s' * (counts[kind] > 1)}" for kind, noun in NOUNS.items() if counts[kind]
        ]
        return ", ".join(texts) or "no rollouts"

    def equivalent(self, gradient: float, slope: float = 3.0, sample: float = 1.2) -> float:
        """Total cost in plain rollouts, with the cost of each other kind of evaluation in plain rollouts."""
        others = gradient * self.gradients + slope * self.slopes + sample * self.samples
        return self.rollouts + others


class OptimisationProblem(Protocol):
    """An optimisation problem over the unit cube; smooth, without constraints and rows, unless it says so."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the k variables."""

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the m constraints."""
        return ()

    @property
    def start(self) -> Array:
        """A first guess, shape (k,)."""

    @property
    def form(self) -> Form:
        """Form of the objective, which decides how an NLP is posed."""
        return "smooth"

    @property
    def linear_cost(self) -> EvaluationCost:
        """Cost of values and derivatives at one point; values without derivatives cost one rollout."""

    @property
    def sample_cost(self) -> EvaluationCost:
        """Cost of values and rows at one point."""
        return EvaluationCost(rollouts=1)

    @property
    def prefers_exact(self) -> bool:
        """Whether exact derivatives at each point cost less than differences, whatever rollouts cost."""
        return False

    @property
    def fingerprint(self) -> str:
        """Text that identifies the problem, so that a journal of another problem is not resumed."""

    def evaluate(self, u: Array) -> Evaluation:
        """Values at points u (N, k)."""

    def sample(self, u: Array) -> Evaluation:
        """Values at points u (N, k), with the components of the objective as rows."""
        return replace(self.evaluate(u), rows=np.empty((len(u), 0)))

    def linearise(self, u: Array) -> Linearisation:
        """Values and derivatives at one point u (k,)."""
        return self.linearise_all(u[None])[0]

    def linearise_all(self, u: Array) -> list[Linearisation]:
        """Values and derivatives at points u (N, k), in lanes where there are several."""
