"""Lobatto collocation as data: nodes and integration weights on the interval from 0 to 1.

In the Lobatto IIIA method with s points, the polynomial of degree s - 1 through a motion's rates at the nodes
is integrated exactly: A_jk is the integral from 0 to node c_j of the polynomial that is one at c_k and zero
at the other nodes. The order is 2 s - 2; s = 3 is the Hermite-Simpson method.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial

from optim.planning.transcription.mesh import Mesh
from spacerobot.common.arrays import Array


@dataclass(frozen=True, eq=False)
class Lobatto:
    """Collocation on one interval.

    Attributes:
        nodes: Collocation nodes in 0 .. 1 (s,), both ends among them.
        integral: Matrix A (s, s): integral from 0 to node j of the basis polynomial of node k; its last row
            holds the weights of the quadrature.
    """

    nodes: Array
    integral: Array

    @classmethod
    def of_order(cls, order: int) -> Lobatto:
        """Collocation of a given even order, at least 2."""
        points = order // 2 + 1
        legendre = np.polynomial.Legendre.basis(points - 1)
        inner = np.sort(legendre.deriv().roots().real) if points > 2 else np.empty(0)
        nodes = np.concatenate([[0.0], (inner + 1) / 2, [1.0]])
        basis = _basis(nodes)
        integral = np.array(
            [[polynomial.polyval(x, polynomial.polyint(b)) for b in basis] for x in nodes], dtype=float
        )
        integral[0] = 0.0
        for array in (nodes, integral):
            array.setflags(write=False)
        return cls(nodes, integral)

    @property
    def points(self) -> int:
        """Number of nodes, s."""
        return len(self.nodes)

    @property
    def weights(self) -> Array:
        """Weights of the quadrature (s,)."""
        return np.array(self.integral[-1])

    @functools.cached_property
    def basis(self) -> list[Array]:
        """Coefficients of the polynomials that are one at a node and zero at the others, lowest first."""
        return _basis(self.nodes)

    @functools.cached_property
    def primitives(self) -> list[Array]:
        """Coefficients of their integrals from 0."""
        return [np.asarray(polynomial.polyint(b)) for b in self.basis]

    def times(self, mesh: int | Mesh, duration_s: float) -> Array:
        """Times of all points of N intervals (N (s - 1) + 1,) [s]."""
        mesh = Mesh.of(mesh)
        inside = (mesh.starts[:, None] + mesh.widths[:, None] * self.nodes[:-1]).ravel()
        return np.append(inside, 1.0) * duration_s

    def quadrature(self, mesh: int | Mesh) -> Array:
        """Weights of all points of N intervals, for a duration of one (N (s - 1) + 1,)."""
        mesh = Mesh.of(mesh)
        point_weights = np.zeros(mesh.intervals * (self.points - 1) + 1)
        at = np.arange(mesh.intervals)[:, None] * (self.points - 1) + np.arange(self.points)
        np.add.at(point_weights, at, mesh.widths[:, None] * self.weights)
        return point_weights

    def values_at(self, place: Array) -> Array:
        """Basis polynomials at places (n,) in an interval, 0 to 1: (n, s)."""
        return np.stack([polynomial.polyval(np.asarray(place, dtype=float), b) for b in self.basis], axis=-1)

    def primitives_at(self, place: Array) -> Array:
        """Integrals of the basis polynomials from 0 to places (n,): (n, s)."""
        at = np.asarray(place, dtype=float)
        return np.stack([polynomial.polyval(at, b) for b in self.primitives], axis=-1)


def _basis(nodes: Array) -> list[Array]:
    """See :attr:`Lobatto.basis`."""
    polynomials = []
    for k, node in enumerate(nodes):
        others = np.delete(nodes, k)
        polynomials.append(polynomial.polyfromroots(others) / np.prod(node - others))
    return polynomials
