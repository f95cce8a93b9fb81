r"""Disk margin of several loops that change at once, by structured singular values.

With each loop multiplied by its own ``(1 + alpha/2 d_i) / (1 - alpha/2 d_i)``, |d_i| < 1, the closed loop is
stable for all of them exactly if ``alpha mu(S - I/2) < 1`` at all frequencies (P. Seiler, A. Packard, P.
Gahinet: An introduction to disk margins, IEEE Control Systems 40(5), 2020), S being the sensitivity of all
loops together and mu the structured singular value of a diagonal of complex numbers. SLICOT's AB13MD gives an
upper bound of mu; the spectral radius, and the entries of the diagonal, are lower bounds.
"""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from spacerobot.errors import SpaceRobotError, near_names
from spacerobot.linear.linearisation import LinearSystem
from spacerobot.linear.loop_response import AT_ONCE, loop_response


def simultaneous_disk_margin(found: LinearSystem, loops: str = "torque/*") -> tuple[float, float]:
    """Bounds of the disk margin of loops that change at once.

    Parameters
    ----------
    found
        The linearised closed loop; loops of a periodic one must begin their periods together.
    loops
        Break points, ``torque/*``.

    Returns
    -------
    tuple of float
        What is guaranteed, and what it is at most.

    Raises
    ------
    SpaceRobotError
        If there is no such loop, slycot is not installed, or loops are not invariant in time together.
    """
    slycot = _slycot()
    names = [name for name in found.inputs if fnmatchcase(name, loops)]
    if not names:
        raise SpaceRobotError(f"no break point '{loops}', {near_names(loops, found.inputs)}")
    closed = [found.closed(name) for name in names]
    if any(one[0] is not closed[0][0] for one in closed):
        raise SpaceRobotError(f"{loops}: their signals are not held over the same periods")
    A, B, C, D = closed[0]
    places, size = [found.inputs.index(name) for name in names], len(names)
    B, C, D = B[:, places], C[places], D[np.ix_(places, places)]
    omega = np.unique(np.concatenate([loop_response(found, name)[0] for name in names]))
    lower, distances = 0.0, []
    for part in np.array_split(found.points(omega), -(-len(omega) // AT_ONCE)):
        states = np.linalg.solve(part[:, None, None] * np.eye(len(A)) - A, B)
        distances.append(C @ states + D + 0.5 * np.eye(size))  # S - I/2, S = I + G
    whole = np.concatenate(distances)
    lower = float(np.abs(np.linalg.eigvals(whole)).max())
    lower = max(lower, float(np.abs(np.diagonal(whole, axis1=1, axis2=2)).max()))
    greatest = np.linalg.svd(whole, compute_uv=False)[:, 0]
    upper = 0.0
    for k in np.argsort(-greatest):  # the greatest singular value bounds mu, too
        if greatest[k] <= max(upper, lower):
            break
        upper = max(upper, float(slycot.ab13md(whole[k], np.ones(size, int), np.full(size, 2))[0]))
    return 1 / max(upper, lower), 1 / lower


def _slycot() -> Any:
    try:
        import slycot
    except ImportError:
        raise SpaceRobotError(
            "structured singular values need the package slycot; install it by pip install slycot "
            "(builds with gfortran and OpenBLAS)"
        ) from None
    return slycot
