r"""Linearised closed loops at instants of a simulation.

About the motion x(t), deviations obey ``dx' = A dx + B w``, ``dy = C dx + D w``, with exact derivatives. The
coordinates q lie on a manifold (quaternions, cosine-sine pairs) and rigid connections confine (q, v) to
another one, so that A has meaningless entries across them. Deviations are therefore expressed

* in tangent coordinates: dq = N(q) xi, where q' = N(q) v, so that xi has a component for each of v. Then
  ``xi' = N^+ (A N - N') xi + ...``, N' being the rate of N along the motion;
* on the constraint manifold: with ``G(q) v = 0`` of the active rigid grasps and joints that mimic others,
  ``G xi = 0`` and ``(G v)_q N xi + G dv = 0``. An orthonormal basis T of the solutions gives ``T^T A T``; the
  manifold is invariant, so no mode is lost. The basis is taken as parallel along the motion.

States that are constant or without effect (works, counters, memories of events) are left out.

The coefficients are evaluated at the instant. A free-floating system has poles at zero: pose and momentum of
the whole system, on which no controller acts.

With periodic elements the closed loop is periodic: the linearised motion over one period T, from the
coefficients of the instant, is ``x_k+1 = A x_k + B w_k``, in which holds, registers of delays and events are
exact (:mod:`spacerobot.linear.periodic`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from spacerobot.closedloop import ClosedLoop, build_closed_loop
from spacerobot.closedloop.break_points import PerturbedLoop, build_perturbed_loop, matching_points
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError, near_names
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Content, Table
from spacerobot.common.tabular import Tabular
from spacerobot.linear.complex_step import evaluate
from spacerobot.linear.instants import (
    Instant,
    InstantNames,
    as_instants,
    check_instants,
    check_times,
    instants,
)
from spacerobot.linear.periodic import Matrices, PeriodicUpdate, beginning, occurrences, transition
from spacerobot.rollout import Rollout
from spacerobot.scene import Scene, to_scene
from spacerobot.simulation import Backend, Progress, prepare_simulation

if TYPE_CHECKING:
    import control
    import xarray as xr

MOST_MODES = 6
"""Number of modes in a table, those with the smallest damping ratios."""

RIGID = 3e-3
"""Magnitude [1/s] below which a pole counts as zero: rounding splits a Jordan block of four zeros by its
fourth root."""

NEUTRAL = 1e-6
"""Damping ratio within which a mode counts as undamped."""

RANK = 1e-9
"""Fraction of the largest singular value of the constraints below which others count as zero."""


@dataclass(frozen=True)
class Mode:
    """Pole, or pair of conjugate poles.

    Attributes:
        pole: Pole with non-negative imaginary part [1/s]; of a periodic system ``log(z) / T``.
        frequency_hz: Undamped natural frequency |s| / 2 pi [Hz].
        damping: Damping ratio -Re(s) / |s|; NaN for a pole at zero.
    """

    pole: complex
    frequency_hz: float
    damping: float


@dataclass(frozen=True)
class LinearSystem(Tabular):
    """Closed loop linearised at an instant, with an input at every break point; rows and columns are named.

    Attributes:
        label, time_s: The instant.
        A, B, C, D: Matrices of the closed loop (nx, nx), (nx, nu), (ny, nx), (ny, nu).
        states, inputs, outputs: Names. Inputs, and the first outputs, are the break points:
            ``torque/one/joint_1``.
        period_s: Period of a discrete system [s]; 0 where it is continuous.
        starts: For a discrete system: B, C, D and A by break point, for a period that begins at the instant
            from which the break point's output is held. A loop without an entry is time-varying.
    """

    label: str
    time_s: float
    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    period_s: float = 0.0
    starts: Mapping[str, Matrices] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Instant and sizes, in one line."""
        kind = f"every {self.period_s:g} s" if self.period_s else "continuous"
        return (
            f"<LinearSystem at {self.label}: {kind}, {len(self.states)} states, {len(self.inputs)} inputs, "
            f"{len(self.outputs)} outputs>"
        )

    def content(self) -> list[Content]:
        """Size and stability, and table of the least damped modes."""
        return [f"{self.label}: {self.description}.", self.mode_table()]

    def mode_table(self) -> Table:
        """Table of the least damped modes."""
        chosen = sorted(self.modes, key=lambda mode: mode.damping)[:MOST_MODES]
        rows = [
            [
                f"{mode.pole.real:+.4g} {mode.pole.imag:+.4g}i",
                f"{mode.frequency_hz:.4g}",
                f"{round(mode.damping, 4) + 0.0:.4f}",  # a rounded -0 has no sign
            ]
            for mode in chosen
        ]
        return Table(None, ("pole of the mode [1/s]", "frequency [Hz]", "damping ratio"), rows)

    @property
    def description(self) -> str:
        """Size of the closed loop and the number of its growing modes, in words."""
        if not self.growing:
            return f"{self.size}, no growing mode"
        modes = "1 mode grows" if len(self.growing) == 1 else f"{len(self.growing)} modes grow"
        return f"{self.size}, {modes}, the fastest at {self.growth_rate:.3g} 1/s"

    @property
    def size(self) -> str:
        """Kind of the closed loop, and numbers of its states and poles at zero, in words."""
        kind = f"sampled, period {self.period_s:g} s" if self.period_s else "continuous"
        return f"{kind}, {len(self.states)} states, {self.zero_poles} poles at zero"

    @property
    def growth_rate(self) -> float:
        """Real part of the fastest growing mode's pole [1/s]; zero if no mode grows."""
        return max((mode.pole.real for mode in self.growing), default=0.0)

    @property
    def poles(self) -> Array:
        """Poles of the closed loop [1/s] (complex); ``log(z) / T`` for a periodic system."""
        poles = self.rates(self.A)
        return poles[np.lexsort((poles.imag, np.abs(poles)))]

    def rates(self, A: Array) -> Array:
        """Poles [1/s] (complex) from the eigenvalues of a matrix over the same period."""
        values = np.linalg.eigvals(A).astype(complex)
        if self.period_s:
            values = np.log(values[np.abs(values) > np.finfo(float).tiny]) / self.period_s
        return values

    def points(self, omega: Array) -> Array:
        """Points of the imaginary axis (unit circle for a periodic system) at frequencies [rad/s]."""
        return np.asarray(np.exp(1j * omega * self.period_s) if self.period_s else 1j * omega)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Non-zero poles, the slowest first, one for each conjugate pair."""
        return tuple(
            Mode(complex(pole), float(abs(pole) / (2 * np.pi)), float(-pole.real / abs(pole)))
            for pole in self.poles
            if abs(pole) > RIGID and pole.imag >= 0
        )

    @property
    def zero_poles(self) -> int:
        """Number of poles at zero: motions of the whole system on which nothing acts."""
        return int(np.sum(np.abs(self.poles) <= RIGID))

    @property
    def growing(self) -> tuple[Mode, ...]:
        """Growing modes; a freely spinning body's modes are excluded, which grow only by rounding."""
        return tuple(mode for mode in self.modes if mode.damping < -NEUTRAL)

    @property
    def is_stable(self) -> bool:
        """Whether no mode grows."""
        return not self.growing

    def to_xarray(self) -> xr.Dataset:
        """Matrices with named rows and columns."""
        import xarray as xr

        dims = {
            "A": ("state", "state_"),
            "B": ("state", "input"),
            "C": ("output", "state_"),
            "D": ("output", "input"),
        }
        names = {"state": self.states, "state_": self.states, "input": self.inputs, "output": self.outputs}
        return xr.Dataset(
            {name: (dim, getattr(self, name)) for name, dim in dims.items()},
            coords={name: list(values) for name, values in names.items()},
            attrs={"label": self.label, "time": self.time_s, "period": self.period_s},
        )

    def to_control(self) -> control.StateSpace:
        """Closed loop as a python-control system, with the names of states, inputs and outputs.

        Raises:
            SpaceRobotError: If python-control is not installed.
        """
        return self._system((self.A, self.B, self.C, self.D), self.inputs, self.outputs)

    def loop_transfer(self, name: str) -> control.StateSpace:
        """Transfer function L of the loop broken at one point, others closed, for negative feedback.

        Args:
            name: A break point, one of ``inputs``.

        Raises:
            SpaceRobotError: If there is no such point, python-control is not installed, or the broken loop
                varies in time.
        """
        return self._system(self.broken(name), [name], [name])

    def is_invariant(self, name: str) -> bool:
        """Whether the loop broken at a point is time-invariant, as margins require."""
        return not self.period_s or name in self.starts

    def closed(self, name: str) -> Matrices:
        """Matrices of the closed loop; a periodic one begins its period when the break point's output is set.

        Args:
            name: A break point.

        Raises:
            SpaceRobotError: If there is no such point, or the broken loop varies in time.
        """
        if name not in self.inputs:
            raise SpaceRobotError(f"no break point '{name}', {near_names(name, self.inputs)}")
        if not self.is_invariant(name):
            raise SpaceRobotError(
                f"the loop broken at {name} varies in time: its signal is not held over a period"
            )
        return self.starts[name] if self.period_s else (self.A, self.B, self.C, self.D)

    def broken(self, name: str) -> Matrices:
        """Matrices of the loop broken at one point, as in :meth:`loop_transfer`.

        The closed loop has y = C x + D w. With u = y + w, ``w = (1 + d)^-1 (u - c x)`` removes the feedback
        of the broken loop.

        Args:
            name: A break point.

        Raises:
            SpaceRobotError: If there is no such point, or the broken loop varies in time.
        """
        A, B, C, D = self.closed(name)
        place = self.inputs.index(name)
        b, c, d = B[:, [place]], C[[place], :], D[place, place]
        return A - b @ c / (1 + d), b / (1 + d), -c / (1 + d), np.array([[-d / (1 + d)]])

    def _system(
        self, matrices: Matrices, inputs: Sequence[str], outputs: Sequence[str]
    ) -> control.StateSpace:
        ct = python_control()
        plain = {  # python-control reserves the dot
            key: [name.replace(".", ":") for name in names]
            for key, names in (("states", self.states), ("inputs", inputs), ("outputs", outputs))
        }
        return ct.ss(*matrices, dt=self.period_s, remove_useless_states=False, **plain)


