"""Problems whose optima are known by hand, through the interface that scenes are tuned through."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from optim.problem.problem import Evaluation, EvaluationCost, Linearisation


@dataclass
class Known:
    """J, g and rows with derivatives by hand; counts calls, and may interrupt one."""

    start: np.ndarray
    optimum: np.ndarray
    form: str = "smooth"
    constraint_names: tuple[str, ...] = ()
    calls: int = 0
    interrupt_at: int = -1
    fingerprint: str = "known"
    prefers_exact: bool = False
    extra: dict = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"u{i}" for i in range(len(self.start)))

    @property
    def linear_cost(self):
        return EvaluationCost(gradients=1)

    @property
    def sample_cost(self):
        return EvaluationCost(samples=1)

    def sample(self, u):
        found = self.evaluate(u)
        return Evaluation(found.objective, found.constraints, np.array([self.parts(p).rows for p in u]))

    def linearise_all(self, u):
        return [self.linearise(point) for point in u]

    def evaluate(self, u):
        self._count(len(u))
        parts = [self.parts(point) for point in u]
        return Evaluation(np.array([p.objective for p in parts]), np.array([p.constraints for p in parts]))

    def linearise(self, u):
        self._count(1)
        return self.parts(u)

    def _count(self, n):
        if 0 <= self.interrupt_at <= self.calls:
            raise KeyboardInterrupt
        self.calls += n

    def build(self, objective, gradient, rows=None, rows_jacobian=None, smooth=None, smooth_gradient=None):
        k, none = len(gradient), np.empty(0)
        return Linearisation(
            objective,
            gradient,
            none,
            np.empty((0, k)),
            none if rows is None else rows,
            np.empty((0, k)) if rows is None else rows_jacobian,
            objective if smooth is None else smooth,
            gradient if smooth is None else smooth_gradient,
        )


class Quadratic(Known):
    """Badly scaled, its optimum inside."""

    def parts(self, u):
        weight = np.array([1.0, 10.0, 100.0])
        d = u - self.optimum
        return self.build(float(weight @ d**2), 2 * weight * d)


class Walled(Quadratic):
    """The same, where half of the cube has no value: rollouts diverge there."""

    def parts(self, u):
        found = super().parts(u)
        if u[0] > 0.6:
            return self.build(np.nan, np.full(3, np.nan))
        return found


class Rosenbrock(Known):
    """As a sum of squares, moved into the unit cube: u = (x + 2) / 4, optimum at x = (1, 1)."""

    def parts(self, u):
        x = 4 * u - 2
        rows = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
        jacobian = 4 * np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])
        return self.build(float(rows @ rows), 2 * rows @ jacobian, rows, jacobian)


class Chebyshev(Known):
    """Straight line that is nearest to t^2 on [0, 1] in the largest error: t - 1/8, error 1/8."""

    def parts(self, u):
        t = np.linspace(0, 1, 101)
        a, b = 4 * u - 2
        error = t**2 - (a * t + b)
        slope = -4 * np.stack([t, np.ones_like(t)], axis=1)
        rows, jacobian = np.concatenate([error, -error]), np.concatenate([slope, -slope])
        worst = int(rows.argmax())
        return self.build(float(rows[worst]), jacobian[worst], rows, jacobian, 0.0, np.zeros(2))


class Mixed(Known):
    """Least (u - 1)^2 + max(u, 0): 1/2, value 3/4."""

    def parts(self, u):
        rows, jacobian = np.array([u[0], 0.0]), np.array([[1.0], [0.0]])
        value, slope = float((u[0] - 1) ** 2), 2 * (u - 1)
        return self.build(value + rows.max(), slope + 1, rows, jacobian, value, slope)


class Constrained(Known):
    """Least (u0 - 1)^2 + (u1 - 1)^2 with u0 + u1 <= 1: (1/2, 1/2)."""

    def parts(self, u):
        import dataclasses

        d = u - 1
        plain = self.build(float(d @ d), 2 * d)
        return dataclasses.replace(
            plain, constraints=np.array([u.sum() - 1]), constraint_jacobian=np.ones((1, 2))
        )


class TwoBasins(Known):
    """0.1 and the largest of 4 |u0 - 1/4| and |u1 - 1/2|; from u0 = 1/2 on 0.6 + 4 |u0 - 3/4| instead."""

    def parts(self, u):
        across, base, centre = np.array([4.0, 0.0]), 0.1 + 0.5 * (u[0] > 0.5), 0.25 + 0.5 * (u[0] > 0.5)
        along = np.array([0.0, 1.0])
        a, b = 4 * (u[0] - centre), u[1] - 0.5
        rows, jacobian = (
            np.array([base + a, base - a, 0.1 + b, 0.1 - b]),
            np.stack([across, -across, along, -along]),
        )
        worst = int(rows.argmax())
        return self.build(float(rows[worst]), jacobian[worst], rows, jacobian, 0.0, np.zeros(2))


def two_basins():
    return TwoBasins(start=np.array([0.8, 0.4]), optimum=np.array([0.25, 0.5]), form="minimax")


def quadratic(cls=Quadratic):
    return cls(start=np.full(3, 0.5), optimum=np.array([0.3, 0.7, 0.2]))


def rosenbrock(form="squares"):
    return Rosenbrock(start=np.array([0.2, 0.75]), optimum=np.array([0.75, 0.75]), form=form)


def chebyshev():
    return Chebyshev(start=np.array([0.3, 0.8]), optimum=np.array([0.75, 0.46875]), form="minimax")


def constrained():
    return Constrained(start=np.array([0.1, 0.2]), optimum=np.full(2, 0.5), constraint_names=("sum",))


def mixed():
    return Mixed(start=np.array([0.9]), optimum=np.array([0.5]), form="minimax")
