r"""Disk margin of several loops that change at once, from structured singular values.

With each loop multiplied by its own ``(1 + alpha/2 d_i) / (1 - alpha/2 d_i)``, |d_i| < 1, the closed loop is
stable for all of them exactly if ``alpha mu(S - I/2) < 1`` at all frequencies (P. Seiler, A. Packard, P.
Gahinet: An introduction to disk margins, IEEE Control Systems 40(5), 2020), S being the sensitivity of all
loops together and mu the structured singular value of a diagonal of complex numbers. With positive diagonals
``D = exp(x)`` and diagonals U of complex numbers of size one (A. Packard, J. Doyle: The complex structured
singular value, Automatica 29(1), 1993)

    max over U of rho(M U)  =  mu(M)  <=  min over D of sigma(D M D^-1),

and every U and D gives a bound. The upper one is convex in x. Schatten norms, which are smooth, replace the
largest singular value sigma during the minimisation. Frequencies with the largest bounds are refined first,
until none can change the result; the D of one frequency also gives bounds at all others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from spacerobot.closedloop.break_points import matching_points
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Table
from spacerobot.common.tabular import Tabular
from spacerobot.linear.instants import InstantNames, as_instants
from spacerobot.linear.linearisation import Lineariser, LinearSystem
from spacerobot.linear.loop_response import AT_ONCE, frequency_grid
from spacerobot.scene import Scene, to_scene
from spacerobot.simulation import Backend, Progress

SCHATTEN = (2, 8, 32)
"""Half the exponents of the norms that are minimised in turn."""

CLOSE = 1e-3
"""Relative improvement of the upper bound below which frequencies are not refined."""

ASCENTS = 3
"""Number of frequencies at which the lower bound is maximised."""


@dataclass(frozen=True)
class SimultaneousMargins(Tabular):
    """Disk margins of loops that change at once, at instants of a simulation.

    Attributes:
        loops: Pattern of the loops' break points.
        bounds: Lower (guaranteed) and upper bound of the disk margin by the label of the instant.
    """

    loops: str
    bounds: Mapping[str, tuple[float, float]]

    def __repr__(self) -> str:
        """Smallest guaranteed margin, in one line."""
        label, (lower, _) = min(self.bounds.items(), key=lambda item: item[1])
        return f"<SimultaneousMargins of {self.loops}: at least {lower:.4g}, at {label}>"

    def content(self) -> list[Table]:
        """Table of the bounds at each instant."""
        rows = (
            (label, f"disk margin {lower:.4f} to {upper:.4f}")
            for label, (lower, upper) in self.bounds.items()
        )
        return [Table.of_pairs(f"{self.loops}, all at once", rows)]


def simultaneous_margins(
    scene: Scene | StrPath,
    at: InstantNames = 0.0,
    *,
    loops: str = "*",
    backend: Backend = "auto",
    progress: Progress | None = None,
) -> SimultaneousMargins:
    """Disk margin of a scene's loops that all change at once, at each instant.

    Args:
        scene: The scene, or the name or file of its scenario.
        at: Instants, as in :func:`spacerobot.linearise`.
        loops: Pattern of break points, such as ``torque/*``.
        backend, progress: See :func:`spacerobot.simulate`.

    Raises:
        DivergedError: If the simulation does not reach an instant.
        ScenarioError: See :func:`spacerobot.linearise`.
        SpaceRobotError: If no loop matches, or the loops are not time-invariant together.
    """
    at = as_instants(at)
    lineariser = Lineariser.of(to_scene(scene), at=at, loops=loops)
    systems = lineariser.systems(at, backend, progress or (lambda _: None))
    return SimultaneousMargins(
        loops, {system.label: simultaneous_disk_margin(system, loops) for system in systems}
    )


def simultaneous_disk_margin(system: LinearSystem, loops: str = "torque/*") -> tuple[float, float]:
    """Bounds of the disk margin of loops that change at once.

    Args:
        system: Linearised closed loop; loops of a periodic one must have the same start of their periods.
        loops: Break points, ``torque/*``.

    Returns:
        tuple of float: Lower (guaranteed) and upper bound.

    Raises:
        SpaceRobotError: If no loop matches, or the loops are not time-invariant together.
    """
    names = matching_points(system.inputs, loops)
    closed = [system.closed(name) for name in names]
    if any(one[0] is not closed[0][0] for one in closed):
        raise SpaceRobotError(f"{loops}: their signals are not held over the same periods")
    A, B, C, D = closed[0]
    places, size = [system.inputs.index(name) for name in names], len(names)
    B, C, D = B[:, places], C[places], D[np.ix_(places, places)]
    # S has no poles but those of the closed loop
    most = np.pi / system.period_s if system.period_s else np.inf
    s, distances = system.points(frequency_grid(system.poles, most)), []
    for part in np.array_split(s, -(-len(s) // AT_ONCE)):
        states = np.linalg.solve(part[:, None, None] * np.eye(len(A)) - A, B)
        distances.append(C @ states + D + 0.5 * np.eye(size))  # S - I/2, S = I + G
    matrices = np.concatenate(distances)
    if not system.period_s:
        matrices = np.concatenate([matrices, D[None] + 0.5 * np.eye(size)])  # at infinite frequency
    upper, lower = greatest_structured_value(matrices)
    return 1 / upper, 1 / lower


def greatest_structured_value(matrices: Array) -> tuple[float, float]:
    """Bounds of the largest structured singular value of matrices (N, n, n), diagonals of n complex numbers.

    Returns:
        tuple of float: Upper bound, lower bound.
    """
    simple = np.abs(np.linalg.eigvals(matrices)).max(axis=1)
    simple = np.maximum(simple, np.abs(np.diagonal(matrices, axis1=1, axis2=2)).max(axis=1))
    lower, x = float(simple.max()), np.zeros(matrices.shape[1])
    bounds, upper = np.linalg.svd(matrices, compute_uv=False)[:, 0], 0.0
    while (bounds > max(upper, lower) * (1 + CLOSE)).any():
        k = int(bounds.argmax())
        bound, x = upper_bound(matrices[k], x, max(upper, lower))
        bounds[k] = min(bounds[k], bound)
        upper = max(upper, bounds[k])
        (left,) = np.nonzero(bounds > upper)
        scaled = matrices[left] * np.exp(x[:, None] - x)
        bounds[left] = np.minimum(bounds[left], np.linalg.svd(scaled, compute_uv=False)[:, 0])
        if bounds[k] >= upper:
            lower = max(lower, lower_bound(matrices[k]))
    for k in np.argsort(-simple)[:ASCENTS]:
        lower = max(lower, lower_bound(matrices[k]))
    return max(float(bounds.max()), lower), lower


def upper_bound(M: Array, x: Array, enough: float = 0.0) -> tuple[float, Array]:
    """Minimum of ``sigma(D M D^-1)``, ``D = exp(x)``, from a first x (n,), and the minimising x.

    Args:
        M: Matrix (n, n).
        x: First logarithms of the diagonal.
        enough: Value below which the search ends.
    """
    from scipy.optimize import minimize

    least, at = np.inf, x

    def norm(x: Array, p: float) -> tuple[float, Array]:
        """Logarithm of the Schatten norm with exponent 2 p, and its gradient."""
        nonlocal least, at
        U, s, V = np.linalg.svd(M * np.exp(x[:, None] - x))
        if s[0] < least:
            least, at = float(s[0]), x.copy()
        weights = (s / s[0]) ** (2 * p)
        slope = (np.abs(U) ** 2 - np.abs(V.T) ** 2) @ weights / weights.sum()
        return float(np.log(s[0]) + np.log(weights.sum()) / (2 * p)), slope

    def stop(_: Array) -> None:
        if least <= enough:
            raise StopIteration

    for p in SCHATTEN:
        if least > enough:
            minimize(norm, at, args=(p,), jac=True, method="L-BFGS-B", callback=stop)
    return least, at


def lower_bound(M: Array) -> float:
    """Maximum spectral radius ``rho(M U)`` from an ascent; U is a diagonal of numbers of modulus one."""
    from scipy.optimize import minimize

    def radius(angles: Array) -> tuple[float, Array]:
        """Negative log of the radius, and gradient; d ln(lambda) / d angle_i = i conj(y_i) x_i / (y' x)."""
        values, right = np.linalg.eig(M * np.exp(1j * angles))
        k = int(np.abs(values).argmax())
        left = np.linalg.solve(right.conj().T, np.eye(len(M))[:, k])
        return -float(np.log(np.abs(values[k]))), (left.conj() * right[:, k]).imag

    return float(np.exp(-minimize(radius, np.zeros(len(M)), jac=True, method="L-BFGS-B").fun))
