"""Values within bounds, and lengths that have derivatives everywhere."""

import casadi as ca

TINY = 1e-24
"""[m^2] added to the square of a distance, so that two points in one place have a direction without NaN."""


def clamp(value: ca.SX, bound: ca.SX) -> ca.SX:
    """Value between -bound and bound, entry by entry."""
    return ca.fmin(ca.fmax(value, -bound), bound)
