"""Single shooting as an NLP for IPOPT: the problem's exact derivatives behind CasADi callbacks.

Forms, with u in the unit cube and everything divided by the objective at the start:

- ``smooth``:   min J(u)                        s.t. g(u) <= 0, Hessian by L-BFGS
- ``squares``:  the same, with the Gauss-Newton Hessian 2 R^T R of J = r^T r
- ``minimax``:  min S(u) + s over (u, s)        s.t. r_i(u) <= s, g(u) <= 0 (epigraph), Hessian by L-BFGS
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from optim.protocol import Array, Form, Linearisation

Linearise = Callable[[Array], Linearisation]


class _Values(ca.Callback):
    """u (k) -> a vector, or a matrix, that Python computes; with its Jacobian where one is given."""

    def __init__(
        self, name: str, k: int, shape: tuple[int, int], value: Callable[[Array], Array], jacobian: Any = None
    ) -> None:
        ca.Callback.__init__(self)
        self._k, self._shape, self._value, self._jacobian = k, shape, value, jacobian
        self._kept: list[ca.Callback] = []  # CasADi does not keep what get_jacobian returns
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, _i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._k, 1)

    def get_sparsity_out(self, _i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._shape)

    def eval(self, arguments: Any) -> list[ca.DM]:
        found = self._value(arguments[0].full().ravel())
        return [ca.DM(np.ascontiguousarray(found).reshape(self._shape))]

    def has_jacobian(self) -> bool:
        return self._jacobian is not None

    def get_jacobian(self, name: str, _inputs: Any, _outputs: Any, options: Any) -> ca.Function:
        self._kept.append(_Slopes(name, self._k, self._shape[0], self._jacobian, options))
        return self._kept[-1]


class _Slopes(ca.Callback):
    """(u, vector) -> the vector's Jacobian, as CasADi asks for it."""

    def __init__(self, name: str, k: int, n: int, value: Callable[[Array], Array], options: Any) -> None:
        ca.Callback.__init__(self)
        self._k, self._n, self._value = k, n, value
        self.construct(name, options)

    def get_n_in(self) -> int:
        return 2

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._k, 1) if i == 0 else ca.Sparsity(self._n, 1)

    def get_sparsity_out(self, _i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._n, self._k)

    def eval(self, arguments: Any) -> list[ca.DM]:
        return [ca.DM(self._value(arguments[0].full().ravel()))]


class _AfterIteration(ca.Callback):
    """Calls a function after each of IPOPT's iterations, and stops IPOPT when it says so."""

    def __init__(self, nx: int, ng: int, ask: Callable[[], bool]) -> None:
        ca.Callback.__init__(self)
        self._sizes, self._ask = (nx, 1, ng, nx, ng, 0), ask
        self.construct("after_iteration", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return str(ca.nlpsol_out(i))

    def get_name_out(self, _i: int) -> str:
        return "stop"

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes[i], 1) if self._sizes[i] else ca.Sparsity(0, 0)

    def eval(self, _arguments: Any) -> list[float]:
        return [float(self._ask())]


@dataclass(frozen=True)
class Solution:
    """What IPOPT returned.

    Attributes
    ----------
    u
        Its last point (k,).
    status
        IPOPT's own word.
    iterations
        How many.
    """

    u: Array
    status: str
    iterations: int


class Shooting:
    """The NLP of one problem from one start.

    Parameters
    ----------
    form
        Of the objective.
    linearise
        Values and derivatives at a point; values that are no numbers make IPOPT shorten its step.
    first
        Linearisation at the start: it fixes sizes and scale.
    """

    def __init__(self, form: Form, linearise: Linearise, first: Linearisation) -> None:
        self._form, self._linearise = form, linearise
        self._k = len(first.gradient)
        self._m, self._n = len(first.constraints), len(first.rows) if form == "minimax" else 0
        self.scale = max(abs(first.objective), np.finfo(float).tiny)
        self._cached: tuple[bytes, Linearisation] | None = None

    def solve(self, u0: Array, options: dict[str, object], stop: Callable[[], bool]) -> Solution:
        """Run IPOPT.

        Parameters
        ----------
        u0
            Start (k,).
        options
            IPOPT's.
        stop
            Asked after each iteration.
        """
        size = 1 + self._m + self._n
        vector = _Values("shooting", self._k, (size, 1), self._vector, self._jacobian)
        u, s = ca.MX.sym("u", self._k), ca.MX.sym("s", int(self._n > 0))
        y = vector(u)
        rows = y[1 + self._m :]
        x = ca.vertcat(u, s)
        f = y[0] + (s if self._n else 0)
        g = ca.vertcat(y[1 : 1 + self._m], rows - s if self._n else rows)
        settings: dict[str, Any] = {"print_time": False, "show_eval_warnings": False, "ipopt": options}
        hessian = _Values("gauss_newton", self._k, (self._k, self._k), self._gauss_newton)
        if self._form == "squares":
            settings["hess_lag"] = _hessian(x, self._m, hessian(u))
        else:
            settings["ipopt"] = options | {"hessian_approximation": "limited-memory"}
        after = _AfterIteration(x.numel(), g.numel(), stop)
        settings["iteration_callback"] = after
        problem: Any = {"x": x, "f": f, "g": g}
        solver = ca.nlpsol("tuning", "ipopt", problem, settings)
        extra = int(self._n > 0)
        found = solver(
            x0=np.append(u0, [1.0] * extra),
            lbx=np.append(np.zeros(self._k), [-ca.inf] * extra),
            ubx=np.append(np.ones(self._k), [ca.inf] * extra),
            lbg=-ca.inf,
            ubg=0,
        )
        best = np.clip(found["x"].full().ravel()[: self._k], 0, 1)
        stats = solver.stats()
        return Solution(best, str(stats["return_status"]), int(stats["iter_count"]))

    def _at(self, u: Array) -> Linearisation:
        key = u.tobytes()
        if self._cached is None or self._cached[0] != key:
            self._cached = (key, self._linearise(u))
        return self._cached[1]

    def _vector(self, u: Array) -> Array:
        at = self._at(u)
        if self._form == "minimax":
            return np.concatenate([[at.smooth / self.scale], at.constraints, at.rows / self.scale])
        return np.concatenate([[at.objective / self.scale], at.constraints])

    def _jacobian(self, u: Array) -> Array:
        at = self._at(u)
        if self._form == "minimax":
            parts = [at.smooth_gradient[None] / self.scale, at.constraint_jacobian]
            return np.concatenate([*parts, at.rows_jacobian / self.scale])
        return np.concatenate([at.gradient[None] / self.scale, at.constraint_jacobian])

    def _gauss_newton(self, u: Array) -> Array:
        rows = self._at(u).rows_jacobian
        return np.asarray(2 * rows.T @ rows / self.scale, dtype=np.float64)


def _hessian(x: ca.MX, m: int, objective_hessian: ca.MX) -> ca.Function:
    """Hessian of the Lagrangian, the constraints' curvature left out."""
    p, lam_f, lam_g = ca.MX.sym("p", 0, 0), ca.MX.sym("lam_f"), ca.MX.sym("lam_g", m)
    names = ["x", "p", "lam_f", "lam_g"]
    return ca.Function(
        "hess_lag",
        [x, p, lam_f, lam_g],
        [ca.triu(lam_f * objective_hessian)],
        names,
        ["triu_hess_gamma_x_x"],
    )
