r"""Kalman filters whose measurements are processed one component after the other.

Covariances are stored as their upper triangles, so that they stay symmetric. A scalar measurement $z = h x
+ n$ with the variance $r$ has the gain $k = g / s$ with $g = P h^\top$ and $s = h g + r$. Joseph's form

$$ (I - k h) P (I - k h)^\top + k r k^\top = P - k g^\top - g k^\top + s k k^\top $$

stays symmetric and positive for any gain (Bucy and Joseph 1968; Markley and Crassidis 2014, 5.5).
Components with independent errors, processed one by one, give the same estimate as all at once, without the
inverse of a matrix. Their normalised innovations squared add up to the NIS, $\sum \nu^2 / s$.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca


def triangle(matrix: ca.SX) -> ca.SX:
    """Upper triangle of a symmetric matrix (n x n), row by row (n (n + 1) / 2 x 1)."""
    size = matrix.size1()
    return ca.vertcat(ca.SX(0, 1), *(matrix[i, j] for i in range(size) for j in range(i, size)))


def symmetric(entries: ca.SX, size: int) -> ca.SX:
    """Symmetric matrix (n x n) from its upper triangle; see :func:`triangle`."""
    matrix, remaining = ca.SX(size, size), iter(ca.vertsplit(entries))
    for i in range(size):
        for j in range(i, size):
            matrix[i, j] = matrix[j, i] = next(remaining)
    return matrix


def updated(
    covariance: ca.SX, rows: ca.SX, innovation: ca.SX, variances: Sequence[ca.SX]
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Kalman measurement update with independent scalar measurements, in Joseph's form.

    Args:
        covariance: Covariance of the errors before the update (n x n).
        rows: Derivatives of the measurement with respect to the errors (m x n).
        innovation: Measured minus predicted value (m x 1).
        variances: Variances of the independent measurement errors (m of 1x1).

    Returns:
        tuple: Correction (n x 1), covariance (n x n) and normalised innovation squared (1x1).
    """
    correction, nis = ca.SX.zeros(covariance.size1()), ca.SX(0)
    for i, variance in enumerate(variances):
        row = rows[i, :]
        spread = ca.mtimes(covariance, row.T)
        scale = ca.mtimes(row, spread) + variance
        gain = spread / scale
        scalar_innovation = innovation[i] - ca.mtimes(row, correction)
        correction = correction + gain * scalar_innovation
        nis = nis + scalar_innovation * scalar_innovation / scale
        outer = ca.mtimes(gain, spread.T)
        covariance = covariance - outer - outer.T + scale * ca.mtimes(gain, gain.T)
    return correction, covariance, nis