def python_control() -> Any:
    """Module ``control`` of python-control.

    Raises:
        SpaceRobotError: If it is not installed.
    """
    try:
        import control
    except ImportError:
        raise SpaceRobotError(
            "systems of python-control need the package control; "
            "install it by pip install 'spacerobot[margins]'"
        ) from None
    return control


def linearise(
    scene: Scene | StrPath,
    at: InstantNames = 0.0,
    *,
    outputs: Iterable[str] = (),
    backend: Backend = "auto",
    progress: Progress | None = None,
) -> list[LinearSystem]:
    """Linearise a scene's closed loop at instants of its simulation.

    Args:
        scene: The scene, or the name or file of its scenario.
        at: Times [s], and kinds or names of events (``captured``), which give the instants just before and
            after.
        outputs: Names of outputs of the simulation, such as ``tip_position``, after the break points'
            signals.
        backend, progress: As for :func:`spacerobot.simulate`.

    Returns:
        list of LinearSystem: In the order of ``at``.

    Raises:
        DivergedError: If the simulation does not reach an instant.
        ScenarioError: If a time lies outside the simulation, an event does not happen, or periods have no
            common multiple.
    """
    tell = progress or (lambda _: None)
    tell("building the closed loop")
    at = as_instants(at)
    return Lineariser.of(to_scene(scene), outputs, at=at).systems(at, backend, tell)


