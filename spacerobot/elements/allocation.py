"""Which thrusters give a wanted wrench: bounded least squares by coordinate descent of fixed length.

    min |A a - w|^2 + e |a|^2,    0 <= a <= 1

Each sweep brings every component to its own minimum, the others held, and cuts it to its bounds. That never
increases what is minimised, needs no division, has no branches and so compiles and can be differentiated.
"""

from __future__ import annotations

import casadi as ca

SMALL = 1e-6
"""e: draws combinations that give the same wrench towards the one of least effort, too slowly to reach it."""


def allocate(matrix: ca.SX, weights: ca.SX, wanted: ca.SX, sweeps: int) -> ca.SX:
    """Parts a (n x 1) of the thrusters' thrust.

    Parameters
    ----------
    matrix
        A (m x n): what each does at full thrust, all rows of about the same size.
    weights
        ``1 / (|A_i|^2 + e)`` of each column (n x 1).
    wanted
        w (m x 1), its rows scaled like those of A.
    sweeps
        How many; from zero.
    """
    columns, parts = ca.horzsplit(matrix), [ca.SX(0)] * matrix.size2()
    left = wanted
    for _ in range(sweeps):
        for i, column in enumerate(columns):
            step = (ca.dot(column, left) - SMALL * parts[i]) * weights[i]
            part = ca.fmin(ca.fmax(parts[i] + step, 0), 1)
            left = left - column * (part - parts[i])
            parts[i] = part
    return ca.vertcat(*parts)
