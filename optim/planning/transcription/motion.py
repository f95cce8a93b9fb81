"""A planned motion: instants at the points of a mesh, and the polynomials between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from optim.planning.formulation.stage import PlanningProblem
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh import Mesh
from spacerobot.common.arrays import Array


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion on a mesh.

    Attributes:
        problem: Problem of the motion.
        lobatto, mesh: The collocation and the mesh.
        duration_s: Duration [s].
        z: Instants at all points (points, nz): configuration, velocity, acceleration, drive, grips' wrenches,
            parts of forces whose magnitudes are a cost.
    """

    problem: PlanningProblem
    lobatto: Lobatto
    mesh: Mesh
    duration_s: float
    z: Array

    @property
    def intervals(self) -> int:
        """Number of intervals of the mesh."""
        return self.mesh.intervals

    @property
    def time(self) -> Array:
        """Times of the points (points,) [s]."""
        return self.lobatto.times(self.mesh, self.duration_s)

    @property
    def q(self) -> Array:
        """Configurations at the points (points, nq), on their manifold."""
        return normalised(self.problem.stage.scene.model, self.parts(self.z)[0])

    @property
    def v(self) -> Array:
        """Velocities (points, nv)."""
        return self.parts(self.z)[1]

    @property
    def a(self) -> Array:
        """Accelerations (points, nv)."""
        return self.parts(self.z)[2]

    @property
    def u(self) -> Array:
        """Drive at all points (points, nu) [N m or N]."""
        return self.parts(self.z)[3]

    @property
    def w(self) -> Array:
        """Wrenches of the grasps that hold (points, nw) [N, N m]."""
        return self.parts(self.z)[4]

    @property
    def unknowns(self) -> Array:
        """Vector of instants and duration, as a program's unknowns."""
        return np.append(self.z.ravel(), self.duration_s)

    def parts(self, z: Array) -> list[Array]:
        """Configuration, velocity, acceleration, drive and grips' wrenches of instants (n, nz)."""
        return self._split(z)[:-1]

    def _split(self, z: Array) -> list[Array]:
        """Parts of :meth:`parts`, and the parts of forces."""
        stage = self.problem.stage
        sizes = [part.numel() for part in (stage.q, stage.v, stage.a, stage.u, stage.w)]
        return np.split(z, np.cumsum(sizes), axis=1)

    def at(self, mesh: Mesh, place: Array) -> Array:
        """Instants (N len(place), nz) at places in 0 .. 1 of each of the N intervals of a mesh.

        Velocities and configurations are integrals of the polynomials of their rates, and agree with the
        unknowns at the mesh points.
        """
        return self.along((mesh.starts[:, None] + mesh.widths[:, None] * place).ravel())

    def along(self, parts: Array) -> Array:
        """Instants (n, nz) at parts (n,) of the duration, 0 to 1; see :meth:`at`."""
        n, local = self.mesh.located(parts)
        of = n[:, None] * (self.lobatto.points - 1) + np.arange(self.lobatto.points)
        values, primitives = self.lobatto.values_at(local), self.lobatto.primitives_at(local)
        q, v, *others = self._split(self.z)
        # rates of the configuration of instants
        rate = np.array(self.problem.stage.rate_function(self.z.T).full()).T
        step, first = self.duration_s * self.mesh.widths[n, None], of[:, 0]
        return np.hstack(
            [
                q[first] + step * np.einsum("pk,pkx->px", primitives, rate[of]),
                v[first] + step * np.einsum("pk,pkx->px", primitives, others[0][of]),
                *(np.einsum("pk,pkx->px", values, part[of]) for part in others),
            ]
        )

    def split_forces(self) -> Motion:
        """Motion whose parts of forces follow from its drive."""
        forces, stage = self.problem.magnitudes, self.problem.stage
        if not forces:
            return self
        parts = [part for each in forces.values() for part in (ca.fmax(each, 0), ca.fmax(-each, 0))]
        parts_values = ca.Function("parts", [stage.z], [ca.densify(ca.vertcat(*parts))])(self.z.T).full()
        unsplit = self.z[:, : self.z.shape[1] - stage.s.numel()]
        return dataclasses.replace(self, z=np.hstack([unsplit, np.array(parts_values).T]))

    def balanced(self) -> Motion:
        """Motion with the accelerations and grasp wrenches that its drives cause.

        The equations of motion and the acceleration constraints of rigid grasps are linear in both. Among all
        solutions the one nearest to the previous accelerations and wrenches is taken.
        """
        stage = self.problem.stage
        unknown, rows = ca.vertcat(stage.a, stage.w), ca.vertcat(stage.balance, stage.parting)
        instant = ca.vertcat(stage.z, stage.inertia)
        linear = ca.Function("linear", [instant], [ca.densify(ca.jacobian(rows, unknown)), ca.densify(rows)])
        z = self.z.copy()
        _, _, accelerations, _, wrenches = self.parts(z)  # views
        arguments = self.problem.arguments(self.z).T
        for values, acceleration, wrench in zip(arguments, accelerations, wrenches, strict=True):
            matrix, residual = (np.array(each.full()) for each in linear(values))
            step = np.linalg.lstsq(matrix, -residual.ravel(), rcond=None)[0]
            acceleration += step[: stage.a.numel()]
            wrench += step[stage.a.numel() :]
        return dataclasses.replace(self, z=z)

    def on(self, lobatto: Lobatto, mesh: int | Mesh) -> Motion:
        """Return the motion on another mesh."""
        mesh = Mesh.of(mesh)
        z = np.vstack([self.at(mesh, lobatto.nodes[:-1]), self.along(np.array([1.0]))])
        size = self.problem.fixed.size
        z[0, :size] = np.clip(z[0, :size], *self.problem.start)
        return Motion(self.problem, lobatto, mesh, self.duration_s, z)


