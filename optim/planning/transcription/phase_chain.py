"""Program of consecutive phases, joined from the phases' programs.

The unknowns of all phases are followed by those of the links, and so are the constraints. A link joins the
last instant of a phase with the first one of the next. The state is continuous or, if rigid grasps close,
jumps by the plastic impulse Lambda on the relative motion A v of the bodies that they join,

    q+ = q-,   M(q) (v+ - v-) = A(q)' Lambda,   A(q) v+ = 0.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import sparse

from optim.planning.formulation.grasps import tip_slip
from optim.planning.formulation.stage import Stage
from optim.planning.solver.ipopt import TOLERANCE, Solution
from optim.planning.transcription.collocation_program import CollocationProgram, SparseSums
from optim.planning.transcription.instant_functions import Pattern, derived
from spacerobot.common.arrays import Array
from spacerobot.dynamics import Inertias, forward_kinematics, inverse_dynamics


@dataclass(frozen=True, eq=False)
class Linkage:
    """Linkage constraints between a phase and the next one.

    Attributes:
        functions: ``values``, ``jacobian`` and ``hessian`` of the state before the link, the state after it,
            and the impulse.
        jacobian, hessian: Rows and columns of the nonzero entries.
        impulses: Number of components of the impulse.
    """

    functions: dict[str, ca.Function]
    jacobian: Pattern
    hessian: Pattern
    impulses: int

    @classmethod
    def into(cls, stage: Stage, impact: bool) -> Linkage:
        """Link into a phase.

        Args:
            stage: An instant of that phase.
            impact: Whether rigid grasps close at the beginning of the phase.
        """
        arguments, rows, count = _joined(stage, impact)
        functions, (jacobian, hessian) = derived(arguments, rows, "")
        return cls(functions, jacobian, hessian, count)

    def with_values_of(self, stage: Stage, impact: bool) -> Linkage:
        """Link into a phase of a problem that differs in numbers only: values without derivatives."""
        arguments, rows, _ = _joined(stage, impact)
        return dataclasses.replace(self, functions={"values": ca.Function("values", [arguments], [rows])})

    @property
    def rows(self) -> int:
        """Number of constraints of the link."""
        return int(self.functions["values"].numel_out(0))

    def call(self, name: str, *arguments: Array) -> Array:
        """Evaluate one of the link's functions."""
        return np.array(self.functions[name](*arguments).full()).ravel()


def _joined(stage: Stage, impact: bool) -> tuple[ca.SX, ca.SX, int]:
    """States before and after the link with the impulse, the link's constraints, and the impulse's size."""
    scene, model = stage.scene, stage.scene.model
    count = stage.w.numel() if impact else 0
    before, behind = (ca.SX.sym(name, model.nq + model.nv) for name in ("before", "behind"))
    impulse = ca.SX.sym("impulse", count)
    rows = behind - before
    if impact:
        q, v, jump = before[: model.nq], behind[model.nq :], rows[model.nq :]
        still, inertias = forward_kinematics(model, q, ca.SX(model.nv, 1)), Inertias.from_model(model)
        momentum, none = (inverse_dynamics(model, still, inertias, by) for by in (jump, ca.SX(model.nv, 1)))
        parting = tip_slip(scene, forward_kinematics(model, q, v), stage.grips)
        rows[model.nq :] = momentum - none - ca.jtimes(parting, v, impulse, True)
        rows = ca.vertcat(rows, parting)
    return ca.vertcat(before, behind, impulse), ca.densify(rows), count


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """Constraints that are linear in all unknowns of a chain.

    Attributes:
        matrix: Jacobian (rows, size).
        least, greatest: Lower and upper limits (rows,) of the values.
    """

    matrix: sparse.csr_matrix
    least: Array
    greatest: Array


