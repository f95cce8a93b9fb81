"""An explicit Runge-Kutta method as data.

One step of length h from x at time t, with S stages::

    X_s = x + h sum_j a_sj k_j,    k_s = f(t + c_s h, X_s)
    x+  = normalise(x + h sum_s b_s k_s)
    its error, estimated = h sum_s e_s k_s

Everything that integrates (the compiled loops, their adjoint, the forward sensitivities, the interpreted
engine) reads these numbers and knows no method by name.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spacerobot.rollout.closed_loop_protocol import Array

INNER = (1 / 3, 2 / 3, 0.45)
"""Fractions of a step at which guards are evaluated inside it: two to fit a cubic, one to check it."""


@dataclass(frozen=True)
class Tableau:
    """Coefficients of a method.

    Attributes:
        name: Name in a scenario.
        about: Authors and publication.
        order: Order of the solution: halving the step divides its error by 2**order.
        rows: Strictly lower triangle of a, row by row, without the first stage. Stages that only the error
            estimate needs come last.
        b: Weights of the solution, one for each of the S stages that it needs.
        nodes: c, one entry for the first stage and one for each row.
        error: Weights of the error estimate, one for each stage.
        error_order: Order of the embedded solution of the estimate; its error per step shrinks with one power
            more.
    """

    name: str
    about: str
    order: int
    rows: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    nodes: tuple[float, ...]
    error: tuple[float, ...]
    error_order: int
    a: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        a = np.zeros((len(self.nodes), len(self.nodes)))
        for s, row in enumerate(self.rows, start=1):
            a[s, : len(row)] = row
        a.setflags(write=False)
        object.__setattr__(self, "a", a)

    @property
    def stages(self) -> int:
        """Evaluations in a step, S."""
        return len(self.b)

    @property
    def places(self) -> tuple[int, ...]:
        """Storage slot of each stage's slope; a slot is reused once no later stage reads it."""
        last = [max(np.flatnonzero(self.a[: self.stages, j]), default=j) for j in range(self.stages)]
        busy: dict[int, int] = {}  # place to the stage from whose evaluation on it is free
        slots = []
        for s in range(self.stages):
            place = next((p for p in range(s) if p in busy and busy[p] <= s), len(busy))
            busy[place] = self.stages + 1 if self.b[s] != 0 else int(last[s])
            slots.append(place)
        return tuple(slots)

    @property
    def dense(self) -> Array:
        """Weights of dense output: coefficients (S, 4) of the powers 1 to 4 of the fraction of the step.

        Their order is min(4, order - 1). Of all weights on the slopes that b reads and that satisfy the order
        conditions, these have the smallest norm.
        """
        a, c = self.a[: self.stages, : self.stages], np.array(self.nodes[: self.stages])
        read = np.flatnonzero(self.b)
        once, twice = a @ c, a @ c**2
        trees = [(1, 1, c**0), (2, 2, c), (3, 3, c**2), (3, 6, once)]
        trees += [(4, 4, c**3), (4, 8, c * once), (4, 12, twice), (4, 24, a @ once)]
        conditions = [tree for tree in trees if tree[0] <= min(4, self.order - 1)]
        weights, inverse = (
            np.zeros((self.stages, 4)),
            np.linalg.pinv([tree[read] for _, _, tree in conditions], 1e-10),
        )
        for (order, density, _), column in zip(conditions, inverse.T, strict=True):
            weights[read, order - 1] += column / density
        return weights

    @property
    def inner(self) -> Array:
        """Weights (3, S) of states inside a step, at the parts :data:`INNER`."""
        weights: Array = np.power.outer(np.array(INNER), np.arange(1, 5)) @ self.dense.T
        return weights

    def source(self) -> str:
        """C++ text of the coefficients, as ``struct Method``."""

        def row(values: object) -> str:
            return "{" + ", ".join(repr(float(v)) for v in np.asarray(values)) + "}"

        total, stages = len(self.nodes), self.stages
        places = ", ".join(map(str, self.places))
        inner, dense = (", ".join(row(r) for r in rows) for rows in (self.inner, self.dense))
        lines = [
            f"enum {{ STAGES = {stages}, TOTAL = {total}, PLACES = {max(self.places) + 1} }};",
            f"static constexpr double A[TOTAL][TOTAL] = {{{', '.join(row(r) for r in self.a)}}};",
            f"static constexpr double B[TOTAL] = {row([*self.b, *[0.0] * (total - stages)])};",
            f"static constexpr double C[TOTAL] = {row(self.nodes)};",
            f"static constexpr double E[TOTAL] = {row(self.error)};",
            f"static constexpr double INSIDE[{len(INNER)}] = {row(INNER)};",
            f"static constexpr double INNER[{len(INNER)}][STAGES] = {{{inner}}};",
            f"static constexpr double DENSE[STAGES][4] = {{{dense}}};",
            f"static constexpr int PLACE[STAGES] = {{{places}}};",
        ]
        return "struct Method {\n  " + "\n  ".join(lines) + "\n};"