@dataclass(frozen=True)
class Lineariser:
    """Closed loop and its derivatives, ready to be evaluated at instants."""

    scene: Scene
    loop: ClosedLoop
    perturbed: PerturbedLoop

    @classmethod
    def of(
        cls,
        scene: Scene,
        outputs: Iterable[str] = (),
        vary: Collection[str] = (),
        at: Iterable[float | str] = (),
        loops: str | None = None,
    ) -> Lineariser:
        """Linearisation of a scene, with outputs of the simulation after the break points' signals.

        Args:
            scene, outputs: See :func:`linearise`.
            vary: Parameters that remain symbols although they are exactly zero.
            at: Instants at which the loop will be evaluated; wrong ones are reported before the break points
                are built and anything is compiled.
            loops: Pattern of break points that will be evaluated; checked if given.

        Raises:
            SpaceRobotError: If there is no such output, or no break point matches the pattern.
            ScenarioError: If an instant lies outside the simulation or names no event.
        """
        check_times(scene.scenario.simulation.duration, at)
        loop, requested = build_closed_loop(scene, vary), tuple(outputs)
        check_instants(loop, scene.scenario.simulation.duration, at)
        names = [variable.name for variable in loop.variables]
        for name in requested:
            if name not in names:
                raise SpaceRobotError(f"no output '{name}', {near_names(name, names)}")
        perturbed = build_perturbed_loop(scene, requested, vary)
        if loops is not None:
            matching_points(perturbed.inputs, loops)
        return cls(scene, loop, perturbed)

    def systems(self, at: Iterable[float | str], backend: Backend, progress: Progress) -> list[LinearSystem]:
        """Linearised closed loops at instants of the scene's simulation."""
        rollout = self.rollout(backend, progress)
        progress("simulating and linearising")
        return [self.at(instant) for instant in instants(rollout, self.loop, at)]

    def rollout(self, backend: Backend, progress: Progress) -> Rollout:
        """Rollout of the closed loop, as in the scene's simulation."""
        return prepare_simulation(self.scene, self.loop, backend=backend, progress=progress).rollout

    def at(self, instant: Instant) -> LinearSystem:
        """Linearised closed loop at an instant.

        If the instant carries derivatives (:mod:`spacerobot.linear.complex_step`), all matrices carry them.

        Raises:
            ScenarioError: If periods of elements have no common multiple.
        """
        perturbed, (nq, nv) = self.perturbed, (self.loop.nq, self.loop.nv)
        t, x, c = instant.time_s, instant.x, instant.c
        A, B, C, D = evaluate(perturbed.derivatives, t, x, c)
        chart, rate = self._chart(x)
        inverse = np.linalg.solve(chart.T @ chart, chart.T)
        A, B, C = inverse @ (A @ chart - rate), inverse @ B, C @ chart
        events, period_s = occurrences(self.loop, perturbed, instant)
        updates = [
            PeriodicUpdate(one.time_s, inverse @ one.by_state @ chart, inverse @ one.by_input)
            for one in events
        ]
        names = [f"d.{name}" for name in perturbed.coordinates] + list(perturbed.state_names[nq:])
        basis = self._basis(instant, chart)
        if basis.shape[1] < 2 * nv:  # coordinates on the constraint manifold
            tangent = np.zeros((A.shape[0], A.shape[0] - 2 * nv + basis.shape[1]), dtype=basis.dtype)
            tangent[: 2 * nv, : basis.shape[1]] = basis
            tangent[2 * nv :, basis.shape[1] :] = np.eye(A.shape[0] - 2 * nv)
            A, B, C = tangent.T @ A @ tangent, tangent.T @ B, C @ tangent
            updates = [
                PeriodicUpdate(one.time_s, tangent.T @ one.by_state @ tangent, tangent.T @ one.by_input)
                for one in updates
            ]
            names = [f"eta[{i}]" for i in range(basis.shape[1])] + names[2 * nv :]
        relevant = _relevant(A, B, C, updates, basis.shape[1])
        A, B, C = A[np.ix_(relevant, relevant)], B[relevant], C[:, relevant]
        updates = [
            PeriodicUpdate(one.time_s, one.by_state[np.ix_(relevant, relevant)], one.by_input[relevant])
            for one in updates
        ]
        system = LinearSystem(
            instant.label,
            float(np.real(t)),
            A,
            B,
            C,
            D,
            tuple(names[i] for i in relevant),
            perturbed.inputs,
            perturbed.outputs,
        )
        return _periodic(system, updates, period_s) if updates else system

    def _chart(self, x: Array) -> tuple[Array, Array]:
        """Map from tangent coordinates to coordinates of x (nx, nx - nq + nv), and its rate."""
        nq, nv, size = self.loop.nq, self.loop.nv, len(x)
        charts = []
        for part, rest in zip(
            evaluate(self.perturbed.tangent, x), (np.eye(size - nq), np.zeros((size - nq,) * 2)), strict=True
        ):
            chart = np.zeros((size, size - nq + nv), dtype=part.dtype)
            chart[:nq, :nv], chart[nq:, nv:] = part, rest
            charts.append(chart)
        return charts[0], charts[1]

    def _basis(self, instant: Instant, chart: Array) -> Array:
        """Orthonormal basis of (xi, dv) on the constraint manifold (2 nv, n)."""
        nq, nv = self.loop.nq, self.loop.nv
        G, by_q = evaluate(self.perturbed.constraints, instant.time_s, instant.x, instant.c)
        rows = np.block([[G, np.zeros_like(G)], [by_q @ chart[:nq, :nv], G]])
        if not rows.any():
            return np.eye(2 * nv)
        _, sizes, vectors = np.linalg.svd(rows.real)
        rank = int(np.sum(sizes > RANK * sizes[0]))
        basis = vectors[rank:].T
        if np.iscomplexobj(rows):  # R T = 0 as R changes: dT = -R^+ dR T, which leaves T orthonormal
            basis = basis - np.linalg.pinv(rows.real, RANK) @ (1j * rows.imag) @ basis
        return np.asarray(basis)