class PhaseChain:
    """Programs of consecutive phases, and the links between them.

    Args:
        programs: Program of each phase.
        links: Link between each pair of consecutive phases.
        rest: Further linear constraints on all unknowns, the last rows of the chain; none if None.

    Attributes:
        is_redundant: Whether constraints may be dependent, assumed if magnitudes of forces are a cost. For
            example, the rest at the end of a body without torque follows from its start, and no such cost
            depends on that body.
        tolerance: Largest residual of the first-order conditions at a solution.
    """

    def __init__(
        self,
        programs: Sequence[CollocationProgram],
        links: Sequence[Linkage],
        rest: LinearConstraints | None = None,
    ) -> None:
        self.programs, self.links = tuple(programs), tuple(links)
        self.is_redundant = any(program.problem.magnitudes for program in programs)
        self.tolerance = TOLERANCE
        self._sizes = [*(p.size for p in programs), *(link.impulses for link in links)]
        self._counts = [
            *(p.rows for p in programs),
            *(link.rows for link in links),
            0 if rest is None else len(rest.least),
        ]
        self.size, self.rows = sum(self._sizes), sum(self._counts)
        first = np.cumsum([0, *self._sizes])
        self.rest = rest or LinearConstraints(sparse.csr_matrix((0, self.size)), np.empty(0), np.empty(0))
        self._joined = []  # the unknowns of each link
        for k, link in enumerate(links):
            before, state = programs[k], np.arange(programs[k].nx)
            ends = first[k] + (before.points - 1) * before.nz + state, first[k + 1] + state
            impulse = first[len(programs) + k] + np.arange(link.impulses)
            self._joined.append(np.concatenate([*ends, impulse]))
        # indices of the derivatives' entries: those of the programs, then those of the links
        jacobian, hessian, row = list[Pattern](), list[Pattern](), np.cumsum([0, *self._counts])
        for k, program in enumerate(programs):
            slopes, bends = program.jacobian_pattern.tocoo(), program.hessian_pattern.tocoo()
            jacobian.append((row[k] + slopes.row, first[k] + slopes.col))
            hessian.append((first[k] + bends.row, first[k] + bends.col))
        for k, (link, joined) in enumerate(zip(links, self._joined, strict=True), start=len(programs)):
            jacobian.append((row[k] + link.jacobian[0], joined[link.jacobian[1]]))
            hessian.append((joined[link.hessian[0]], joined[link.hessian[1]]))
        linear = self.rest.matrix.tocoo()
        jacobian.append((self.rows - len(self.rest.least) + linear.row, linear.col))
        self._jacobian = SparseSums.of(jacobian, (self.rows, self.size))
        self._hessian = SparseSums.of(hessian, (self.size, self.size))
        self.jacobian_pattern, self.hessian_pattern = self._jacobian.matrix, self._hessian.matrix

    def parts(self, w: Array) -> list[Array]:
        """Unknowns of each program, and the impulse of each link."""
        return np.split(w, np.cumsum(self._sizes)[:-1])

    def parted(self, solution: Solution) -> list[Solution]:
        """Solution of each program, from the chain's."""
        of = zip(*(self.parts(a) for a in (solution.w, solution.bound_multipliers)), strict=True)
        rows = np.split(solution.multipliers, np.cumsum(self._counts)[:-1])
        return [
            dataclasses.replace(solution, w=w, bound_multipliers=bounds, multipliers=multipliers)
            for (w, bounds), multipliers in zip(of, rows, strict=False)
        ]

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the unknowns; impulses are free."""
        free = np.full(sum(link.impulses for link in self.links), np.inf)
        lower, upper = zip(*(p.bounds() for p in self.programs), strict=True)
        return np.concatenate([*lower, -free]), np.concatenate([*upper, free])

    def limits(self) -> tuple[Array, Array]:
        """Lower and upper limits of the constraints."""
        met = np.zeros(sum(link.rows for link in self.links))
        lower, upper = zip(*(p.limits() for p in self.programs), strict=True)
        rest = self.rest
        return np.concatenate([*lower, met, rest.least]), np.concatenate([*upper, met, rest.greatest])

    def objective(self, w: Array) -> float:
        """Cost of all phases."""
        return sum(p.objective(unknowns) for p, unknowns in zip(self.programs, self.parts(w), strict=False))

    def gradient(self, w: Array) -> Array:
        """Gradient of the cost (size,)."""
        gradients = [p.gradient(unknowns) for p, unknowns in zip(self.programs, self.parts(w), strict=False)]
        return np.concatenate([*gradients, np.zeros(sum(link.impulses for link in self.links))])

    def constraints(self, w: Array) -> Array:
        """Values of all constraints (rows,)."""
        blocks = [p.constraints(unknowns) for p, unknowns in zip(self.programs, self.parts(w), strict=False)]
        return np.concatenate([*blocks, *self._linked("values", w), self.rest.matrix @ w])

    def jacobian(self, w: Array) -> Array:
        """Entries of the constraints' first derivatives, as :attr:`jacobian_pattern` has them."""
        entries = [p.jacobian(unknowns) for p, unknowns in zip(self.programs, self.parts(w), strict=False)]
        jacobian = np.concatenate([*entries, *self._linked("jacobian", w), self.rest.matrix.tocoo().data])
        return self._jacobian.entries(jacobian)

    def hessian(self, w: Array, factor: float, multipliers: Array) -> Array:
        """Entries of the Lagrangian's Hessian, upper triangle, in the order of :attr:`hessian_pattern`."""
        weights = np.split(multipliers, np.cumsum(self._counts)[:-1])
        entries = [
            p.hessian(unknowns, factor, weight)
            for p, unknowns, weight in zip(self.programs, self.parts(w), weights, strict=False)
        ]
        entries += [
            link.call("hessian", w[indices], weight)
            for link, indices, weight in zip(
                self.links, self._joined, weights[len(self.programs) :], strict=False
            )
        ]
        return self._hessian.entries(np.concatenate(entries))

    def _linked(self, name: str, w: Array) -> list[Array]:
        return [link.call(name, w[indices]) for link, indices in zip(self.links, self._joined, strict=True)]
