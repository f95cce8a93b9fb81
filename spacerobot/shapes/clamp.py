"""Clamping, and the constant that regularises lengths."""

import casadi as ca

TINY = 1e-24
"""Added to squared lengths, so that their square roots have finite derivatives at zero [m^2]."""


def clamp(value: ca.SX, bound: ca.SX) -> ca.SX:
    """Value limited to [-bound, bound], entry by entry."""
    return ca.fmin(ca.fmax(value, -bound), bound)