def _relevant(A: Array, B: Array, C: Array, updates: Sequence[PeriodicUpdate], mechanical: int) -> list[int]:
    """Indices of states that change and have an effect; mechanical states are all kept.

    States with zero rows are constant: memories that no periodic event changes.
    """
    size = len(A)
    eye = np.eye(size)
    changes = np.abs(A).sum(1) + np.abs(B).sum(1)
    for one in updates:
        changes += np.abs(one.by_state - eye).sum(1) + np.abs(one.by_input).sum(1)
    relevant = [i for i in range(size) if i < mechanical or changes[i] > 0]
    while True:
        used = np.abs(C[:, relevant]).sum(0) + np.abs(
            A[np.ix_(relevant, relevant)] * (1 - eye[np.ix_(relevant, relevant)])
        ).sum(0)
        for one in updates:
            used += np.abs((one.by_state * (1 - eye))[np.ix_(relevant, relevant)]).sum(0)
        left = [i for i, use in zip(relevant, used, strict=True) if i < mechanical or use > 0]
        if len(left) == len(relevant):
            return relevant
        relevant = left


def _periodic(system: LinearSystem, updates: Sequence[PeriodicUpdate], period_s: float) -> LinearSystem:
    """Discrete system over one period; see :mod:`spacerobot.linear.periodic`."""
    continuous, starts = (system.A, system.B, system.C, system.D), {}
    matrices_by_period: dict[float, Matrices] = {}
    for place, name in enumerate(system.inputs):
        begin = beginning(updates, continuous, place, period_s)
        if begin is not None:
            if begin not in matrices_by_period:
                matrices_by_period[begin] = transition(updates, continuous, begin, period_s)
            starts[name] = matrices_by_period[begin]
    A, B, C, D = transition(updates, continuous, updates[0].time_s, period_s)
    return replace(system, A=A, B=B, C=C, D=D, period_s=period_s, starts=starts)
