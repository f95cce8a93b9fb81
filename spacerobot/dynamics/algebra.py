"""Small linear algebra on sparse :class:`casadi.SX` that keeps structural zeros and symmetry.

``SX`` drops an operation only where an operand is *structurally* zero, and it does not notice that the
two triangles of a symmetric matrix are equal. The functions here keep structural zeros and symmetry.
"""

from __future__ import annotations

import casadi as ca

from spacerobot.dynamics.recorded import recorded

ZERO3 = ca.SX(3, 1)
"""The structurally zero vector."""

ZERO33 = ca.SX(3, 3)
"""The structurally zero 3x3 matrix."""

IDENTITY3 = ca.SX.eye(3)
"""The sparse identity."""


def cross(a: ca.SX, b: ca.SX) -> ca.SX:
    """Vector product of two 3-vectors, sparse where both operands allow it.

    Args:
        a, b: Vectors, 3x1.

    Returns:
        casadi.SX: ``a x b``, 3x1.
    """
    return ca.cross(a, b)


def cross_columns(a: ca.SX, matrix: ca.SX) -> ca.SX:
    """Vector product of ``a`` with every column: ``skew(a) @ matrix``, 3xn."""
    return ca.cross(ca.repmat(a, 1, matrix.size2()), matrix, 1)


def mirror(matrix: ca.SX) -> ca.SX:
    """Symmetric matrix from the lower triangle; both triangles share its nodes, so none is computed twice."""
    return ca.tril(matrix) + ca.tril(matrix, False).T


def rotate_symmetric(rotation: ca.SX, matrix: ca.SX) -> ca.SX:
    """Symmetric matrix in rotated axes: ``R A R^T``, 3x3, with few operations.

    Rotations about a coordinate axis use :func:`rotate_square`. For others, ``A = A_33 1 + A'``: rotation
    leaves the first part unchanged, and ``A'`` has one entry less.
    """
    if rotation.nnz() <= 5:
        return mirror(rotate_square(rotation, matrix))
    return _rotate_symmetric(rotation, matrix)


@recorded((3, 3), (3, 3))
def _rotate_symmetric(rotation: ca.SX, matrix: ca.SX) -> ca.SX:
    isotropic = matrix[2, 2] * IDENTITY3
    rest = matrix - isotropic
    rest = ca.vertcat(rest[:2, :], ca.horzcat(rest[2, :2], ca.SX(1, 1)))
    return mirror(ca.mtimes(rotation, ca.mtimes(rest, rotation.T)) + isotropic)


def rotate_square(rotation: ca.SX, matrix: ca.SX) -> ca.SX:
    """3x3 matrix in rotated axes, ``R A R^T``.

    A rotation with five entries is ``Rot(e_k; c, s) Q``, Q a signed permutation. Q only relabels; the block
    across the axis then needs 11 operations instead of 24: with ``w = c (A_11 - A_22) - s (A_12 + A_21)``
    it becomes ``[[A_22 + c w, A_12 + s w], [A_21 + s w, A_11 - c w]]``.
    """
    if rotation.nnz() == 3 or rotation.nnz() > 5:
        return ca.mtimes(rotation, ca.mtimes(matrix, rotation.T))
    k, cosine, sine, relabel = _split_turn(rotation)
    return _turn_square(cosine, sine, relabel, matrix, k=k)


@recorded((1, 1), (1, 1), (3, 3), (3, 3))
def _turn_square(cosine: ca.SX, sine: ca.SX, relabel: ca.SX, matrix: ca.SX, *, k: int) -> ca.SX:
    """Matrix ``Q A Q^T`` rotated about axis k."""
    a = ca.mtimes(relabel, ca.mtimes(matrix, relabel.T))
    i, j = (k + 1) % 3, (k + 2) % 3
    across = cosine * (a[i, i] - a[j, j]) - sine * (a[i, j] + a[j, i])
    by_cosine, by_sine = cosine * across, sine * across
    entries = {
        (i, i): a[j, j] + by_cosine,
        (j, j): a[i, i] - by_cosine,
        (i, j): a[i, j] + by_sine,
        (j, i): a[j, i] + by_sine,
        (i, k): cosine * a[i, k] - sine * a[j, k],
        (j, k): sine * a[i, k] + cosine * a[j, k],
        (k, i): cosine * a[k, i] - sine * a[k, j],
        (k, j): sine * a[k, i] + cosine * a[k, j],
        (k, k): a[k, k],
    }
    rows = [ca.horzcat(*(entries[row, column] for column in range(3))) for row in range(3)]
    return ca.vertcat(*rows)


def _split_turn(rotation: ca.SX) -> tuple[int, ca.SX, ca.SX, ca.SX]:
    """Axis index, cosine, sine and signed permutation of a rotation with five structural entries."""
    pattern = [[rotation.has_nz(i, j) for j in range(3)] for i in range(3)]
    k = next(i for i in range(3) if sum(pattern[i]) == 1)
    column = pattern[k].index(True)
    i, j = (k + 1) % 3, (k + 2) % 3
    sign = float(rotation[k, column])
    # Q takes `column` to k with that sign; the order of the other two makes Q a proper rotation.
    first, second = (column + 1) % 3, (column + 2) % 3
    if sign < 0:
        first, second = second, first
    relabel = ca.SX(3, 3)
    relabel[k, column], relabel[i, first], relabel[j, second] = sign, 1, 1
    return k, rotation[i, first], rotation[j, first], relabel