@dataclass(frozen=True, eq=False)
class PhasedMotion:
    """The motions of all phases of a plan, in order; usually a single one.

    Attributes:
        motions: Motion of each phase.
        impulses: Impulse into each next phase where rigid grasps close (nw,) [N s, N m s]; empty elsewhere.
    """

    motions: tuple[Motion, ...]
    impulses: tuple[Array, ...] = ()

    @property
    def begins(self) -> Array:
        """Start time of each phase [s]."""
        return np.cumsum([0.0, *(motion.duration_s for motion in self.motions[:-1])])

    @property
    def duration_s(self) -> float:
        """Duration of all phases [s]."""
        return float(sum(motion.duration_s for motion in self.motions))

    @property
    def time(self) -> Array:
        """Times of the points [s]; the time at which two phases meet occurs twice."""
        return np.concatenate([t + m.time for t, m in zip(self.begins, self.motions, strict=True)])

    @property
    def unknowns(self) -> Array:
        """Vector of instants, durations and impulses, as a program's unknowns."""
        return np.concatenate([*(motion.unknowns for motion in self.motions), *self.impulses])

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """Mesh of each phase."""
        return tuple(motion.mesh for motion in self.motions)

    def on(self, lobatto: Lobatto, meshes: Sequence[Mesh]) -> PhasedMotion:
        """Return the motions on other meshes."""
        motions = (motion.on(lobatto, mesh) for motion, mesh in zip(self.motions, meshes, strict=True))
        return PhasedMotion(tuple(motions), self.impulses)


def normalised(model: Any, q: Array) -> Array:
    """Configurations (n, nq) with unit cosine and sine pairs and unit quaternions."""
    q = q.copy()
    for joint in list(model.joints)[1:]:
        first, size = joint.idx_q, joint.nq - joint.nv
        if not size:
            continue
        pair = slice(first + joint.nq - (4 if joint.nv == 6 else 2), first + joint.nq)
        q[:, pair] /= np.linalg.norm(q[:, pair], axis=1, keepdims=True)
    return q
