"""States that blocks of the closed loop carry, beside the configuration and velocity."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class State:
    """A state with where it begins and how it changes.

    Attributes
    ----------
    name
        Where it belongs, ``rpr1/tip/pid.integral``.
    symbol
        Its symbols (n x 1).
    initial
        Its value at the start, an expression of (t, q, v, c); other states in it count as zero (n x 1).
    derivative
        Its time derivative, an expression of (t, x, c) (n x 1).
    """

    name: str
    symbol: ca.SX
    initial: ca.SX
    derivative: ca.SX

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each component."""
        return tuple(f"{self.name}[{i}]" for i in range(self.symbol.size1()))