@recorded((3, 1))
def skew(vector: ca.SX) -> ca.SX:
    """Matrix of the vector product, ``skew(a) b = a x b``, 3x3, sparse."""
    x, y, z, zero = vector[0], vector[1], vector[2], ca.SX(1, 1)
    return ca.vertcat(ca.horzcat(zero, -z, y), ca.horzcat(z, zero, -x), ca.horzcat(-y, x, zero))


@recorded((3, 3), (3, 1))
def velocity_gradient(products: ca.SX, acceleration: ca.SX) -> ca.SX:
    """Acceleration of a rigid body's points relative to its origin, per unit of distance.

    A point at ``r`` from the origin accelerates by ``G r`` more than the origin does:
    ``G = skew(alpha) + skew(omega)^2``.

    Args:
        products: ``omega omega^T``, rad^2/s^2, 3x3.
        acceleration: Angular acceleration alpha, rad/s^2, 3x1.

    Returns:
        casadi.SX: ``G``, 1/s^2, 3x3.
    """
    square = -ca.trace(products)  # one node, which a planar G then shares
    return ca.sparsify(products + square * IDENTITY3) + skew(acceleration)


@recorded((3, 3), (3, 3), (3, 3), (3, 1))
def inertia_torque(rotational: ca.SX, products: ca.SX, gradient: ca.SX, acceleration: ca.SX) -> ca.SX:
    """Torque ``I alpha + omega x I omega`` (Euler), N m, 3x1, from the terms of :func:`velocity_gradient`.

    Args:
        rotational: I, kg m^2, 3x3 symmetric.
        products, gradient, acceleration: As in :func:`velocity_gradient`.
    """
    inertia, rows = rotational, []
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        rows.append(
            inertia[x, x] * acceleration[x]
            + (inertia[z, z] - inertia[y, y]) * products[y, z]
            + inertia[z, x] * gradient[y, x]
            - inertia[y, x] * gradient[z, x]
            + inertia[z, y] * (products[y, y] - products[z, z])
        )
    return ca.vertcat(*rows)


class SymmetricFactors:
    """Unrolled ``L D L^T`` of a symmetric positive definite matrix, structural zeros skipped.

    All factors are stored negated. ``SX`` rewrites ``x * (1 / d)`` as a division, hence one division for each
    product. It leaves ``x * (-1 / d)`` unchanged, hence one division for each pivot.

    Args:
        matrix: Symmetric positive definite, nxn; only the lower triangle is read.
    """

    def __init__(self, matrix: ca.SX) -> None:
        size = matrix.size1()
        lower = ca.SX(size, size)  # -L below the diagonal
        pivots = ca.SX(size, 1)  # D
        inverse = ca.SX(size, size)  # -D^-1
        scaled = ca.SX(size, size)  # L D
        for j in range(size):
            pivot = matrix[j, j]
            for k in range(j):
                pivot = pivot + scaled[j, k] * lower[j, k]
            pivots[j] = pivot
            inverse[j, j] = -1 / pivot
            for i in range(j + 1, size):
                entry = matrix[i, j]
                for k in range(j):
                    entry = entry + scaled[i, k] * lower[j, k]
                if entry.nnz():
                    scaled[i, j] = entry
                    lower[i, j] = entry * inverse[j, j]
        self._lower = lower
        self._pivots = pivots
        self._inverse = inverse

    @property
    def negated_pivots(self) -> ca.SX:
        """``-1 / D_ii``, nx1."""
        return ca.diag(self._inverse)

    def solve(self, right: ca.SX) -> ca.SX:
        """``A^-1 B`` for any number of columns, nxm."""
        return -self.solve_negated(right)

    def solve_negated(self, right: ca.SX) -> ca.SX:
        """``-A^-1 B`` for any number of columns, nxm."""
        return self.restored(ca.mtimes(self._inverse, self.reduced(right)))

    def reduced(self, right: ca.SX) -> ca.SX:
        """``L^-1 B``, nxm."""
        rows = [right[i, :] for i in range(self._lower.size1())]
        for i in range(len(rows)):
            for k in range(i):
                rows[i] = rows[i] + self._lower[i, k] * rows[k]
        return ca.vertcat(*rows)

    def unreduced(self, right: ca.SX) -> ca.SX:
        """Inverse of ``restored(D^-1 B)``: ``D L^T B``, nxm."""
        rows = [right[i, :] for i in range(self._lower.size1())]
        for i in range(len(rows)):
            for k in range(i + 1, len(rows)):
                rows[i] = rows[i] - self._lower[k, i] * rows[k]
        return ca.mtimes(ca.diag(self._pivots), ca.vertcat(*rows))

    def restored(self, right: ca.SX) -> ca.SX:
        """``L^-T B``, nxm."""
        rows = [right[i, :] for i in range(self._lower.size1())]
        for i in reversed(range(len(rows))):
            for k in range(i + 1, len(rows)):
                rows[i] = rows[i] + self._lower[k, i] * rows[k]
        return ca.vertcat(*rows)
